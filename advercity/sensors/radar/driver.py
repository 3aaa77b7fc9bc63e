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
        self._placed: Mapping[str, Sequence[PlacedRadar]] = {}
        self._motion = SceneMotion(stage.frame, stage.world.bodies)
        self._derive_once = lru_cache(maxsize=1)(self._derive_conditions)

    def prepare(self) -> None:
        """Place the radars of all agents."""
        frame, poses = self.stage.frame, self.stage.poses
        self._placed = {agent.id: place_radars(poses, agent, frame) for agent in poses.spec.agents}
        self._motion = SceneMotion(frame, self.stage.world.bodies)

    def measure(self, agent: Agent, number: int) -> RadarScan:
        """Measure detections, and powers of all cells if the output is `cube`."""
        stage, placed, motion = self.stage, self._placed[agent.id][number], self._motion
        others = [one for of_one in self._placed.values() for one in of_one if one is not placed]
        frame = stage.find_sampled_frame("radar", agent, number)
        raycaster = stage.place_raycaster(frame, agent)
        rng = stage.poses.make_generator("radar", agent, frame, number)
        if frame is not motion.frame:
            placed = place_radars(stage.poses, agent, frame)[number]
            motion = SceneMotion(frame, stage.world.bodies)
        conditions = self._derive_once(stage.weather_state)
        found = scan_radar(placed, others, raycaster, motion, conditions, rng)
        stamp_s = stage.find_stamp("radar", agent, number)
        return RadarScan(placed.world_from_radar, found.detections, found.cube, stamp_s)

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
