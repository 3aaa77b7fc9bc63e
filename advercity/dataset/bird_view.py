"""Maps of 100 m by 100 m around a viewpoint, as CoBEVT, HEAL and CoAlign read them.

256 pixels square, white on black; row 0 is ahead, the last column to the right. They are centred on
a vehicle's origin, or on a roadside unit's LiDAR, and turned as that is.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from advercity.frames import ActorState
from advercity.geometry import poses
from advercity.geometry.arrays import Uint8Array
from advercity.geometry.boxes import compute_box_corners
from advercity.geometry.poses import Matrix
from advercity.roads.lane_segments import LaneSegment
from advercity.sensors.sensor_frame import CameraImage, SensorFrame

SIZE_PX = 256
METRES_PER_PX = 0.390625
HALF_EXTENT_M = SIZE_PX / 2 * METRES_PER_PX
MIN_VISIBLE_FRACTION = 5e-5
"""Of a picture's pixels that must show a vehicle for it to count as seen: 6 of 480 x 270."""
_SHIFT = 4
_BASE_CORNERS = [0, 2, 6, 4]
"""Corners of a box that stand on the ground, in order around it."""


def draw_bird_views(
    sensor_frames: Sequence[SensorFrame], lanes: Sequence[LaneSegment]
) -> list[dict[str, Uint8Array]]:
    """The maps (256, 256) of every viewpoint, by name, in the order of `readings`.

    `dynamic` holds all other vehicles, `visibility` those that this viewpoint's cameras see,
    `visibility_corp` those that any viewpoint's cameras see, `static` the driving lanes, and
    `lane` their borders outside junctions, and crossings.
    """
    seen = [find_visible_actors(reading.camera_images) for reading in sensor_frames]
    seen_by_any = frozenset[int]().union(*seen)
    surfaces, lines = (
        _Outlines.from_outlines(_iter_lane_surfaces(lanes)),
        _Outlines.from_outlines(_iter_lane_borders(lanes)),
    )
    return [
        _draw_masks(reading, surfaces, lines, seen=own, seen_by_any=seen_by_any)
        for reading, own in zip(sensor_frames, seen, strict=True)
    ]


def find_visible_actors(images: Iterable[CameraImage]) -> frozenset[int]:
    """Ids of the actors that show in at least one of some pictures."""
    return frozenset(
        number
        for picture in images
        for number, sighting in picture.projected_boxes.items()
        if sighting.visible_px > MIN_VISIBLE_FRACTION * picture.semantic.size
    )


@dataclass(frozen=True, eq=False)
class _Outlines:
    """Outlines that are moved together.

    Attributes:
        points: (n, 3) of all of them, in the world.
        ends: (shapes - 1,) where the next begins.
    """

    points: NDArray[np.float64]
    ends: NDArray[np.intp]

    @staticmethod
    def from_outlines(shapes: Iterable[NDArray[np.float64]]) -> "_Outlines":
        every = [np.empty((0, 3)), *shapes]
        return _Outlines(np.concatenate(every), np.cumsum([len(shape) for shape in every])[:-1])

    def to_pixels(self, map_from_world: Matrix) -> list[NDArray[np.int32]]:
        """Column and row (n, 2) of each, in sixteenths from the middle of pixel 0."""
        x, y, _ = poses.transform_points(map_from_world, self.points).T
        column = SIZE_PX / 2 - y / METRES_PER_PX - 0.5
        row = SIZE_PX / 2 - x / METRES_PER_PX - 0.5
        places = np.rint(np.stack([column, row], axis=1) * 2**_SHIFT).astype(np.int32)
        return np.split(places, self.ends)[1:]


def _draw_masks(
    reading: SensorFrame,
    surfaces: _Outlines,
    lines: _Outlines,
    *,
    seen: frozenset[int],
    seen_by_any: frozenset[int],
) -> dict[str, Uint8Array]:
    map_from_world = _compute_map_from_world(reading)
    vehicles = _find_vehicles_in_extent(reading, map_from_world)
    footprints = _Outlines.from_outlines(map(_compute_footprint, vehicles)).to_pixels(
        map_from_world
    )
    near = list(zip((state.actor.id for state in vehicles), footprints, strict=True))
    static = _fill_polygons(surfaces.to_pixels(map_from_world))
    return {
        "dynamic": _fill_polygons(footprints),
        "static": static,
        "lane": _draw_polylines(lines.to_pixels(map_from_world)) & static,
        "visibility": _fill_polygons(corners for number, corners in near if number in seen),
        "visibility_corp": _fill_polygons(
            corners for number, corners in near if number in seen_by_any
        ),
    }


def _compute_map_from_world(reading: SensorFrame) -> Matrix:
    """Level frame (4, 4) that a map is drawn in: x ahead, y left, metres."""
    is_unit = reading.agent.place.kind == "roadside_unit"
    centre = reading.world_from_lidar if is_unit else reading.world_from_agent
    return poses.invert_pose(
        poses.pose_matrix(centre[:3, 3], yaw=poses.to_yaw_pitch_roll(centre)[0])
    )


def _find_vehicles_in_extent(reading: SensorFrame, map_from_world: Matrix) -> list[ActorState]:
    others = [
        state
        for state in reading.frame.states
        if state.actor.actor_class != "pedestrian" and state.actor.id != reading.agent.number
    ]
    origins = np.reshape([state.world_from_body[:3, 3] for state in others], (-1, 3))
    reach_m = np.abs(poses.transform_points(map_from_world, origins)[:, :2]).max(axis=1)
    return [state for state, far_m in zip(others, reach_m, strict=True) if far_m < HALF_EXTENT_M]


def _compute_footprint(state: ActorState) -> NDArray[np.float64]:
    return poses.transform_points(
        state.world_from_body, compute_box_corners(state.actor.size)[_BASE_CORNERS]
    )


def _iter_lane_surfaces(lanes: Sequence[LaneSegment]) -> Iterable[NDArray[np.float64]]:
    return (_lane_outline(lane) for lane in lanes if lane.kind == "driving")


def _lane_outline(lane: LaneSegment) -> NDArray[np.float64]:
    return np.concatenate([lane.left, lane.right[::-1]])


def _iter_lane_borders(lanes: Sequence[LaneSegment]) -> Iterable[NDArray[np.float64]]:
    for lane in lanes:
        if lane.kind == "driving" and not lane.in_junction:
            yield lane.left
            yield lane.right
        elif lane.kind == "crossing":
            outline = _lane_outline(lane)
            yield np.concatenate([outline, outline[:1]])


def _fill_polygons(shapes: Iterable[NDArray[np.int32]]) -> Uint8Array:
    return _paint_mask(shapes, lambda image, shape: cv2.fillPoly(image, [shape], 255, shift=_SHIFT))


def _draw_polylines(lines: Iterable[NDArray[np.int32]]) -> Uint8Array:
    return _paint_mask(
        lines, lambda image, line: cv2.polylines(image, [line], False, 255, shift=_SHIFT)
    )


def _paint_mask(
    shapes: Iterable[NDArray[np.int32]], paint: Callable[[Uint8Array, NDArray[np.int32]], Any]
) -> Uint8Array:
    image = np.zeros((SIZE_PX, SIZE_PX), np.uint8)
    for shape in shapes:
        paint(image, shape)
    return image
