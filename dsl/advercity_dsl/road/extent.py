"""Limits on the size of a road's site, beyond which its world would take hours to build."""

import math
from collections.abc import Iterable, Iterator
from itertools import pairwise

from advercity_dsl.base import InvalidCombination, ValuePath
from advercity_dsl.road.streets import AxisArc, AxisLine, Street
from advercity_dsl.road.surroundings import Surrounding
from advercity_dsl.units import Point2

MAX_SITE_M = 10_000.0
MAX_STREETS_M = 50_000.0
LocatedPoint = tuple[ValuePath, Point2]


def check_extent(points: Iterable[LocatedPoint]) -> None:
    """Check the extent of a site; InvalidCombination if places are too far apart."""
    located = list(points)
    for axis, name in ((0, "east to west"), (1, "north to south")):
        ordered = sorted(located, key=lambda item: item[1][axis])
        if not ordered or ordered[-1][1][axis] - ordered[0][1][axis] <= MAX_SITE_M:
            continue
        middle = ordered[len(ordered) // 2][1][axis]
        # The point apart from most others is the likely error.
        apart = max((ordered[0], ordered[-1]), key=lambda item: abs(item[1][axis] - middle))
        distance_m = ordered[-1][1][axis] - ordered[0][1][axis]
        message = f"makes the site {distance_m:.0f} m wide from {name}"
        raise InvalidCombination(apart[0], message, f"the limit is {MAX_SITE_M:g} m")


def check_street_lengths(streets: Iterable[tuple[str, Street]]) -> None:
    """Check the length of all streets together; InvalidCombination if they are too long."""
    total_m = 0.0
    for name, street in streets:
        total_m += _compute_length(street)
        if total_m > MAX_STREETS_M:
            message = f"the streets up to '{name}' are {total_m:.0f} m long"
            hint = f"the limit is {MAX_STREETS_M:g} m"
            raise InvalidCombination(("streets", name, "path"), message, hint)


def _compute_length(street: Street) -> float:
    length_m, end = 0.0, street.start_m
    for piece in street.path:
        if isinstance(piece, AxisLine):
            length_m += piece.line_m
        elif isinstance(piece, AxisArc):
            length_m += piece.arc_m
        else:
            points = [end, *piece.points_m]
            length_m += sum(math.dist(first, second) for first, second in pairwise(points))
            end = points[-1]
    return length_m


def iterate_street_points(name: str, street: Street) -> Iterator[LocatedPoint]:
    """Yield the points of a street with coordinates."""
    yield ("streets", name, "start_m"), street.start_m
    for index, piece in enumerate(street.path):
        if not isinstance(piece, AxisLine | AxisArc):
            yield from ((("streets", name, "path", index), point) for point in piece.points_m)


def iterate_surrounding_points(index: int, item: Surrounding) -> Iterator[LocatedPoint]:
    """Yield the points of the surroundings with coordinates."""
    for field in ("area_m", "line_m", "at_m"):
        points: tuple[Point2, ...] = getattr(item, field) or ()
        yield from ((("surroundings", index, field), point) for point in points)
