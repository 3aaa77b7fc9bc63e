"""Delivery of the messages of a frame: queue, radio, loss and delay, at every other agent.

A frame needs the spec, the trace and its own sensor frames only. So the medium is free at every
tick: messages still on the air from earlier ticks do not delay it. A message not sent until the
next one of its kind is due is given up.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from advercity_dsl import Agent, Spec
from advercity_dsl.channel import Channel

from advercity.channel.impairments import ChannelRandomness
from advercity.channel.propagation import (
    Environment,
    RadioPath,
    compute_air_attenuation_db_km,
    compute_received_dbm,
)
from advercity.channel.radio_paths import Antenna, RadioPaths
from advercity.channel.stations import (
    CAM_MIN_S,
    compute_size_bytes,
    describe_station,
    find_cam_ticks,
    perceive_objects,
)
from advercity.frames import Frame, Trace
from advercity.sensors.messages import (
    Delivery,
    LossReason,
    Message,
    MessageKind,
    PerceivedObjects,
    SentMessages,
)
from advercity.sensors.sensor_frame import SensorFrame
from advercity.world import World

BITS_PER_BYTE = 8.0
BITS_PER_MEGABIT = 1e6


@dataclass(frozen=True)
class Air:
    """Water in the air.

    Attributes:
        rain_mm_h: Rate of rain.
        fog_water_g_m3: Liquid water of fog.
    """

    rain_mm_h: float = 0.0
    fog_water_g_m3: float = 0.0


@dataclass(frozen=True)
class _Link:
    """Two stations in a frame.

    Attributes:
        distance_m: Between their antennas.
        path: The radio path between them; None without a radio.
        power_dbm: Received power of each from the other; None without a radio.
    """

    distance_m: float
    path: RadioPath | None = None
    power_dbm: float | None = None


@dataclass(frozen=True, eq=False)
class _Outgoing:
    """A message before it is sent."""

    kind: MessageKind
    sensor_frame: SensorFrame
    size_bytes: int
    objects: PerceivedObjects | None


class V2xChannel:
    """The channel of a scenario, which sends the messages of its frames in any order.

    Args:
        spec: A spec with a channel.
        channel: The channel of the spec.
        trace: Its traffic.
        world: Its world, which hides stations from each other.
    """

    def __init__(self, spec: Spec, channel: Channel, trace: Trace, world: World) -> None:
        self._spec, self._channel = spec, channel
        duration_s = spec.timing.max_ticks * spec.timing.tick_s
        self._randomness = ChannelRandomness(spec, channel, duration_s=duration_s)
        self._paths = RadioPaths(world) if channel.radio is not None else None
        self._environment: Environment = _find_environment(spec, channel)
        self._cam_ticks: Mapping[str, frozenset[int]] = {}
        if channel.cam is not None and channel.cam.generation == "dynamic":
            self._cam_ticks = {agent.id: find_cam_ticks(agent, trace) for agent in spec.agents}

    def send(self, sensor_frames: Sequence[SensorFrame], air: Air) -> dict[str, SentMessages]:
        """Send the due messages of a frame; return each agent's messages, by its id.

        Args:
            sensor_frames: One per agent, of one frame.
            air: Rain and fog.
        """
        frame = sensor_frames[0].frame
        outgoing = [
            self._build_outgoing(kind, item)
            for item in sensor_frames
            for kind in MessageKind
            if self._is_due(kind, item.agent, frame.index)
        ]
        waits_s = self._compute_waits_s(outgoing, frame.index)
        links = self._find_links(sensor_frames, air) if outgoing else {}
        messages: dict[str, tuple[Message, ...]] = {item.agent.id: () for item in sensor_frames}
        for item, wait_s in zip(outgoing, waits_s, strict=True):
            sender = item.sensor_frame.agent
            messages[sender.id] += (self._send_one(item, wait_s, links),)
        return {
            name: SentMessages(self._randomness.draw_clock_offset_s(name), sent)
            for name, sent in messages.items()
        }

    def _is_due(self, kind: MessageKind, agent: Agent, tick: int) -> bool:
        if kind is MessageKind.CAM and self._cam_ticks:
            return tick in self._cam_ticks[agent.id]
        period_s = self._channel.periods_s.get(kind)
        if period_s is None:
            return False
        ticks = round(period_s / self._spec.timing.tick_s)
        # Each station has its own beat: not all send in the same tick.
        phase = int(self._randomness.make_generator("phase", agent.id, str(kind)).integers(ticks))
        return tick % ticks == phase

    def _build_outgoing(self, kind: MessageKind, sensor_frame: SensorFrame) -> _Outgoing:
        objects = None
        if kind is MessageKind.CPM and self._channel.cpm is not None:
            objects = perceive_objects(sensor_frame, self._channel.cpm, self._randomness)
        size_bytes = compute_size_bytes(kind, self._channel, sensor_frame.agent, objects)
        return _Outgoing(kind, sensor_frame, size_bytes, objects)

    def _compute_waits_s(self, outgoing: Sequence[_Outgoing], tick: int) -> list[float | None]:
        """Compute the time until each message is sent; None for messages given up.

        CAM go first, then CPM, then data; stations of a kind in an order drawn for the tick.
        """
        if self._channel.rate_mbit_s is None:
            return [0.0] * len(outgoing)
        bits_per_s = self._channel.rate_mbit_s * BITS_PER_MEGABIT
        places = self._randomness.make_generator("medium", tick).random(len(self._spec.agents))
        rank = dict(zip((agent.id for agent in self._spec.agents), places, strict=True))
        kinds = list(MessageKind)

        def find_turn(number: int) -> tuple[int, float]:
            item = outgoing[number]
            return kinds.index(item.kind), rank[item.sensor_frame.agent.id]

        waits_s: list[float | None] = [None] * len(outgoing)
        busy_s = 0.0
        for number in sorted(range(len(outgoing)), key=find_turn):
            end_s = busy_s + outgoing[number].size_bytes * BITS_PER_BYTE / bits_per_s
            # A message without enough time is not begun; smaller ones may still fit.
            if end_s <= self._channel.periods_s.get(outgoing[number].kind, CAM_MIN_S):
                waits_s[number] = busy_s = end_s
        return waits_s

    def _find_links(
        self, sensor_frames: Sequence[SensorFrame], air: Air
    ) -> dict[frozenset[str], _Link]:
        """Find every pair of stations, by their ids."""
        frame = sensor_frames[0].frame
        antennas = [self._place_antenna(item) for item in sensor_frames]
        pairs = list(combinations(range(len(sensor_frames)), 2))
        names = [
            (sensor_frames[first].agent.id, sensor_frames[second].agent.id)
            for first, second in pairs
        ]
        ends = [(antennas[first], antennas[second]) for first, second in pairs]
        if self._paths is None or not pairs:
            distances = [float(np.linalg.norm(b.position - a.position)) for a, b in ends]
            return {frozenset(n): _Link(d) for n, d in zip(names, distances, strict=True)}
        driven_m = {item.agent.id: _find_driven_m(item) for item in sensor_frames}
        links: dict[frozenset[str], _Link] = {}
        for (first, second), path in zip(names, self._paths.find(frame, ends), strict=True):
            power = self._compute_power(
                first, second, path, driven_m[first] + driven_m[second], air
            )
            links[frozenset((first, second))] = _Link(path.distance_m, path, power)
        return links

    def _compute_power(
        self, first: str, second: str, path: RadioPath, driven_m: float, air: Air
    ) -> float:
        radio = self._channel.radio
        assert radio is not None, "a radio path without a radio"
        frequency_ghz = radio.frequency_mhz / 1e3
        return compute_received_dbm(
            radio,
            path,
            self._environment,
            shadowing=self._randomness.draw_shadowing(first, second, driven_m),
            blockage=self._randomness.draw_blockage(first, second, path.blocker),
            air_db_km=compute_air_attenuation_db_km(
                air.rain_mm_h, air.fog_water_g_m3, frequency_ghz
            ),
        )

    def _place_antenna(self, item: SensorFrame) -> Antenna:
        """Place an antenna over the roof of a vehicle, or where a roadside unit is."""
        position = item.world_from_agent[:3, 3].copy()
        if item.agent.place.kind == "roadside_unit":
            return Antenna(position, 0)
        above_m = self._channel.radio.antenna_above_roof_m if self._channel.radio else 0.0
        position[2] += item.frame.get_state(item.agent.number).actor.size[2] + above_m
        return Antenna(position, item.agent.number)

    def _send_one(
        self, item: _Outgoing, wait_s: float | None, links: Mapping[frozenset[str], _Link]
    ) -> Message:
        sender, frame = item.sensor_frame.agent, item.sensor_frame.frame
        offset_s = self._randomness.draw_clock_offset_s(sender.id)
        return Message(
            kind=item.kind,
            size_bytes=item.size_bytes,
            timestamp_s=frame.time_s + offset_s,
            station=describe_station(item.sensor_frame, self._channel, self._randomness),
            objects=item.objects,
            deliveries={
                agent.id: self._deliver(
                    item, agent, wait_s, links[frozenset((sender.id, agent.id))], frame
                )
                for agent in self._spec.agents
                if agent.id != sender.id
            },
        )

    def _deliver(
        self, item: _Outgoing, receiver: Agent, wait_s: float | None, link: _Link, frame: Frame
    ) -> Delivery:
        channel, sender = self._channel, item.sensor_frame.agent.id
        power_dbm = link.power_dbm
        path = None if link.path is None else link.path.state.value
        generator = self._randomness.make_generator(
            "delivery", sender, receiver.id, str(item.kind), frame.index
        )
        # Both are drawn for every message: no limit changes the fate of others.
        luck, jitter = float(generator.random()), float(generator.standard_exponential())
        delay_s = (wait_s or 0.0) + channel.latency.minimum_s + channel.latency.jitter_s * jitter
        lost = None
        if wait_s is None:
            lost = LossReason.QUEUE
        elif channel.range_m is not None and link.distance_m > channel.range_m:
            lost = LossReason.RANGE
        elif power_dbm is not None and power_dbm < self._sensitivity_dbm:
            lost = LossReason.POWER
        elif luck < self._randomness.find_loss_rate(sender, receiver.id, frame.time_s):
            lost = LossReason.CHANNEL
        elif delay_s > channel.lifetime_s:
            lost = LossReason.LIFETIME
        return Delivery(None if lost else delay_s, lost, power_dbm, path)

    @property
    def _sensitivity_dbm(self) -> float:
        assert self._channel.radio is not None, "a received power without a radio"
        return self._channel.radio.sensitivity_dbm


def _find_environment(spec: Spec, channel: Channel) -> Environment:
    """Find the kind of path loss on the road of a spec."""
    declared = channel.radio.environment if channel.radio is not None else "auto"
    if declared == "auto":
        return "urban" if spec.road.land_use == "urban" else "highway"
    return declared


def _find_driven_m(item: SensorFrame) -> float:
    if item.agent.place.kind == "roadside_unit":
        return 0.0
    return item.frame.get_state(item.agent.number).travelled_m
