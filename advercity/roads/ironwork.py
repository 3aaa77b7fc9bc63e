"""Places covers of manholes and gratings of gullies in the roadways of built-up streets.

Covers have the usual diameter of about 0.6 m; gullies are where the kerb is, some 25 m apart.
"""

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
import shapely

from advercity.geometry.polyline import Points
from advercity.randomness import create_generator
from advercity.roads.lane_segments import LaneSegment
from advercity.roads.road_inlays import RoadInlay

BUILT_UP_M = 8.0
"""Distance to a sidewalk within which a lane has sewers beneath."""
COVER_SPACING_M, COVER_RADII_M, COVER_CORNERS = 42.0, (0.27, 0.285, 0.33, 0.355), 20
"""Distance of covers in a lane; radii of a cover, its gap, its frame, and the seal around it."""
JUNCTION_COVER_FRACTION = 0.1
"""Fraction of the paths through a junction with a cover on them."""
GULLY_SPACING_M, GULLY_M, GULLY_BARS = 25.0, (0.5, 0.32), 6
"""Distance of gullies, their size along and across the kerb, and the slots of their gratings."""
END_MARGIN_M = 3.0

IRON, GAP = "cast_iron", "bitumen"


def place_ironwork(lanes: Sequence[LaneSegment], key: str) -> list[RoadInlay]:
    """Place covers in driving lanes and gullies along the kerbs of sidewalks."""
    sidewalks = [lane for lane in lanes if lane.kind == "sidewalk"]
    kerbs = shapely.union_all([shapely.LineString(lane.left[:, :2]) for lane in sidewalks])
    found: list[RoadInlay] = []
    for lane in lanes:
        draw = create_generator("ironwork", key, lane.id)
        if lane.kind == "driving" and _is_built_up(lane, kerbs):
            for at in _draw_covers(lane, draw):
                found += _build_cover(lane.points_at(at, draw.uniform(0.42, 0.58)))
        elif lane.kind == "sidewalk" and not lane.in_junction:
            for at in np.arange(END_MARGIN_M, lane.length_m - END_MARGIN_M, GULLY_SPACING_M):
                found += _build_gully(lane, at + draw.uniform(0.0, 2.0))
    return found


def _is_built_up(lane: LaneSegment, kerbs: shapely.Geometry) -> bool:
    middle = shapely.Point(lane.points_at(lane.length_m / 2, 0.5)[:2])
    return bool(shapely.dwithin(kerbs, middle, BUILT_UP_M + 20.0 * lane.in_junction))


def _draw_covers(lane: LaneSegment, draw: np.random.Generator) -> Points:
    if lane.in_junction:
        is_there = draw.uniform() < JUNCTION_COVER_FRACTION
        return np.array([lane.length_m * draw.uniform(0.3, 0.7)] * is_there)
    first = END_MARGIN_M + draw.uniform(0.0, COVER_SPACING_M)
    return np.arange(first, lane.length_m - END_MARGIN_M, COVER_SPACING_M)


def _build_cover(middle: Points) -> Iterator[RoadInlay]:
    """Build a round cover in its frame at a point (3,), with gaps around both."""
    angle = 2 * np.pi * np.arange(COVER_CORNERS) / COVER_CORNERS
    around = np.column_stack([np.cos(angle), np.sin(angle)])
    circles = [middle[:2] + radius_m * around for radius_m in COVER_RADII_M]
    yield RoadInlay(IRON, shapely.Polygon(circles[0]), float(middle[2]))
    for (inner, outer), material in zip(pairwise(circles), (GAP, IRON, GAP), strict=True):
        rings = np.stack([inner, outer, np.roll(outer, -1, 0), np.roll(inner, -1, 0)], axis=1)
        for ring in rings:
            yield RoadInlay(material, shapely.Polygon(ring), float(middle[2]))


def _build_gully(sidewalk: LaneSegment, at_m: float) -> Iterator[RoadInlay]:
    """Build a grating on the roadway before a sidewalk's kerb, with slots across the flow."""
    length_m, depth_m = GULLY_M
    edges = np.linspace(at_m, at_m + length_m, 2 * GULLY_BARS + 2)
    # Beyond the left border of a sidewalk is the roadway, a hand's breadth below.
    across = np.array([-0.03, -0.03 - depth_m]) / sidewalk.width_m
    for index, (first, last) in enumerate(pairwise(edges)):
        stations = np.array([first, first, last, last])
        corners = sidewalk.points_at(stations, across[[0, 1, 1, 0]])
        outline = shapely.convex_hull(shapely.Polygon(corners[:, :2]))
        yield RoadInlay(IRON if index % 2 == 0 else GAP, outline, float(corners[0, 2]))
