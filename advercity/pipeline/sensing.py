"""Captures frames with all sensors of a scenario, in any order of frames."""

from collections.abc import Generator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from advercity_dsl import Agent, Spec
from advercity_dsl.registry import load_named
from advercity_dsl.sensor_kinds import load_sensor_kinds

from advercity.channel.transmission import Air, V2xChannel
from advercity.errors import InputError
from advercity.geometry.arrays import Uint8Array
from advercity.pipeline.preparation import PreparedScenario
from advercity.rendering.backend import CameraCapture, Renderer
from advercity.sensors.camera.driver import CameraDriver
from advercity.sensors.sensor_frame import SensorFrame
from advercity.sensors.stage import SensorDriver, Stage
from advercity.world import World


@contextmanager
def open_sensors(prepared: PreparedScenario) -> Generator["SensorRig"]:
    """Open the world of a scenario in its backend, with a sensor at every mount.

    Loading or building the world and compiling shaders take seconds.
    """
    world, timeline = prepared.load_world(), prepared.poses.timeline
    atmosphere = timeline.atmosphere_at(0, prepared.spec.road.land_use)
    with prepared.backend.open(world, atmosphere, prepared.profile) as renderer:
        yield SensorRig(prepared, renderer, world)


class SensorRig:
    """The sensors of all agents of an open scenario."""

    def __init__(self, prepared: PreparedScenario, renderer: Renderer, world: World) -> None:
        spec, self._poses = prepared.spec, prepared.poses
        self._options = prepared.options
        self._stage = Stage(
            prepared.poses, world, renderer, prepared.profile, prepared.backend.name
        )
        self._drivers: dict[str, SensorDriver] = {
            name: load_named(kind.driver)(self._stage)
            for name, kind in load_sensor_kinds().found.items()
            if any(agent.sensors.list_sensors(name) for agent in spec.recorded_agents)
        }
        trace = prepared.traffic.trace
        self._channel = V2xChannel(spec, spec.channel, trace, world) if spec.channel else None

    def capture_frame(self, index: int) -> tuple[SensorFrame, ...]:
        """Capture all agents' measurements in recorded frame `index`, in the spec's order."""
        self._stage.place(index)
        for driver in self._drivers.values():
            driver.prepare()
        return self._send_messages(
            [self._measure(agent) for agent in self._stage.spec.recorded_agents]
        )

    def capture_image(self, agent: Agent, camera: int, index: int) -> Uint8Array:
        """Render the image (h, w, 3), RGB, of one camera alone in recorded frame `index`."""
        self._stage.place(index)
        return self._cameras.capture_image(agent, camera)

    def capture_camera(self, agent: Agent, camera: int, index: int) -> CameraCapture:
        """Render the light arriving at one camera alone in recorded frame `index`."""
        self._stage.place(index)
        return self._cameras.capture(agent, camera)

    @property
    def _cameras(self) -> CameraDriver:
        found = self._drivers.get("camera")
        assert isinstance(found, CameraDriver), "the caller names one of the agent's cameras"
        return found

    def _measure(self, agent: Agent) -> SensorFrame:
        """Measure with all sensors of an agent."""
        readings: dict[str, tuple[Any, ...]] = {}
        for name, driver in self._drivers.items():
            numbers = range(len(agent.sensors.list_sensors(name)))
            measured = [driver.measure(agent, number) for number in numbers]
            readings[name] = tuple(one for one in measured if one is not None)
        estimates = (driver.estimate_pose(agent) for driver in self._drivers.values())
        found = self._poses.build_sensor_frame(
            agent,
            self._stage.frame,
            readings,
            estimated_world_from_agent=next((one for one in estimates if one is not None), None),
        )
        return replace(found, min_points=self._options.min_points)

    def _send_messages(self, sensor_frames: Sequence[SensorFrame]) -> tuple[SensorFrame, ...]:
        """Add the messages of every agent, if the scenario has a channel."""
        if self._channel is None:
            return tuple(sensor_frames)
        atmosphere = self._stage.atmosphere
        air = Air(atmosphere.rain_mm_h, atmosphere.extinction.water_g_m3)
        sent = self._channel.send(sensor_frames, air)
        return tuple(replace(item, sent=sent[item.agent.id]) for item in sensor_frames)


def find_agent_with_camera(spec: Spec, name: str | None, camera: int) -> Agent:
    """Find an agent, None for the ego; InputError if there is none, or it has no such camera."""
    agents = {agent.id: agent for agent in spec.recorded_agents}
    if name is not None and name not in agents:
        raise InputError(f"{spec.id} has no agent '{name}'; it has {', '.join(agents)}")
    agent = spec.ego if name is None else agents[name]
    count = len(agent.sensors.cameras)
    if not 0 <= camera < count:
        found = f"cameras 0 to {count - 1}, not {camera}" if count else "no camera"
        raise InputError(f"{agent.id} has {found}")
    return agent
