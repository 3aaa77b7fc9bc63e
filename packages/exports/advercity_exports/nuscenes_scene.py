"""One agent of one scenario in nuScenes: a scene with an ego, channels, and key frames.

The ego frame is at the middle of a vehicle's rear axle, on the ground; x forward, y left, z up. For
a roadside unit it is at its head, level, with its yaw. LiDARs have x to the right and y forward, as
nuScenes mounts its own; cameras x right, y down, z along the view; radars x forward, y left.
"""

from __future__ import annotations

import hashlib
import math
from bisect import bisect_left
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from advercity_dsl import Agent

from advercity.dataset.agent_view import AgentView
from advercity.dataset.reader import FrameView, Scenario
from advercity.frames import WHEELBASE_FRACTION
from advercity.geometry import poses
from advercity.geometry.poses import Matrix

KEY_FRAME_INTERVAL_S = 0.5
MICROSECONDS = 1_000_000
START_STEP_US, START_STEPS = 1 << 10, 1 << 33
"""Steps between the starts of scenarios, more than agents, and their number: together 100 days;
the devkit's seconds, 64-bit numbers, keep nanoseconds."""
LIDAR_FROM_BODY = poses.pose_matrix((0.0, 0.0, 0.0), yaw=math.pi / 2)
"""From x forward, y left to x right, y forward."""
DIRECTIONS = (
    (30.0, "FRONT"),
    (80.0, "FRONT_LEFT"),
    (105.0, "LEFT"),
    (155.0, "BACK_LEFT"),
    (180.0, "BACK"),
)
"""Words of channels by the largest angle off the front, in degrees, for the left side."""
Modality = Literal["camera", "lidar", "radar"]


def make_token(*parts: str | int) -> str:
    """Make a token of 32 hexadecimal digits, the same for the same parts."""
    return hashlib.sha256("\0".join(map(str, parts)).encode()).hexdigest()[:32]


@dataclass(frozen=True)
class Channel:
    """A sensor of an agent.

    Attributes:
        name: Name in nuScenes, such as `CAM_FRONT`.
        modality: Kind of sensor.
        number: Number among the agent's sensors of this kind.
    """

    name: str
    modality: Modality
    number: int

    @property
    def file_format(self) -> str:
        """Ending of the names of its files."""
        return {"camera": "png", "lidar": "pcd.bin", "radar": "pcd"}[self.modality]

    def compute_ego_from_sensor(self, scene: Scene, view: AgentView) -> Matrix:
        """Compute the sensor's pose (4, 4) in the ego frame, with the sensor's axes of nuScenes."""
        ego_from_world = poses.invert_pose(scene.compute_world_from_ego(view, self))
        if self.modality == "camera":
            pose = view.world_from_camera(self.number)
            return ego_from_world @ pose @ poses.invert_pose(poses.OPTICAL_FROM_BODY)
        if self.modality == "lidar":
            pose = view.load_lidar_pose(self.number)
            return ego_from_world @ pose @ poses.invert_pose(LIDAR_FROM_BODY)
        return ego_from_world @ view.load_radar_pose(self.number)


def list_channels(agent: Agent) -> list[Channel]:
    """List the sensors of an agent; names get a number if directions are the same."""
    sensors = agent.sensors
    yaws_deg = [camera.mount.yaw_deg for camera in sensors.cameras]
    cameras = _name_uniquely("CAM", map(_name_direction, yaws_deg))
    mounted = sensors.list_sensors("lidar")
    lidars = _name_uniquely("LIDAR", [item.name.upper() or "TOP" for item in mounted])
    radars = _name_uniquely("RADAR", [_name_direction(r.mount.yaw_deg) for r in sensors.radars])
    return [
        *(Channel(name, "camera", number) for number, name in enumerate(cameras)),
        *(Channel(name, "lidar", number) for number, name in enumerate(lidars)),
        *(Channel(name, "radar", number) for number, name in enumerate(radars)),
    ]


def _name_direction(yaw_deg: float) -> str:
    angle = math.degrees(math.remainder(math.radians(yaw_deg), math.tau))
    word = next(word for limit, word in DIRECTIONS if abs(angle) <= limit + 1e-9)
    return word if angle > 0 else word.replace("LEFT", "RIGHT")


def _name_uniquely(kind: str, names: Iterable[str]) -> list[str]:
    seen: Counter[str] = Counter()
    found: list[str] = []
    for name in names:
        seen[name] += 1
        found.append(f"{kind}_{name}" if seen[name] == 1 else f"{kind}_{name}_{seen[name]}")
    return found


