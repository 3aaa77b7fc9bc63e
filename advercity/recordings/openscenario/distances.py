"""Distances between entities, as conditions measure them."""

import math
from dataclasses import dataclass
from xml.etree.ElementTree import Element

import numpy as np
import shapely
from numpy.typing import NDArray

from advercity.recordings.openscenario.document import Scope
from advercity.recordings.openscenario.road_map import (
    LanePlace,
    RoadMap,
    choose_straightest,
)
from advercity.recordings.openscenario.stage import Mover, Pose, Stage

Complex = NDArray[np.complex128]
"""Points, east + i north in m."""
EUCLIDEAN = ("euclidianDistance", "cartesianDistance")
MAX_AHEAD_M = 1000.0
STEP_M = 5.0


@dataclass(frozen=True)
class DistanceKind:
    """Frame and direction of a distance, and whether it is between boxes."""

    frame: str
    direction: str
    is_free: bool


def parse_distance_kind(scope: Scope, element: Element) -> DistanceKind:
    """Parse the common attributes of conditions on distances, of versions 1.0 to 1.3."""
    is_along_route = scope.get_flag(element, "alongRoute")
    default = "longitudinal" if is_along_route or element.tag.startswith("Time") else EUCLIDEAN[0]
    frame = scope.get(element, "coordinateSystem", "road" if is_along_route else "entity")
    direction = scope.get(element, "relativeDistanceType", default)
    if frame not in ("entity", "road", "lane") or direction not in (
        "longitudinal",
        "lateral",
        *EUCLIDEAN,
    ):
        scope.refuse(element, f"a distance by '{frame[:20]}' and '{direction[:20]}' is not read")
    return DistanceKind(frame, direction, scope.get_flag(element, "freespace"))


def measure_distance(
    stage: Stage,
    scope: Scope,
    element: Element,
    kind: DistanceKind,
    mover: Mover,
    goal: Pose,
    other: Mover | None,
) -> float:
    """Measure the distance from an entity to a place, or to another entity there.

    Returns:
        Metres; ahead and to the left are above 0, unless the distance is Euclidean. NaN if no road
        leads from one to the other.
    """
    assert mover.pose is not None
    own = (
        _list_corners(mover, mover.pose)
        if kind.is_free
        else np.array([mover.pose.point], dtype=np.complex128)
    )
    theirs = np.array([goal.point], dtype=np.complex128)
    if kind.is_free and other is not None:
        theirs = _list_corners(other, goal)
    if kind.direction in EUCLIDEAN:
        return float(_build_shape(own).convex_hull.distance(_build_shape(theirs).convex_hull))
    if kind.frame == "entity":
        turn = complex(np.exp(-1j * mover.pose.heading))
        return _measure_gap(
            (own - mover.pose.point) * turn, (theirs - mover.pose.point) * turn, kind
        )
    place, target = stage.find_lane(mover.pose), stage.find_lane(goal)
    roads = stage.open_map()
    if roads is None or place is None or target is None:
        message = f"'{mover.entity.name}' or its target is on no road at {stage.time_s:g} s"
        stage.fail(scope, element, message)
    ahead_m = _measure_along(roads, place, target)
    if ahead_m is None:
        return math.nan
    aside_m = roads.find_left(target) - roads.find_left(place)
    turn = complex(np.exp(-1j * mover.pose.heading))
    their_turn = turn if other is None else complex(np.exp(-1j * goal.heading))
    shift = complex(ahead_m, aside_m * place.along)
    facing = 1 if math.cos(goal.heading - mover.pose.heading) >= 0 else -1
    return _measure_gap(
        (own - mover.pose.point) * turn, shift + facing * (theirs - goal.point) * their_turn, kind
    )


def _list_corners(mover: Mover, pose: Pose) -> Complex:
    length_m, width_m, _ = mover.entity.size
    corners: Complex = np.array([1 + 1j, 1 - 1j, -1 - 1j, -1 + 1j], dtype=np.complex128)
    local = mover.entity.centre + (corners.real * length_m + 1j * corners.imag * width_m) / 2
    return pose.point + local * np.exp(1j * pose.heading)


def _build_shape(points: Complex) -> shapely.MultiPoint:
    return shapely.MultiPoint(np.column_stack([points.real, points.imag]))


def _measure_gap(own: Complex, theirs: Complex, kind: DistanceKind) -> float:
    """Measure the gap between the nearest points of both, 0 where they overlap."""
    mine, other = (
        (own.real, theirs.real) if kind.direction == "longitudinal" else (own.imag, theirs.imag)
    )
    if other.min() >= mine.max():
        return float(other.min() - mine.max())
    if mine.min() >= other.max():
        return float(other.max() - mine.min())
    return 0.0


def _measure_along(roads: RoadMap, place: LanePlace, target: LanePlace) -> float | None:
    """Measure stations from a place to another one, ahead above 0; None if no lane leads there."""
    if place.road == target.road:
        return (target.station_m - place.station_m) * place.along
    for sign in (1, -1):
        at = place._replace(along=place.along * sign)
        covered_m = 0.0
        while covered_m < MAX_AHEAD_M:
            followed = roads.shift(at, STEP_M, choose_straightest(roads, at))
            if followed is None:
                break
            at, covered_m = followed, covered_m + STEP_M
            if at.road == target.road:
                return sign * (covered_m + (target.station_m - at.station_m) * at.along)
    return None
