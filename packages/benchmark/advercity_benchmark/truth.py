"""The objects for a cooperative detector to find in a frame, in the ego's LiDAR frame."""

import math
from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from advercity.dataset.agent_view import AgentView
from advercity.dataset.boxes import UNCLASSIFIED
from advercity.dataset.reader import FrameView
from advercity.geometry import poses
from advercity.geometry.arrays import Float64Array
from advercity.geometry.poses import Matrix

VEHICLES = ("car", "van", "truck", UNCLASSIFIED)
"""Classes of the original's benchmark, without two-wheelers and people, and OPV2V's class."""
COMMUNICATION_RANGE_M = 70.0
"""Agents within this distance of the ego cooperate, as in OPV2V's configurations."""
RANGE_M = (140.0, 40.0)
"""Half length and half width of OpenCOOD's evaluated area, ahead and to the side."""


@dataclass(frozen=True, eq=False)
class FrameTruth:
    """Objects of a frame, n of them.

    Attributes:
        boxes: (n, 7) as in predictions: middle, sizes, heading.
        ids: (n,) as in annotations.
        points: (n,) points of all cooperating agents' LiDARs on it.
        is_counted: (n,) whether it has to be found. The others are ignored: to find them is neither
            right nor wrong.
    """

    boxes: Float64Array
    ids: NDArray[np.int64]
    points: NDArray[np.int64]
    is_counted: NDArray[np.bool_]


def load_frame_truth(
    frame: FrameView,
    *,
    classes: Collection[str] = VEHICLES,
    communication_range_m: float = COMMUNICATION_RANGE_M,
    range_m: tuple[float, float] = RANGE_M,
    min_points: int = 0,
) -> FrameTruth:
    """Load the annotations of the ego and its cooperating agents.

    Counted are objects of the given classes, completely within the range, with enough points. The
    ego itself, annotated by others, is ignored.

    Args:
        frame: The frame.
        classes: Counted classes.
        communication_range_m: Agents within this distance of the ego cooperate.
        range_m: Half length and half width of the area ahead and to the side of the ego's LiDAR.
        min_points: Least points of a counted object, by all cooperating agents together.
    """
    ego = frame[frame.scenario.ego]
    lidar_from_world = poses.invert_pose(ego.world_from_lidar)
    found: dict[int, tuple[tuple[float, ...], str]] = {}
    points: dict[int, int] = {}
    for view in _list_cooperating(frame, ego, communication_range_m):
        annotated = view.boxes
        for row, number in enumerate(annotated.ids.tolist()):
            points[number] = points.get(number, 0) + int(annotated.lidar_points[row])
            if number not in found:
                pose = lidar_from_world @ annotated.world_from_box[row]
                size = annotated.sizes[row]
                found[number] = (to_box(pose, size), str(annotated.classes[row]))
    # Without a class, in spite of others' annotations: it does not count.
    size = frame.scenario.ego_size
    if size is not None:
        pose = ego.world_from_agent @ poses.pose_matrix((0.0, 0.0, size[2] / 2))
        found[ego.number] = (to_box(lidar_from_world @ pose, np.array(size)), "")
    elif ego.number in found:
        found[ego.number] = (found[ego.number][0], "")
    numbers = list(found)
    boxes = np.reshape([found[number][0] for number in numbers], (-1, 7)).astype(np.float64)
    counts = np.array([points.get(number, 0) for number in numbers], np.int64)
    is_wanted = np.array([found[number][1] in classes for number in numbers], np.bool_)
    ids = np.array(numbers, np.int64)
    is_counted = is_wanted & (counts >= min_points) & is_within(boxes, range_m)
    return FrameTruth(boxes, ids, counts, is_counted)


def _list_cooperating(frame: FrameView, ego: AgentView, range_m: float) -> list[AgentView]:
    place = ego.world_from_lidar[:2, 3]
    others = (view for view in frame.views.values() if view is not ego)
    near = [view for view in others if math.dist(view.world_from_lidar[:2, 3], place) <= range_m]
    return [ego, *near]


def to_box(pose: Matrix, size: Float64Array) -> tuple[float, ...]:
    """Convert the pose (4, 4) of a box's middle and its size (3,) to a row of `boxes`."""
    yaw = math.atan2(pose[1, 0], pose[0, 0])
    return (*pose[:3, 3].tolist(), *size.tolist(), yaw)


def compute_corners(boxes: Float64Array) -> Float64Array:
    """Compute the corners (n, 4, 2) of boxes (n, 7) seen from above, in order around each."""
    unit = np.array([(0.5, 0.5), (-0.5, 0.5), (-0.5, -0.5), (0.5, -0.5)])
    local = unit * boxes[:, None, 3:5]
    cos, sin = np.cos(boxes[:, 6, None]), np.sin(boxes[:, 6, None])
    x = boxes[:, 0, None] + cos * local[..., 0] - sin * local[..., 1]
    y = boxes[:, 1, None] + sin * local[..., 0] + cos * local[..., 1]
    return np.stack([x, y], axis=-1)


def is_within(boxes: Float64Array, range_m: tuple[float, float]) -> NDArray[np.bool_]:
    """Return whether all corners of boxes (n, 7) are within the range, as OpenCOOD asks it."""
    inside: NDArray[np.bool_] = np.abs(compute_corners(boxes)) <= np.array(range_m)
    return np.logical_and.reduce(inside, axis=(1, 2))
