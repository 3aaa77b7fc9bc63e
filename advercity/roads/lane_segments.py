"""Lanes with their borders, as annotations, maps and the plan need them."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from advercity_dsl.road import StripKind
from numpy.typing import ArrayLike, NDArray

from advercity.geometry import polyline
from advercity.geometry.polyline import StationedPolyline, polyline_stations
from advercity.roads.layout import CrossingLayout, RoadLayout
from advercity.roads.streets import StreetLayout, sumo_edge_id


@dataclass(frozen=True)
class LaneSegment:
    """A lane with its borders.

    Attributes:
        id: See `build_lane_segments`; SUMO's id of the lane on an imported road.
        kind: driving, parking, shoulder, sidewalk or crossing.
        left: (n, 3) left border in the direction of travel, metres.
        right: (n, 3) right border, a point for each of `left`.
        in_junction: Whether it lies inside a junction, where borders are not painted.
    """

    id: str
    kind: str
    left: NDArray[np.float64]
    right: NDArray[np.float64]
    in_junction: bool = False

    @cached_property
    def length_m(self) -> float:
        """Length of its middle in the plan."""
        return float(self._stations_m[-1])

    @cached_property
    def width_m(self) -> float:
        """Mean distance between its borders in the plan."""
        return float(np.linalg.norm((self.left - self.right)[:, :2], axis=1).mean())

    def points_at(self, along_m: ArrayLike, fraction: ArrayLike) -> NDArray[np.float64]:
        """Interpolate points (..., 3) at stations; 0 is the left border, 1 the right one."""
        left, right = (
            StationedPolyline(side, self._stations_m).points_at(along_m)
            for side in (self.left, self.right)
        )
        return left + np.asarray(fraction)[..., None] * (right - left)

    @cached_property
    def _stations_m(self) -> NDArray[np.float64]:
        return polyline_stations((self.left + self.right)[:, :2] / 2)


LANE_KINDS = {
    StripKind.LANE: "driving",
    StripKind.PARKING: "parking",
    StripKind.SHOULDER: "shoulder",
    StripKind.SIDEWALK: "sidewalk",
}


def build_lane_segments(layout: RoadLayout) -> tuple[LaneSegment, ...]:
    """Build every lane of a road, then the connecting paths and crossings of its junctions.

    Driving lanes are `<street>+.<number>` or `<street>-.<number>`, other strips have their kind
    before the number (`<street>+.sidewalk1`); all count from the axis. Connecting paths are
    `<junction>: <movement>`, crossings `<junction>/<street>`.
    """
    found = [lane for street in layout.streets.values() for lane in _street_lane_segments(street)]
    for junction in layout.junctions.values():
        found += [
            LaneSegment(path.id, "driving", path.left, path.right, in_junction=True)
            for path in junction.connecting_paths
        ]
        found += [_crossing_lane_segment(junction.id, crossing) for crossing in junction.crossings]
    return tuple(found)


def _street_lane_segments(street: StreetLayout) -> Iterator[LaneSegment]:
    for along in (True, False):
        seen: Counter[str] = Counter()
        for strip in street.strips_in_direction(along=along):
            if strip.kind in LANE_KINDS:
                kind = LANE_KINDS[strip.kind]
                seen[kind] += 1
                name = strip.lane_number if strip.lane_number else f"{kind}{seen[kind]}"
                yield LaneSegment(
                    id=f"{sumo_edge_id(street.id, along=along)}.{name}",
                    kind=kind,
                    left=street.directed_line(strip.inner_t, along=along),
                    right=street.directed_line(strip.outer_t, along=along),
                )


def _crossing_lane_segment(junction: str, crossing: CrossingLayout) -> LaneSegment:
    start, end = crossing.centre
    direction = (end - start)[:2] / np.linalg.norm((end - start)[:2])
    aside = np.array([*polyline.left_normals(direction), 0.0]) * crossing.width_m / 2
    return LaneSegment(
        id=f"{junction}/{crossing.street}",
        kind="crossing",
        left=crossing.centre + aside,
        right=crossing.centre - aside,
        in_junction=True,
    )