@dataclass(frozen=True)
class Scene:
    """An agent of a scenario.

    Attributes:
        scenario: The scenario.
        agent: The agent.
        only_some_are_key: Whether key frames are half a second apart; else every frame is one.
    """

    scenario: Scenario
    agent: Agent
    only_some_are_key: bool

    @property
    def name(self) -> str:
        """Name of the scene."""
        return f"{self.scenario.path.name}-{self.agent.id}"

    @cached_property
    def token(self) -> str:
        """Token of the scene."""
        return make_token("scene", self.name)

    @cached_property
    def channels(self) -> list[Channel]:
        """The agent's sensors."""
        return list_channels(self.agent)

    @cached_property
    def key_frames(self) -> tuple[int, ...]:
        """Numbers of the key frames, rising."""
        numbers = self.scenario.frame_numbers
        if not self.only_some_are_key:
            return numbers
        tick_s = self.scenario.spec.timing.tick_s
        keys: list[int] = []
        for number in numbers:
            if not keys or (number - keys[-1]) * tick_s > KEY_FRAME_INTERVAL_S - tick_s / 2:
                keys.append(number)
        return tuple(keys)

    @cached_property
    def start_us(self) -> int:
        """Time at which the scene begins, in microseconds.

        The devkit sorts scenes by it and cannot if two are equal: scenarios begin at times drawn
        from their names, and their agents a microsecond apart.
        """
        step = int(make_token("start", self.scenario.path.name), 16) % START_STEPS
        agents = [agent.id for agent in self.scenario.spec.recorded_agents]
        return step * START_STEP_US + agents.index(self.agent.id)

    def compute_timestamp_us(self, time_s: float) -> int:
        """Convert a time since the scenario's start."""
        return self.start_us + round(time_s * MICROSECONDS)

    def find_stamp_us(self, view: AgentView, channel: Channel) -> int | None:
        """Find the time of a sensor's measurement; None if it is the frame's."""
        time_s = view.stamps.get(f"{channel.modality}{channel.number}")
        return None if time_s is None else self.compute_timestamp_us(time_s)

    def is_key(self, frame: FrameView) -> bool:
        """Return whether a frame is a key frame, which is annotated."""
        position = bisect_left(self.key_frames, frame.index)
        return self.key_frames[position : position + 1] == (frame.index,)

    def make_sample_token(self, frame: int) -> str:
        """Make the token of a key frame's sample."""
        return make_token("sample", self.name, frame)

    def make_data_token(self, channel: Channel, frame: int) -> str:
        """Make the token of a sensor's data in a frame."""
        return make_token("sample_data", self.name, channel.name, frame)

    def make_calibration_token(self, channel: Channel) -> str:
        """Make the token of a sensor's calibration."""
        return make_token("calibrated_sensor", self.name, channel.name)

    def format_path(self, channel: Channel, frame: FrameView) -> str:
        """Format the path of a sensor's data in a frame."""
        folder = "samples" if self.is_key(frame) else "sweeps"
        stem = f"{self.name}__{channel.name}__{self.compute_timestamp_us(frame.time_s)}"
        return f"{folder}/{channel.name}/{stem}.{channel.file_format}"

    def compute_world_from_ego(self, view: AgentView, channel: Channel | None = None) -> Matrix:
        """Compute the pose (4, 4) of the ego frame, in a frame or when a sensor measured."""
        pose = (
            view.world_from_agent
            if channel is None
            else view.find_carrier_pose(channel.modality, channel.number)
        )
        if self.agent.blueprint is None:
            yaw, _, _ = poses.to_yaw_pitch_roll(pose)
            return poses.pose_matrix(pose[:3, 3], yaw=yaw)
        length_m = self.scenario.spec.blueprints[self.agent.blueprint].length_m
        return pose @ poses.pose_matrix((-WHEELBASE_FRACTION / 2 * length_m, 0.0, 0.0))


def list_scenes(scenario: Scenario, *, only_some_are_key: bool) -> list[Scene]:
    """List the scenes of a scenario, in the order of its agents."""
    return [Scene(scenario, agent, only_some_are_key) for agent in scenario.spec.recorded_agents]


def quaternion_of(pose: Matrix) -> list[float]:
    """Compute the rotation of a pose as w, x, y, z."""
    return poses.to_quaternion(pose).tolist()


def translation_of(pose: Matrix, offset: tuple[float, float] = (0.0, 0.0)) -> list[float]:
    """Return the position of a pose, shifted in the plane."""
    return (pose[:3, 3] + np.array([*offset, 0.0])).tolist()
