"""Measures with the radars of an open scenario."""

from collections.abc import Mapping, Sequence
from functools import lru_cache

import numpy as np
from advercity_dsl import Agent, RoadsideUnit

from advercity.frames import Frame
from advercity.sensors.agent_poses import AgentPoses
from advercity.sensors.radar.conditions import RadarConditions, derive_radar_conditions
from advercity.sensors.radar.motion import SceneMotion
from advercity.sensors.radar.placement import PlacedRadar
from advercity.sensors.radar.scan import scan_radar
from advercity.sensors.sensor_frame import RadarScan
from advercity.sensors.stage import SensorDriver, Stage


class RadarDriver(SensorDriver):
    """Measures with radars; each is disturbed by all others of the scene."""

    def __init__(self, stage: Stage) -> None:
        super().__init__(stage)
        self._scenes: dict[float, tuple[Mapping[str, Sequence[PlacedRadar]], SceneMotion]] = {}
        self._derive_once = lru_cache(maxsize=1)(self._derive_conditions)

    def prepare(self) -> None:
        """Forget the places of radars in the frame before."""
        self._scenes = {}

    def measure(self, agent: Agent, number: int) -> RadarScan:
        """Measure detections, and powers of all cells if the output is `cube`."""
        stage = self.stage
        frame = stage.find_sampled_frame("radar", agent, number)
        radars, motion = self._place(frame)
        placed = radars[agent.id][number]
        others = [one for of_one in radars.values() for one in of_one if one is not placed]
        raycaster = stage.place_raycaster(frame, agent)
        rng = stage.poses.make_generator("radar", agent, frame, number)
        conditions = self._derive_once(stage.weather_state)
        found = scan_radar(placed, others, raycaster, motion, conditions, rng)
        stamp_s = stage.find_stamp("radar", agent, number)
        return RadarScan(
            *(placed.world_from_radar, found.detections, found.cube, stamp_s, found.seen_actors)
        )

    def _place(self, frame: Frame) -> tuple[Mapping[str, Sequence[PlacedRadar]], SceneMotion]:
        """Place the radars of all agents at the time of a sample."""
        if frame.time_s not in self._scenes:
            poses = self.stage.poses
            radars = {agent.id: place_radars(poses, agent, frame) for agent in poses.spec.agents}
            self._scenes[frame.time_s] = radars, SceneMotion(frame, self.stage.world.bodies)
        return self._scenes[frame.time_s]

    def _derive_conditions(self, state: int) -> RadarConditions:
        weather = self.stage.poses.timeline.weather_at(state)
        return derive_radar_conditions(self.stage.atmosphere, weather.lens)


def place_radars(poses: AgentPoses, agent: Agent, frame: Frame) -> list[PlacedRadar]:
    """Place the radars of an agent in a frame."""
    radars, motion = agent.sensors.radars, poses.find_motion(agent, frame)
    carrier = (
        poses.world_from_agent(agent, frame.index)
        if isinstance(agent.place, RoadsideUnit)
        else poses.world_from_vehicle(agent, frame)
    )
    turn = carrier[:3, :3] @ motion.angular_rate
    return [
        PlacedRadar(
            radar=item.model,
            mount=item.mount,
            world_from_radar=pose,
            velocity=motion.velocity + np.cross(turn, pose[:3, 3] - carrier[:3, 3]),
            carrier=max(agent.number, 0),
        )
        for item, pose in zip(radars, poses.world_from_sensors("radar", agent, frame), strict=True)
    ]
