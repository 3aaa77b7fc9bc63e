"""Maps of 100 m by 100 m around a viewpoint, as CoBEVT, HEAL and CoAlign read them.

256 pixels square, white on black; row 0 is ahead, the last column to the right. They are centred on
a vehicle's origin, or on a roadside unit's LiDAR, and turned as that is.
"""

from collections.abc import Callable, Iterable, Sequence
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
    return [
        _maps(reading, lanes, seen=own, seen_by_any=seen_by_any)
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


def _maps(
    reading: Reading, lanes: Sequence[Lane], *, seen: frozenset[int], seen_by_any: frozenset[int]
) -> dict[str, Map]:
    map_from_world = _map_from_world(reading)
    near = [
        (state.actor.id, _footprint(map_from_world, state))
        for state in reading.frame.states
        if _is_another_vehicle_near(state, reading, map_from_world)
    ]
    static = _filled(_surface(map_from_world, lane) for lane in lanes if lane.kind == "driving")
    return {
        "dynamic": _filled(corners for _, corners in near),
        "static": static,
        "lane": _drawn(_lines(map_from_world, lanes)) & static,
        "visibility": _filled(corners for number, corners in near if number in seen),
        "visibility_corp": _filled(corners for number, corners in near if number in seen_by_any),
    }


def _map_from_world(reading: Reading) -> Matrix:
    """Level frame (4, 4) that a map is drawn in: x ahead, y left, metres."""
    is_unit = reading.agent.place.kind == "roadside_unit"
    centre = reading.world_from_lidar if is_unit else reading.world_from_agent
    return poses.inverse(poses.pose(centre[:3, 3], yaw=poses.angles(centre)[0]))


def _is_another_vehicle_near(state: ActorState, reading: Reading, map_from_world: Matrix) -> bool:
    place = poses.transform(map_from_world, state.world_from_body[:3, 3])
    return (
        state.actor.actor_class != "pedestrian"
        and state.actor.id != reading.agent.number
        and bool(np.abs(place[:2]).max() < REACH_M)
    )


def _footprint(map_from_world: Matrix, state: ActorState) -> NDArray[np.int32]:
    corners = box_corners(state.actor.size)[_GROUND]
    return _pixels(poses.transform(map_from_world @ state.world_from_body, corners))


def _surface(map_from_world: Matrix, lane: Lane) -> NDArray[np.int32]:
    return _pixels(poses.transform(map_from_world, np.concatenate([lane.left, lane.right[::-1]])))


def _lines(map_from_world: Matrix, lanes: Sequence[Lane]) -> Iterable[NDArray[np.int32]]:
    for lane in lanes:
        if lane.kind == "driving" and not lane.in_junction:
            yield _pixels(poses.transform(map_from_world, lane.left))
            yield _pixels(poses.transform(map_from_world, lane.right))
        elif lane.kind == "crossing":
            outline = _surface(map_from_world, lane)
            yield np.concatenate([outline, outline[:1]])


def _pixels(points: NDArray[np.float64]) -> NDArray[np.int32]:
    """Points (n, 3) as column and row (n, 2), in sixteenths from the middle of pixel 0."""
    column = SIZE_PX / 2 - points[:, 1] / METRES_PER_PX - 0.5
    row = SIZE_PX / 2 - points[:, 0] / METRES_PER_PX - 0.5
    return np.rint(np.stack([column, row], axis=1) * 2**_SHIFT).astype(np.int32)


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
