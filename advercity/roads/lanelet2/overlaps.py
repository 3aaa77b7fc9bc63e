"""Overlaps of cross-sections: where lanelets diverge, merge or cross."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from advercity.geometry.polyline import Points, StationedPolyline, resample_polyline
from advercity.roads.lanelet2.lanelets import Lanelet
from advercity.roads.lanelet2.sections import CrossSection

OVERLAP_M = 0.5
"""Width of overlap of merely touching lanelets, as maps are drawn."""
LEVEL_M = 2.0
"""Difference in height from which one lanelet leads over another."""
OPPOSITE_COSINE = -0.8
"""Largest cosine between lanelets of opposite traffic, which share a narrow road."""
MIDDLE_POINTS = 33
"""Points of the middle of a lanelet, on which overlaps are measured."""


@dataclass(frozen=True)
class Overlap:
    """Two overlapping cross-sections, and the overlapping fractions of their lengths."""

    sections: tuple[int, int]
    spans: tuple[tuple[float, float], tuple[float, float]]


def find_overlaps(sections: Sequence[CrossSection]) -> Iterator[Overlap]:
    """Find the pairs of cross-sections whose driven lanelets overlap on one level."""
    owners = [k for k, item in enumerate(sections) for it in item.lanelets if it.is_driven]
    lanes = [it for item in sections for it in item.lanelets if it.is_driven]
    whole = np.array([lane.area for lane in lanes], dtype=np.object_)
    areas = shapely.buffer(whole, -OVERLAP_M / 2)
    middles = [_build_middle(lane) for lane in lanes]
    for first, second in shapely.STRtree(areas).query(areas, predicate="intersects").T.tolist():
        if first < second and owners[first] != owners[second]:
            shared = shapely.get_coordinates(shapely.intersection(areas[first], areas[second]))
            spans = [_find_span(middles[index], shared) for index in (first, second)]
            if _meet(middles[first], middles[second], spans):
                yield Overlap((owners[first], owners[second]), (spans[0], spans[1]))


def _build_middle(lane: Lanelet) -> StationedPolyline:
    bounds = (resample_polyline(it.points, MIDDLE_POINTS) for it in (lane.left, lane.right))
    return StationedPolyline.from_points(np.mean([*bounds], axis=0), length_m=1.0)


def _find_span(middle: StationedPolyline, shared: Points) -> tuple[float, float]:
    at = shapely.line_locate_point(middle.line, shapely.points(shared)) / middle.line.length
    return float(at.min()), float(at.max())


def _meet(
    first: StationedPolyline, second: StationedPolyline, spans: Sequence[tuple[float, float]]
) -> bool:
    """Whether two lanelets are at one height where they overlap, and not of opposite traffic."""
    at = [float(np.mean(span)) for span in spans]
    heights = [line.points_at(a)[..., 2] for line, a in zip((first, second), at, strict=True)]
    turned = first.headings_at(at[0]) - second.headings_at(at[1])
    return bool(abs(heights[0] - heights[1]) < LEVEL_M and np.cos(turned) > OPPOSITE_COSINE)
