"""Samples for the network: clouds or images of a frame, and their boxes."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator

from advercity.dataset.reader import FrameView
from advercity.geometry import poses
from advercity.geometry.arrays import Float32Array, Float64Array
from advercity.geometry.poses import Matrix
from advercity_benchmark.detector.boxes import Area, draw_targets
from advercity_benchmark.detector.clouds import Fusion, StationCloud, load_cloud, load_clouds
from advercity_benchmark.detector.images import CAMERA_AREA, StationImages, load_images
from advercity_benchmark.truth import RANGE_M, VEHICLES, load_frame_truth, to_box

EGO_AREA: Area = RANGE_M
"""Evaluated area: 140 m ahead and behind, 40 m to the sides."""
STATION_AREA: Area = (72.0, 72.0)
"""Area of others' detections: wherever the ego is in range, and however they face."""
TRAINING_AREA: Area = (100.0, 40.0)
"""Area of training, for any station: farther away, there is little to learn from."""
MIN_POINTS = 3
"""Least points of an object; objects with fewer are neither right nor wrong."""
MIN_VISIBLE = 0.2
"""Least visible part in one camera of an object learned from images."""
MAX_TURN_RAD = 0.3
"""Largest turn of a vehicle's view, which is along its street; a unit on a pole looks in any
direction."""


@dataclass(frozen=True, eq=False)
class Sample:
    """Input of the network, and its targets.

    Attributes:
        recorded: Points (n, 4), or images, of each station encoded by itself.
        poses: (4, 4) from each of them to the first.
        areas: Area of each.
        heat, learned, weights: Results of `draw_targets`, for the first.
    """

    recorded: Sequence[Float32Array | StationImages]
    poses: list[Matrix]
    areas: list[Area]
    heat: Float32Array
    learned: Float32Array
    weights: Float32Array


def make_sample(
    frame: FrameView,
    fusion: Fusion,
    rng: Generator,
    *,
    is_ideal: bool = False,
    has_cameras: bool = False,
) -> Sample:
    """Make a sample of a frame, turned and mirrored at random.

    Without fusion it is of any of the frame's stations, since all of them can learn.
    """
    if fusion == "none":
        views = list(frame.views.values())
        cloud = load_cloud(views[int(rng.integers(len(views)))])
        truth = _load_station_truth(cloud, has_cameras=has_cameras)
        return _draw_sample([cloud], *truth, rng, has_cameras=has_cameras)
    clouds = load_clouds(frame, fusion, is_ideal=is_ideal)
    truth = load_frame_truth(frame)
    is_learned = truth.is_counted & (truth.points >= MIN_POINTS)
    boxes = truth.boxes - np.array([0.0, 0.0, clouds[0].ground_m, 0.0, 0.0, 0.0, 0.0])
    if fusion == "early":
        clouds = [merge_clouds(clouds)]
    return _draw_sample(clouds, boxes[is_learned], boxes[~is_learned], rng)


def merge_clouds(clouds: list[StationCloud]) -> StationCloud:
    """Merge clouds into one in the frame of the first."""
    moved = [clouds[0].points]
    for cloud in clouds[1:]:
        places = poses.transform_points(cloud.ego_from_station, cloud.points[:, :3])
        moved.append(np.column_stack([places, cloud.points[:, 3]]).astype(np.float32))
    first = clouds[0]
    return StationCloud(first.view, np.concatenate(moved), first.ground_m, first.ego_from_station)


def _load_station_truth(
    cloud: StationCloud, *, has_cameras: bool
) -> tuple[Float64Array, Float64Array]:
    """Load the annotations of a station: boxes (n, 7) to learn, and to ignore."""
    annotated = cloud.view.boxes
    pose = cloud.view.world_from_lidar @ poses.pose_matrix((0.0, 0.0, cloud.ground_m))
    station_from_boxes = poses.invert_pose(pose) @ annotated.world_from_box
    rows = [
        to_box(one, size) for one, size in zip(station_from_boxes, annotated.sizes, strict=True)
    ]
    boxes = np.array(rows).reshape(-1, 7)
    is_seen = annotated.lidar_points >= MIN_POINTS
    if has_cameras:
        is_seen = annotated.visible_fraction >= MIN_VISIBLE
    is_learned = np.isin(annotated.classes, VEHICLES) & is_seen
    return boxes[is_learned], boxes[~is_learned]


def _draw_sample(
    clouds: list[StationCloud],
    boxes: Float64Array,
    ignored: Float64Array,
    rng: Generator,
    *,
    has_cameras: bool = False,
) -> Sample:
    first_area = CAMERA_AREA if has_cameras else TRAINING_AREA
    areas = [first_area, *[STATION_AREA] * (len(clouds) - 1)]
    most = np.pi if clouds[0].view.agent.place.kind == "roadside_unit" else MAX_TURN_RAD
    turn = poses.pose_matrix((0.0, 0.0, 0.0), yaw=float(rng.uniform(-most, most)))
    mirror = np.diag([1.0, rng.choice([-1.0, 1.0]), 1.0, 1.0])
    found = [mirror @ turn @ cloud.ego_from_station @ mirror for cloud in clouds]
    targets = draw_targets(
        _move_boxes(boxes, turn, mirror), _move_boxes(ignored, turn, mirror), areas[0]
    )
    recorded: Sequence[Float32Array | StationImages]
    if has_cameras:
        recorded = [load_images(clouds[0], mirror @ turn)]
    else:
        recorded = _move_points(clouds, turn, mirror)
    return Sample(recorded, [np.eye(4), *found[1:]], areas, *targets)


def _move_points(clouds: list[StationCloud], turn: Matrix, mirror: Matrix) -> list[Float32Array]:
    points = [cloud.points.copy() for cloud in clouds]
    points[0][:, :3] = poses.transform_points(turn, points[0][:, :3])
    for one in points:
        one[:, 1] *= mirror[1, 1]
    return points


def _move_boxes(boxes: Float64Array, turn: Matrix, mirror: Matrix) -> Float64Array:
    moved = boxes.copy()
    moved[:, :3] = poses.transform_points(mirror @ turn, boxes[:, :3])
    angle = poses.to_yaw_pitch_roll(turn)[0]
    moved[:, 6] = mirror[1, 1] * (boxes[:, 6] + angle)
    return moved
