"""Poses of agents and sensors in each frame, and their planned paths."""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
from advercity_dsl import Agent, Mount, RoadsideUnit, Spec
from advercity_dsl.sampling import Sampled
from advercity_dsl.sensor_kinds import load_sensor_kinds

from advercity.conflicts.roles import find_conflict_roles
from advercity.errors import RunError
from advercity.frames import (
    AT_REST,
    BodyMotion,
    Frame,
    Trace,
    extract_planned_trajectory,
)
from advercity.geometry import poses
from advercity.geometry.arrays import Float64Array
from advercity.geometry.geodesy import find_world_origin
from advercity.geometry.poses import Matrix
from advercity.physics.timeline import WeatherTimeline
from advercity.randomness import create_generator
from advercity.scene.parking import find_parked_cars
from advercity.sensors.mounts import carrier_from_sensor
from advercity.sensors.sample_times import SampleMoment, find_newest_sample
from advercity.sensors.sensor_frame import SensorFrame
from advercity.traffic.figures import assign_figures, number_figures
from advercity.traffic.weather_effects import (
    apply_lamp_state,
    fit_led_headlamps,
    light_high_beams,
    may_use_high_beams,
    raise_umbrellas,
)


class AgentPoses:
    """Poses of every agent and of its sensors, a function of spec and trace.

    Attributes:
        spec: The scenario.
        timeline: Its weather in each frame.
        tick_s: Time between recorded frames.
        origin: Place of the world's origin on the globe.
        load_traced_frame: Loads a recorded frame by its number from the trace, without parked
            cars, and before the weather sets lamps and umbrellas.
    """

    def __init__(self, spec: Spec, trace: Trace) -> None:
        self.spec = spec
        self._trace = trace
        self.tick_s, self.origin = trace.tick_s, find_world_origin(spec.road)
        self.timeline = WeatherTimeline.from_spec(spec)
        self._roles = find_conflict_roles(spec)
        self._figures = number_figures(trace.actors)
        self.load_traced_frame = lru_cache(maxsize=4)(trace.build_frame)
        self._shown = lru_cache(maxsize=4)(self._build_frame)
        self._parked = find_parked_cars(spec)

    def load_frame(self, index: int) -> Frame:
        """Load recorded frame `index` with parked cars; lamps and umbrellas follow the weather."""
        return self._shown(index)

    def next_frame(self, frame: Frame) -> Frame | None:
        """Load the frame one tick later; None after the last."""
        last = len(self._trace) - 1
        return self.load_frame(frame.index + 1) if frame.index < last else None

    def _build_frame(self, index: int) -> Frame:
        weather, seed = self.timeline.weather_at(index), self.spec.seeds.traffic
        people = assign_figures(self.load_traced_frame(index), self._figures)
        shown = raise_umbrellas(people, weather.rain.rate_mm_h, seed=seed)
        lit = apply_lamp_state(shown, weather.lamps)
        if weather.time == "night":
            lit = fit_led_headlamps(lit, weather.lamps.led, self.spec.blueprints, seed=seed)
        if may_use_high_beams(weather, self.spec.road.land_use):
            lit = light_high_beams(lit, weather.lamps.high_beam, seed=seed)
        return replace(lit, states=(*lit.states, *self._parked))

    def build_sensor_frame(
        self,
        agent: Agent,
        frame: Frame,
        readings: Mapping[str, Sequence[Any]],
        *,
        estimated_world_from_agent: Matrix | None = None,
        seen_actors: Collection[int] | None = None,
    ) -> SensorFrame:
        """Add pose and planned path of an agent to the readings of its sensors.

        Args:
            agent: The agent.
            frame: Recorded frame, as `load_frame` returns it.
            readings: Measurements, by the names of the sensors' kinds and their numbers.
            estimated_world_from_agent: (4, 4), its own estimate; None is the true pose.
            seen_actors: As in `SensorFrame`.
        """
        world_from_agent = self.world_from_agent(agent, frame.index)
        is_unit = isinstance(agent.place, RoadsideUnit)
        return SensorFrame(
            agent=agent,
            frame=frame,
            world_from_agent=world_from_agent,
            estimated_world_from_agent=(
                world_from_agent
                if estimated_world_from_agent is None
                else estimated_world_from_agent
            ),
            readings=readings,
            seen_actors=seen_actors,
            planned_trajectory=() if is_unit else self._load_planned_path(agent, frame.index),
            conflict_roles=self._roles,
            weather=(self.timeline.weather_at(frame.index) if self.timeline.is_changing else None),
        )

    def make_generator(
        self, sensor: str, agent: Agent, frame: Frame, *more: int
    ) -> np.random.Generator:
        """Create the random generator of a sensor of an agent in a frame."""
        spec = self.spec
        return create_generator(spec.seeds.sensors, spec.id, sensor, agent.id, frame.index, *more)

    def world_from_agent(self, agent: Agent, index: int) -> Matrix:
        """Return `world_from_agent` (4, 4): the vehicle's origin, or the roadside unit.

        Raises:
            RunError: The vehicle has left the road.
        """
        place = agent.place
        if isinstance(place, RoadsideUnit):
            return poses.pose_matrix(
                place.position_m,
                yaw=math.radians(place.yaw_deg),
                pitch=math.radians(place.pitch_deg),
                roll=math.radians(place.roll_deg),
            )
        return self.world_from_vehicle(agent, self.load_traced_frame(index))

    def world_from_sensors(
        self, kind: str, agent: Agent, frame: Frame, *, time_s: float = 0.0
    ) -> list[Matrix]:
        """Return the poses (4, 4) in the world of the sensors of a kind, by their numbers.

        Args:
            kind: Name of the kind: `camera`.
            agent: The agent.
            frame: Recorded frame, or one advanced by less than a tick.
            time_s: Time after `frame`, less than a tick; ignored for kinds placed `level`.
        """
        mounts = [item.mount for item in agent.sensors.list_sensors(kind)]
        if load_sensor_kinds().found[kind].placing != "level":
            shift_s = self.find_shift_s(frame) + time_s
            return self._world_from_mounts(agent, mounts, frame.index, shift_s)
        if isinstance(agent.place, RoadsideUnit):
            carrier = poses.pose_matrix(agent.place.position_m)
        else:
            carrier = self.world_from_vehicle(agent, frame)
        return [carrier @ carrier_from_sensor(mount) for mount in mounts]

    def velocity(self, agent: Agent, frame: Frame) -> Float64Array:
        """Return the velocity (3,) of an agent in the world in m/s; zero for a roadside unit."""
        return self.find_motion(agent, frame).velocity

    def rewind_frame(self, frame: Frame, time_s: float) -> Frame:
        """Return the actors some seconds before a frame; before the first, motion goes back."""
        tick_s = self.tick_s
        ticks = round((self.find_shift_s(frame) - time_s) / tick_s, 9)
        index = max(frame.index + math.ceil(ticks), 0)
        shift_s = round((frame.index + ticks - index) * tick_s, 9)
        then = self.load_traced_frame(index)
        return then.advance(shift_s) if shift_s else then

    def find_sample(self, agent: Agent, name: str, sensor: Sampled, frame: int) -> SampleMoment:
        """Find the newest sample, not after a frame, of a sensor of an agent by its name."""
        key = *self.build_drive_key(agent), name
        return find_newest_sample(sensor, self.tick_s, frame, key=key)

    def find_shift_s(self, frame: Frame) -> float:
        """Find by how much a frame was advanced since it was recorded."""
        return frame.time_s - self.load_traced_frame(frame.index).time_s

    def _world_from_mounts(
        self, agent: Agent, mounts: Sequence[Mount], index: int, time_s: float = 0.0
    ) -> list[Matrix]:
        """Return the poses (4, 4) of sensors tilted with their carrier.

        Sensors of a roadside unit turn about the vertical before they tilt, so all of them look
        down by the pitch of the unit.
        """
        place = agent.place
        if not isinstance(place, RoadsideUnit):
            carrier = self.world_from_agent(agent, index)
            if time_s:
                motion = self.find_motion(agent, self.load_traced_frame(index))
                carrier = motion.advance_pose(carrier, time_s)
            return [carrier @ carrier_from_sensor(mount) for mount in mounts]
        upright = poses.pose_matrix(place.position_m, yaw=math.radians(place.yaw_deg))
        tilt = poses.pose_matrix(
            (0, 0, 0), pitch=math.radians(place.pitch_deg), roll=math.radians(place.roll_deg)
        )
        return [upright @ carrier_from_sensor(mount) @ tilt for mount in mounts]

    def world_from_vehicle(self, agent: Agent, frame: Frame) -> Matrix:
        """Return the pose (4, 4) of a vehicle in a frame, which may be advanced.

        Raises:
            RunError: It has left the road.
        """
        try:
            return frame.get_state(agent.number).world_from_body
        except KeyError:
            raise RunError(
                f"{self.spec.id}: {agent.id} is not on the road in frame {frame.index};"
                " its route ends too early"
            ) from None

    def find_motion(self, agent: Agent, frame: Frame) -> BodyMotion:
        """Find the motion of an agent in a frame; a roadside unit is at rest."""
        if isinstance(agent.place, RoadsideUnit):
            return AT_REST
        return frame.get_state(agent.number).motion

    def find_travelled_m(self, agent: Agent, index: int) -> float:
        """Find how far an agent has driven until a recorded frame, in metres."""
        if isinstance(agent.place, RoadsideUnit):
            return 0.0
        return self.load_traced_frame(index).get_state(agent.number).travelled_m

    def _load_planned_path(
        self, agent: Agent, index: int
    ) -> tuple[tuple[float, float, float], ...]:
        points = extract_planned_trajectory(self._trace, agent.number, index).tolist()
        return tuple((x, y, speed) for x, y, speed in points)

    def find_pose(self, agent: Agent, time_s: float) -> Matrix:
        """Find the pose (4, 4) at a time since the first frame; before it, the first pose."""
        at = round(time_s / self.tick_s, 9)
        index = max(math.ceil(at), 0)
        now = self.world_from_agent(agent, index)
        if at >= index or index == 0:
            return now
        last = self.world_from_agent(agent, index - 1)
        return poses.interpolate_poses(last, now, [at - index + 1.0])[0]

    def build_drive_key(self, agent: Agent) -> tuple[int | str, ...]:
        """Build a key without the weather: a drive has the same errors in every weather."""
        seeds = self.spec.seeds
        return seeds.sensors, seeds.traffic, self.spec.road.id, agent.id
