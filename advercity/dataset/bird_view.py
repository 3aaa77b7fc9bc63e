"""Maps of 100 m by 100 m around an agent, as CoBEVT, HEAL and CoAlign read them.

256 pixels square, white on black; row 0 is ahead, the last column to the right. They are centred on
a vehicle's origin, or on a roadside unit's LiDAR, and rotated with its heading.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from advercity.frames import ActorState
from advercity.geometry import poses
from advercity.geometry.arrays import Float64Array, Uint8Array
from advercity.geometry.boxes import BOX_BASE
from advercity.geometry.poses import Matrix
from advercity.roads.lane_segments import LaneSegment
from advercity.sensors.sensor_frame import CameraImage, SensorFrame

PixelPolyline = NDArray[np.int32]
SIZE_PX = 256
METRES_PER_PX = 0.390625
HALF_EXTENT_M = SIZE_PX / 2 * METRES_PER_PX
MIN_VISIBLE_FRACTION = 5e-5
"""Fraction of an image's pixels above which a vehicle counts as visible: 6 pixels of 480 x 270."""
_SHIFT = 4
"""Fractional bits of OpenCV's pixel coordinates."""


def draw_bird_views(
    sensor_frames: Sequence[SensorFrame], lanes: Sequence[LaneSegment]
) -> list[dict[str, Uint8Array]]:
    """Draw the maps (256, 256) of every agent by name, in the order of `sensor_frames`.

    `dynamic` has all other vehicles, `visibility` the vehicles in the agent's images,
    `visibility_corp` the ones in any agent's images, `static` the driving lanes, and `lane`
    crossings and lane borders outside junctions.
    """
    visible = [find_visible_actors(item.camera_images) for item in sensor_frames]
    visible_to_any = frozenset[int]().union(*visible)
    surfaces = _Outlines.from_outlines(_iter_lane_surfaces(lanes))
    lines = _Outlines.from_outlines(_iter_lane_borders(lanes))
    return [
        _draw_masks(item, surfaces, lines, visible=own, visible_to_any=visible_to_any)
        for item, own in zip(sensor_frames, visible, strict=True)
    ]


def find_visible_actors(images: Iterable[CameraImage]) -> frozenset[int]:
    """Find the ids of the actors visible in at least one of the images."""
    return frozenset(
        number
        for image in images
        for number, box in image.projected_boxes.items()
        if box.visible_px > MIN_VISIBLE_FRACTION * image.semantic.size
    )


@dataclass(frozen=True, eq=False)
class _Outlines:
    """Outlines in one array, so one product transforms them all.

    Attributes:
        points: (n, 3) points of all outlines, in the world.
        ends: (outlines,) index of the first point of each outline.
    """

    points: Float64Array
    ends: NDArray[np.intp]

    @staticmethod
    def from_outlines(shapes: Iterable[Float64Array]) -> "_Outlines":
        # The empty first one lets `concatenate` work without any outline.
        every = [np.empty((0, 3)), *shapes]
        return _Outlines(np.concatenate(every), np.cumsum([len(shape) for shape in every])[:-1])

    def to_pixels(self, map_from_world: Matrix) -> list[PixelPolyline]:
        """Convert outlines to columns and rows (n, 2), in 1/16 px from the middle of pixel 0."""
        x, y, _ = poses.transform_points(map_from_world, self.points).T
        # OpenCV counts from the middle of pixel 0, the map from its edge.
        column = SIZE_PX / 2 - y / METRES_PER_PX - 0.5
        row = SIZE_PX / 2 - x / METRES_PER_PX - 0.5
        pixels = np.rint(np.stack([column, row], axis=1) * 2**_SHIFT).astype(np.int32)
        return np.split(pixels, self.ends)[1:]


def _draw_masks(
    sensor_frame: SensorFrame,
    surfaces: _Outlines,
    lines: _Outlines,
    *,
    visible: frozenset[int],
    visible_to_any: frozenset[int],
) -> dict[str, Uint8Array]:
    map_from_world = _compute_map_from_world(sensor_frame)
    vehicles = _find_vehicles_in_extent(sensor_frame, map_from_world)
    outlines = _Outlines.from_outlines(map(_compute_footprint, vehicles))
    footprints = outlines.to_pixels(map_from_world)
    by_id = list(zip((state.actor.id for state in vehicles), footprints, strict=True))
    static = _fill_polygons(surfaces.to_pixels(map_from_world))
    return {
        "dynamic": _fill_polygons(footprints),
        "static": static,
        # Clipped to the lanes: the pixels of a line are on both sides of the border.
        "lane": _draw_polylines(lines.to_pixels(map_from_world)) & static,
        "visibility": _fill_polygons(corners for number, corners in by_id if number in visible),
        "visibility_corp": _fill_polygons(
            corners for number, corners in by_id if number in visible_to_any
        ),
    }


def _compute_map_from_world(sensor_frame: SensorFrame) -> Matrix:
    """Compute the level frame (4, 4) of a map: x ahead, y left, metres."""
    is_unit = sensor_frame.agent.place.kind == "roadside_unit"
    centre = sensor_frame.world_from_reference if is_unit else sensor_frame.world_from_agent
    return poses.invert_pose(
        poses.pose_matrix(centre[:3, 3], yaw=poses.to_yaw_pitch_roll(centre)[0])
    )


def _find_vehicles_in_extent(sensor_frame: SensorFrame, map_from_world: Matrix) -> list[ActorState]:
    others = [
        state
        for state in sensor_frame.frame.states
        if state.actor.actor_class != "pedestrian" and state.actor.id != sensor_frame.agent.number
    ]
    origins = np.reshape([state.world_from_body[:3, 3] for state in others], (-1, 3))
    distances_m = np.abs(poses.transform_points(map_from_world, origins)[:, :2]).max(axis=1)
    return [state for state, far in zip(others, distances_m, strict=True) if far < HALF_EXTENT_M]


def _compute_footprint(state: ActorState) -> Float64Array:
    return poses.transform_points(state.world_from_body, state.box.corners[BOX_BASE])


def _iter_lane_surfaces(lanes: Sequence[LaneSegment]) -> Iterable[Float64Array]:
    return (_compute_lane_outline(lane) for lane in lanes if lane.kind == "driving")


def _compute_lane_outline(lane: LaneSegment) -> Float64Array:
    return np.concatenate([lane.left, lane.right[::-1]])


def _iter_lane_borders(lanes: Sequence[LaneSegment]) -> Iterable[Float64Array]:
    for lane in lanes:
        if lane.kind == "driving" and not lane.in_junction:
            yield lane.left
            yield lane.right
        elif lane.kind == "crossing":
            outline = _compute_lane_outline(lane)
            yield np.concatenate([outline, outline[:1]])


def _fill_polygons(shapes: Iterable[PixelPolyline]) -> Uint8Array:
    return _paint_mask(shapes, lambda image, shape: cv2.fillPoly(image, [shape], 255, shift=_SHIFT))


def _draw_polylines(lines: Iterable[PixelPolyline]) -> Uint8Array:
    return _paint_mask(
        lines, lambda image, line: cv2.polylines(image, [line], False, 255, shift=_SHIFT)
    )


def _paint_mask(
    shapes: Iterable[PixelPolyline], paint: Callable[[Uint8Array, PixelPolyline], Any]
) -> Uint8Array:
    image = np.zeros((SIZE_PX, SIZE_PX), np.uint8)
    for shape in shapes:
        paint(image, shape)
    return image
