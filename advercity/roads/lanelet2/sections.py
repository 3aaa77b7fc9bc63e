"""Cross-sections of lanelets side by side, and pieces of them with paired borders."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from advercity.geometry.polyline import (
    Points,
    StationedPolyline,
    polyline_length,
    simplify_together,
)
from advercity.roads.lanelet2.lanelets import Bound, Lanelet
from advercity.roads.plain_edges import PlainLane

STEP_M = 1.0
"""Largest distance between paired points of bounds."""
MIN_STEP_M = 1e-3
"""Closer points of a bound have no direction."""
MAX_PAIRS = 1_000_000
"""Most pairs of points compared at once; longer lanelets are cut for it."""
MAX_ERROR_M = 0.01
"""Largest distance between a bound and the border made of it."""


@dataclass(frozen=True, eq=False)
class CrossSection:
    """Lanelets side by side in one direction, from left to right."""

    lanelets: tuple[Lanelet, ...]

    @property
    def length_m(self) -> float:
        """Mean length of its bounds."""
        bounds = (bound for lane in self.lanelets for bound in (lane.left, lane.right))
        return float(np.mean([polyline_length(bound.points) for bound in bounds]))

    def cut(self, begins: float, ends: float) -> tuple[PlainLane, ...]:
        """Cut its lanes, from the right, at fractions of the lengths of its bounds."""
        return tuple(_cut_lane(lane, begins, ends) for lane in self.lanelets[::-1])


def join_sections(lanelets: Iterable[Lanelet]) -> list[CrossSection]:
    """Join driven lanelets, and neighbours for cyclists and walkers, by shared bounds."""
    driven = [item for item in lanelets if item.is_driven]
    others = [it for item in lanelets if not item.is_driven for it in (item, item.reverse)]
    at_left = _index(driven + others, lambda item: item.left)
    at_right = _index(driven + others, lambda item: item.right)
    sections: list[CrossSection] = []
    seen: set[int] = set()
    for first in driven:
        if id(first) in seen:
            continue
        row = [first, *_follow(first, at_left, lambda item: item.right)]
        row = [*reversed([*_follow(first, at_right, lambda item: item.left)]), *row]
        # SUMO has sidewalks at the right of a street only.
        while row[0].use.is_walked:
            row.pop(0)
        seen |= {id(item) for item in row}
        sections.append(CrossSection(tuple(row)))
    return sections


def join_lanes(lanes: Sequence[PlainLane]) -> PlainLane:
    """Join lanes in a row; the points where two meet are in both."""
    lines = [[lane.left for lane in lanes], [lane.right for lane in lanes]]
    left, right = (np.concatenate([one[0], *(line[1:] for line in one[1:])]) for one in lines)
    return PlainLane(lanes[0].use, lanes[0].speed_m_s, left, right)


def _index(
    lanelets: Iterable[Lanelet], get_bound: Callable[[Lanelet], Bound]
) -> dict[tuple[str, ...], Lanelet]:
    """Index lanelets by a bound; of several with the same, the first."""
    found: dict[tuple[str, ...], Lanelet] = {}
    for item in lanelets:
        found.setdefault(get_bound(item).nodes, item)
    return found


def _follow(
    first: Lanelet,
    neighbours: dict[tuple[str, ...], Lanelet],
    get_bound: Callable[[Lanelet], Bound],
) -> Iterator[Lanelet]:
    seen = {first.id}
    here: Lanelet | None = first
    while (here := neighbours.get(get_bound(here).nodes)) and here.id not in seen:
        seen.add(here.id)
        yield here


def _cut_lane(lane: Lanelet, begins: float, ends: float) -> PlainLane:
    left, right = (_cut_bound(bound, begins, ends) for bound in (lane.left, lane.right))
    if len(left) * len(right) > MAX_PAIRS:
        middle = (begins + ends) / 2
        return join_lanes([_cut_lane(lane, begins, middle), _cut_lane(lane, middle, ends)])
    pairs = pair_points(left, right)
    kept = simplify_together([left[pairs[:, 0]], right[pairs[:, 1]]], MAX_ERROR_M)
    first, second = pairs[kept].T
    return PlainLane(lane.use, lane.speed_m_s, left[first], right[second])


def _cut_bound(bound: Bound, begins: float, ends: float) -> Points:
    """Cut a bound at fractions of its length, into steps of at most `STEP_M`."""
    line = StationedPolyline.from_points(bound.points)
    first_m, last_m = begins * line.length_m, ends * line.length_m
    inner = line.stations_m[(line.stations_m > first_m) & (line.stations_m < last_m - MIN_STEP_M)]
    corners = np.array([first_m, *inner, last_m])
    corners = corners[np.concatenate([[True], np.diff(corners) > MIN_STEP_M])]
    steps = np.maximum(np.ceil(np.diff(corners) / STEP_M), 1).astype(int)
    spans = zip(pairwise(corners), steps, strict=True)
    stations = [np.linspace(a, b, count, endpoint=False) for (a, b), count in spans]
    return line.points_at(np.concatenate([*stations, [last_m]]))


def pair_points(left: Points, right: Points) -> NDArray[np.int64]:
    """Pair the points of two bounds by indices (n, 2) with the least sum of squared gaps.

    Dynamic time warping: Sakoe and Chiba, IEEE Transactions on Acoustics 26 (1978).
    """
    gaps = np.sum((left[:, None, :2] - right[None, :, :2]) ** 2, axis=2)
    sums = np.empty_like(gaps)
    sums[0] = np.cumsum(gaps[0])
    for row in range(1, len(left)):
        before = np.minimum(sums[row - 1], np.concatenate([[np.inf], sums[row - 1, :-1]]))
        along = np.cumsum(gaps[row])
        sums[row] = along + np.minimum.accumulate(before - along + gaps[row])
    pairs = [(len(left) - 1, len(right) - 1)]
    while pairs[-1] != (0, 0):
        i, j = pairs[-1]
        steps = [step for step in ((i - 1, j - 1), (i - 1, j), (i, j - 1)) if min(step) >= 0]
        pairs.append(min(steps, key=lambda step: sums[step]))
    return np.array(pairs[::-1])
