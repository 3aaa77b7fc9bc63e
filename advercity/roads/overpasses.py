"""Finds where lanes lead over other lanes: two levels of paving at one place of the plan."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from advercity.geometry.polyline import Points

MIN_RISE_M = 2.0
"""Least difference of height between two levels; below it, lanes meet."""
MIN_OVERLAP_M2 = 0.5
"""Smaller overlaps are between neighbours."""


@dataclass(frozen=True, eq=False)
class LaneBands:
    """Lanes as bands of the plan with heights.

    Attributes:
        areas: (n,) polygons.
        lines: (n,) left borders in space.
    """

    areas: NDArray[np.object_]
    lines: NDArray[np.object_]

    @staticmethod
    def from_borders(borders: Sequence[tuple[Points, Points]]) -> "LaneBands":
        """Build the bands of lanes from their left and right borders (k, 3)."""
        outlines = [np.vstack([left, right[::-1]])[:, :2] for left, right in borders]
        areas = [shapely.make_valid(shapely.Polygon(outline)) for outline in outlines]
        lines = [shapely.LineString(left) for left, _ in borders]
        return LaneBands(np.array(areas, np.object_), np.array(lines, np.object_))

    def compute_heights(
        self, lanes: NDArray[np.intp], places: NDArray[np.object_]
    ) -> NDArray[np.float64]:
        """Compute the heights (k,) of lanes at places (k,), one of each."""
        along = shapely.line_locate_point(self.lines[lanes], places)
        return shapely.get_z(shapely.line_interpolate_point(self.lines[lanes], along))


@dataclass(frozen=True, eq=False)
class Overpasses:
    """Pairs of lanes that cross at two levels.

    Attributes:
        over: (k,) numbers of the upper lanes.
        under: (k,) numbers of the lower ones.
        areas: (k,) polygons of their overlap.
        height_m: (k,) heights of the upper lanes there.
        rise_m: (k,) their heights over the lower ones.
    """

    over: NDArray[np.intp]
    under: NDArray[np.intp]
    areas: NDArray[np.object_]
    height_m: NDArray[np.float64]
    rise_m: NDArray[np.float64]


def find_overpasses(bands: LaneBands) -> Overpasses:
    """Find all pairs of lanes of which one leads over the other."""
    if not len(bands.lines) or _measure_relief_m(bands.lines) < MIN_RISE_M:
        none = np.empty(0, np.intp)
        return Overpasses(none, none, np.empty(0, np.object_), np.empty(0), np.empty(0))
    one, other = shapely.STRtree(bands.areas).query(bands.areas, predicate="intersects")
    one, other = one[one < other], other[one < other]
    shared = shapely.intersection(bands.areas[one], bands.areas[other])
    kept = shapely.area(shared) > MIN_OVERLAP_M2
    one, other, shared = one[kept], other[kept], shared[kept]
    places = shapely.point_on_surface(shared)
    first, second = bands.compute_heights(one, places), bands.compute_heights(other, places)
    apart = np.abs(first - second) > MIN_RISE_M
    is_upper = (first > second)[apart]
    one, other, first, second = one[apart], other[apart], first[apart], second[apart]
    return Overpasses(
        over=np.where(is_upper, one, other),
        under=np.where(is_upper, other, one),
        areas=shared[apart],
        height_m=np.maximum(first, second),
        rise_m=np.abs(first - second),
    )


def _measure_relief_m(lines: NDArray[np.object_]) -> float:
    z = shapely.get_coordinates(lines, include_z=True)[:, 2]
    return float(np.ptp(z))
