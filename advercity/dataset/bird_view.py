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

from advercity import poses
from advercity.dataset.reading import Picture, Reading
from advercity.dataset.sightings import box_corners
from advercity.poses import Matrix
from advercity.traffic.trace import ActorState
from advercity.world.scene import Lane

SIZE_PX = 256
METRES_PER_PX = 0.390625
REACH_M = SIZE_PX / 2 * METRES_PER_PX
SEEN_SHARE = 5e-5
"""Of a picture's pixels that must show a vehicle for it to count as seen: 6 of 480 x 270."""
_SHIFT = 4
_GROUND = [0, 2, 6, 4]
"""Corners of a box that stand on the ground, in order around it."""

Map = NDArray[np.uint8]


def bird_views(readings: Sequence[Reading], lanes: Sequence[Lane]) -> list[dict[str, Map]]:
    """The maps (256, 256) of every viewpoint, by name, in the order of `readings`.

    `dynamic` holds all other vehicles, `visibility` those that this viewpoint's cameras see,
    `visibility_corp` those that any viewpoint's cameras see, `static` the driving lanes, and
    `lane` their borders outside junctions, and crossings.
    """
    seen = [seen_by_cameras(reading.pictures) for reading in readings]
    seen_by_any = frozenset[int]().union(*seen)
    surfaces, lines = _Shapes.of(_surfaces(lanes)), _Shapes.of(_lines(lanes))
    return [
        _maps(reading, surfaces, lines, seen=own, seen_by_any=seen_by_any)
        for reading, own in zip(readings, seen, strict=True)
    ]


def seen_by_cameras(pictures: Iterable[Picture]) -> frozenset[int]:
    """Ids of the actors that show in at least one of some pictures."""
    return frozenset(
        number
        for picture in pictures
        for number, sighting in picture.sightings.items()
        if sighting.visible_px > SEEN_SHARE * picture.semantic.size
    )


@dataclass(frozen=True, eq=False)
class _Shapes:
    """Outlines that are moved together.

    Attributes:
        points: (n, 3) of all of them, in the world.
        ends: (shapes - 1,) where the next begins.
    """

    points: NDArray[np.float64]
    ends: NDArray[np.intp]

    @staticmethod
    def of(shapes: Iterable[NDArray[np.float64]]) -> "_Shapes":
        every = [np.empty((0, 3)), *shapes]
        return _Shapes(np.concatenate(every), np.cumsum([len(shape) for shape in every])[:-1])

    def pixels(self, map_from_world: Matrix) -> list[NDArray[np.int32]]:
        """Column and row (n, 2) of each, in sixteenths from the middle of pixel 0."""
        x, y, _ = poses.transform(map_from_world, self.points).T
        column = SIZE_PX / 2 - y / METRES_PER_PX - 0.5
        row = SIZE_PX / 2 - x / METRES_PER_PX - 0.5
        places = np.rint(np.stack([column, row], axis=1) * 2**_SHIFT).astype(np.int32)
        return np.split(places, self.ends)[1:]


def _maps(
    reading: Reading,
    surfaces: _Shapes,
    lines: _Shapes,
    *,
    seen: frozenset[int],
    seen_by_any: frozenset[int],
) -> dict[str, Map]:
    map_from_world = _map_from_world(reading)
    vehicles = _other_vehicles_near(reading, map_from_world)
    footprints = _Shapes.of(map(_footprint, vehicles)).pixels(map_from_world)
    near = list(zip((state.actor.id for state in vehicles), footprints, strict=True))
    static = _filled(surfaces.pixels(map_from_world))
    return {
        "dynamic": _filled(footprints),
        "static": static,
        "lane": _drawn(lines.pixels(map_from_world)) & static,
        "visibility": _filled(corners for number, corners in near if number in seen),
        "visibility_corp": _filled(corners for number, corners in near if number in seen_by_any),
    }


def _map_from_world(reading: Reading) -> Matrix:
    """Level frame (4, 4) that a map is drawn in: x ahead, y left, metres."""
    is_unit = reading.agent.place.kind == "roadside_unit"
    centre = reading.world_from_lidar if is_unit else reading.world_from_agent
    return poses.inverse(poses.pose(centre[:3, 3], yaw=poses.angles(centre)[0]))


def _other_vehicles_near(reading: Reading, map_from_world: Matrix) -> list[ActorState]:
    others = [
        state
        for state in reading.frame.states
        if state.actor.actor_class != "pedestrian" and state.actor.id != reading.agent.number
    ]
    origins = np.reshape([state.world_from_body[:3, 3] for state in others], (-1, 3))
    reach_m = np.abs(poses.transform(map_from_world, origins)[:, :2]).max(axis=1)
    return [state for state, far_m in zip(others, reach_m, strict=True) if far_m < REACH_M]


def _footprint(state: ActorState) -> NDArray[np.float64]:
    return poses.transform(state.world_from_body, box_corners(state.actor.size)[_GROUND])


def _surfaces(lanes: Sequence[Lane]) -> Iterable[NDArray[np.float64]]:
    return (_outline(lane) for lane in lanes if lane.kind == "driving")


def _outline(lane: Lane) -> NDArray[np.float64]:
    return np.concatenate([lane.left, lane.right[::-1]])


def _lines(lanes: Sequence[Lane]) -> Iterable[NDArray[np.float64]]:
    for lane in lanes:
        if lane.kind == "driving" and not lane.in_junction:
            yield lane.left
            yield lane.right
        elif lane.kind == "crossing":
            outline = _outline(lane)
            yield np.concatenate([outline, outline[:1]])


def _filled(shapes: Iterable[NDArray[np.int32]]) -> Map:
    return _painted(shapes, lambda image, shape: cv2.fillPoly(image, [shape], 255, shift=_SHIFT))


def _drawn(lines: Iterable[NDArray[np.int32]]) -> Map:
    return _painted(
        lines, lambda image, line: cv2.polylines(image, [line], False, 255, shift=_SHIFT)
    )


def _painted(
    shapes: Iterable[NDArray[np.int32]], paint: Callable[[Map, NDArray[np.int32]], Any]
) -> Map:
    image = np.zeros((SIZE_PX, SIZE_PX), np.uint8)
    for shape in shapes:
        paint(image, shape)
    return image
