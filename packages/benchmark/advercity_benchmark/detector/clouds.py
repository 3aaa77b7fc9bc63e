"""The clouds of a frame at a station: its own and the received ones."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, TypeVar, get_args

import numpy as np
from advercity_dsl.base import suggest_name

from advercity.dataset.agent_view import AgentView
from advercity.dataset.reader import FrameView
from advercity.errors import InputError
from advercity.geometry import poses
from advercity.geometry.arrays import Float32Array
from advercity.geometry.poses import Matrix
from advercity.sensors.messages import MessageKind
from advercity_benchmark.truth import COMMUNICATION_RANGE_M

Fusion = Literal["none", "late", "early", "intermediate"]
FUSIONS: tuple[Fusion, ...] = get_args(Fusion)
GROUND_RING_M = (3.0, 25.0)
GROUND_QUANTILE = 0.01
"""Quantile of the heights of points in this ring. Few are below the road; in fog most are above
it."""


@dataclass(frozen=True, eq=False)
class StationCloud:
    """The cloud of a station, and its place as assumed by the ego.

    Attributes:
        view: Record of the station.
        points: (n, 4) x, y, z, intensity in its LiDAR's frame, z over the ground around it.
        ground_m: Height of the ground in the LiDAR's frame.
        ego_from_station: (4, 4) to the ego's LiDAR frame, both with z over their ground.
    """

    view: AgentView
    points: Float32Array
    ground_m: float
    ego_from_station: Matrix


_FusionT = TypeVar("_FusionT", bound=Fusion)


def check_fusion(name: str, known: Sequence[_FusionT]) -> _FusionT:
    """Return the fusion by its name; InputError if it is unknown."""
    for fusion in known:
        if fusion == name:
            return fusion
    raise InputError(f"--fusion {name}: no such fusion; {suggest_name(name, known)}")


def check_frames(frames: Sequence[FrameView], fusion: Fusion, *, is_ideal: bool) -> None:
    """Raise an InputError with the reason if messages of frames cannot be fused."""
    for scenario in {frame.scenario.path: frame.scenario for frame in frames}.values():
        if fusion == "none" or is_ideal:
            continue
        channel = scenario.spec.channel
        hint = "; name a channel in the suite, as v2x_vit_noisy, or give --ideal-channel"
        if channel is None:
            raise InputError(f"{scenario.path}: has no messages: its suite names no channel{hint}")
        if not any(getattr(channel, kind.value) is not None for kind in _CARRIERS[fusion]):
            kinds = " or ".join(kind.value for kind in _CARRIERS[fusion])
            message = f"channel '{channel.id}' sends no {kinds}, in which {fusion} fusion sends"
            raise InputError(f"{scenario.path}: {message}{hint}")


_CARRIERS: dict[Fusion, tuple[MessageKind, ...]] = {
    "late": (MessageKind.CPM, MessageKind.DATA),
    "early": (MessageKind.DATA,),
    "intermediate": (MessageKind.DATA,),
}
"""Messages with boxes, points or features."""


def load_clouds(frame: FrameView, fusion: Fusion, *, is_ideal: bool) -> list[StationCloud]:
    """Load the ego's cloud and, if fused, the others'; the ego's comes first.

    Args:
        frame: The frame.
        fusion: Kind of fusion, which decides the messages.
        is_ideal: Whether all stations in range arrive at once and with their true poses, in place
            of the messages received over the channel.
    """
    ego = frame[frame.scenario.spec.ego.id]
    own = load_cloud(ego)
    ego_from_world = poses.invert_pose(ego.world_from_lidar @ _lift(own.ground_m))
    if fusion == "none":
        return [own]
    senders = (
        _find_in_range(frame, ego) if is_ideal else _find_received(frame, ego.agent.id, fusion)
    )
    others: list[StationCloud] = []
    for view, world_from_lidar in senders:
        cloud = load_cloud(view)
        pose = ego_from_world @ world_from_lidar @ _lift(cloud.ground_m)
        others.append(StationCloud(view, cloud.points, cloud.ground_m, pose))
    return [own, *others]


def load_cloud(view: AgentView) -> StationCloud:
    """Load the cloud of a station alone."""
    table = view.cloud
    points = np.column_stack([table[name] for name in ("x", "y", "z", "intensity")])
    distance_m = np.hypot(points[:, 0], points[:, 1])
    ring = (distance_m > GROUND_RING_M[0]) & (distance_m < GROUND_RING_M[1])
    heights = points[ring, 2] if ring.any() else np.zeros(1)
    ground_m = float(np.quantile(heights, GROUND_QUANTILE))
    points[:, 2] -= ground_m
    return StationCloud(view, points.astype(np.float32), ground_m, np.eye(4))


def _find_in_range(frame: FrameView, ego: AgentView) -> Iterator[tuple[AgentView, Matrix]]:
    place = ego.world_from_lidar[:2, 3]
    for view in frame.views.values():
        distance_m = np.hypot(*(view.world_from_lidar[:2, 3] - place))
        if view is not ego and distance_m <= COMMUNICATION_RANGE_M:
            yield view, view.world_from_lidar


def _find_received(
    frame: FrameView, receiver: str, fusion: Fusion
) -> Iterator[tuple[AgentView, Matrix]]:
    known: set[str] = set()
    for message in frame.messages(receiver):
        if message.kind in _CARRIERS[fusion] and message.sender not in known:
            known.add(message.sender)
            yield message.view, message.world_from_lidar


def _lift(height_m: float) -> Matrix:
    return poses.pose_matrix((0.0, 0.0, height_m))
