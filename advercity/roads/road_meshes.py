"""Meshes of authored roads.

Carriageways are at the height of the layout, sidewalks and medians a kerb higher.
"""

from collections.abc import Iterator
from itertools import groupby, pairwise

import numpy as np
import shapely
from advercity_dsl.road import StripKind

from advercity.geometry.mesh import (
    Mesh,
    TriangleSurface,
    build_grid_cells,
    build_ribbon,
    extract_polygons,
    merge_surfaces,
    triangulate_polygon,
)
from advercity.geometry.polyline import Points
from advercity.roads import markings
from advercity.roads.layout import JunctionLayout, RoadLayout
from advercity.roads.streets import StreetLayout, StripLayout
from advercity.semantics import Semantic

KERB_HEIGHT_M = 0.15
KERB_WIDTH_M = 0.15
FACET_SIZE_M = 2.0
"""Size of the facets of a sloping junction."""
LEVEL_TOLERANCE_M = 0.001
"""Areas whose heights differ by less are triangulated in one piece."""
KERB_RISE = np.array([0.0, 0.0, KERB_HEIGHT_M])

ASPHALT, SIDEWALK, MEDIAN, VERGE, KERB = "asphalt", "sidewalk", "median", "verge", "kerb"
ROAD_SURFACES = {
    ASPHALT: ("asphalt", Semantic.ROAD),
    SIDEWALK: ("pavement", Semantic.SIDEWALK),
    MEDIAN: ("grass", Semantic.TERRAIN),
    VERGE: ("grass", Semantic.TERRAIN),
    KERB: ("kerb", Semantic.SIDEWALK),
}
STRIP_SURFACES = {StripKind.SIDEWALK: SIDEWALK, StripKind.MEDIAN: MEDIAN, StripKind.VERGE: VERGE}
RAISED_SURFACES = (SIDEWALK, MEDIAN)


def build_road_meshes(layout: RoadLayout) -> list[Mesh]:
    """Build roadways, kerbs, sidewalks, medians and paint, one mesh of each kind."""
    pieces: dict[str, list[TriangleSurface]] = {name: [] for name in ROAD_SURFACES}
    for street in layout.streets.values():
        for surface, piece in _street_patches(street):
            pieces[surface].append(piece)
    for junction in layout.junctions.values():
        for surface, piece in _junction_patches(junction):
            pieces[surface].append(piece)
    return [*merge_surfaces(pieces, ROAD_SURFACES), *markings.build_marking_meshes(layout)]


def is_asphalt(strip: StripLayout) -> bool:
    """Whether a strip belongs to the roadway."""
    return _strip_surface(strip) == ASPHALT


def _strip_surface(strip: StripLayout) -> str:
    return STRIP_SURFACES.get(strip.kind, ASPHALT)


def _street_patches(street: StreetLayout) -> Iterator[tuple[str, TriangleSurface]]:
    strips = (*street.left_strips[::-1], *street.right_strips)
    runs = [(surface, list(run)) for surface, run in groupby(strips, _strip_surface)]
    is_raised = [surface in RAISED_SURFACES for surface, _ in runs]
    edges = markings.marking_edge_offsets(street)
    for index, (surface, run) in enumerate(runs):
        first_t = max(run[0].inner_t, run[0].outer_t)
        last_t = min(run[-1].inner_t, run[-1].outer_t)
        left, right = street.offset_line(first_t), street.offset_line(last_t)
        if is_raised[index]:
            at_left = index > 0 and not is_raised[index - 1]
            at_right = index + 1 < len(runs) and not is_raised[index + 1]
            yield from _raised_strip(surface, left, right, left_kerb=at_left, right_kerb=at_right)
            yield from _strip_ends(left, right)
        else:
            between = {t for t in edges if last_t < t < first_t}
            for t, next_t in pairwise(sorted({first_t, last_t} | between, reverse=True)):
                yield surface, build_ribbon(street.offset_line(t), street.offset_line(next_t))


def _junction_patches(junction: JunctionLayout) -> Iterator[tuple[str, TriangleSurface]]:
    yield ASPHALT, _junction_roadway(junction)
    for corner in junction.corners:
        if corner.sidewalk_outer_edge is not None:
            yield from _raised_strip(
                SIDEWALK, corner.kerb, corner.sidewalk_outer_edge, left_kerb=True
            )
    if junction.median is not None:
        left, right = junction.median[[0, 3]], junction.median[[1, 2]]
        yield from _raised_strip(MEDIAN, left, right, left_kerb=True, right_kerb=True)


def _junction_roadway(junction: JunctionLayout) -> TriangleSurface:
    outline = shapely.Polygon(junction.roadway_outline[:, :2])
    facets = [outline]
    if np.ptp(junction.roadway_outline[:, 2]) > LEVEL_TOLERANCE_M:
        grid = shapely.intersection(build_grid_cells(outline.bounds, FACET_SIZE_M), outline)
        facets = [polygon for cell in grid for polygon in extract_polygons(cell)]
    parts = [triangulate_polygon(facet) for facet in facets]
    corners = np.concatenate([corners for corners, _ in parts])
    shifts = np.cumsum([0, *(len(corners) for corners, _ in parts)])
    triangles = [part + shift for (_, part), shift in zip(parts, shifts, strict=False)]
    vertices = np.column_stack([corners, junction.height_at(corners)])
    return TriangleSurface(vertices, np.concatenate(triangles))


def _raised_strip(
    surface: str, left: Points, right: Points, *, left_kerb: bool, right_kerb: bool = False
) -> Iterator[tuple[str, TriangleSurface]]:
    """Build a strip a kerb's height above two lines on the ground, with kerbs where asked."""
    across = (right - left) / np.linalg.norm(right - left, axis=1, keepdims=True)
    inner_left, inner_right = left + KERB_RISE, right + KERB_RISE
    if left_kerb:
        inner_left = left + KERB_RISE + KERB_WIDTH_M * across
        yield KERB, build_ribbon(left, left + KERB_RISE)
        yield KERB, build_ribbon(left + KERB_RISE, inner_left)
    if right_kerb:
        inner_right = right + KERB_RISE - KERB_WIDTH_M * across
        yield KERB, build_ribbon(inner_right, right + KERB_RISE)
        yield KERB, build_ribbon(right + KERB_RISE, right)
    yield surface, build_ribbon(inner_left, inner_right)


def _strip_ends(left: Points, right: Points) -> Iterator[tuple[str, TriangleSurface]]:
    """Build upright ends of a raised strip; they are hidden where another one joins."""
    first, last = np.stack([left[0], right[0]]), np.stack([left[-1], right[-1]])
    yield KERB, build_ribbon(first + KERB_RISE, first)
    yield KERB, build_ribbon(last, last + KERB_RISE)
