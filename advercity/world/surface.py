"""Meshes of authored roads.

Carriageways are at the height of the layout; sidewalks and medians stand a kerb higher.
"""

from collections.abc import Iterator
from itertools import groupby, pairwise

import numpy as np
import shapely
from advercity_dsl.road import StripKind
from numpy.typing import NDArray

from advercity import curves
from advercity.curves import Points
from advercity.semantics import Semantic
from advercity.streets import Band, StreetLayout
from advercity.world import markings
from advercity.world.junctions import JunctionLayout
from advercity.world.layout import Layout
from advercity.world.meshing import Piece, cells, filled, mesh, polygons_of, ribbon
from advercity.world.scene import Mesh

KERB_HEIGHT_M = 0.15
KERB_WIDTH_M = 0.15
CELL_M = 2.0
"""Size of the facets of a junction that is not level."""
LEVEL_WITHIN_M = 0.001
UP = np.array([0.0, 0.0, KERB_HEIGHT_M])

JOINT_SPACING_M, JOINT_M = 2.0, 0.02
"""Between the joints across a sidewalk, and their width."""
WIDEST_SLAB_M = 3.0

ASPHALT, SIDEWALK, MEDIAN, VERGE, KERB = "asphalt", "sidewalk", "median", "verge", "kerb"
JOINTS = "joints"
MATERIALS = {
    ASPHALT: ("asphalt", Semantic.ROAD),
    SIDEWALK: ("pavement", Semantic.SIDEWALK),
    JOINTS: ("joint", Semantic.SIDEWALK),
    MEDIAN: ("grass", Semantic.TERRAIN),
    VERGE: ("grass", Semantic.TERRAIN),
    KERB: ("kerb", Semantic.SIDEWALK),
}
SURFACES = {StripKind.SIDEWALK: SIDEWALK, StripKind.MEDIAN: MEDIAN, StripKind.VERGE: VERGE}
RAISED = (SIDEWALK, MEDIAN)


def road_meshes(layout: Layout) -> list[Mesh]:
    """Roadways, kerbs, sidewalks, medians and paint, one mesh of each kind."""
    pieces: dict[str, list[Piece]] = {}
    for street in layout.streets.values():
        for surface, piece in _street(street):
            pieces.setdefault(surface, []).append(piece)
    for junction in layout.junctions.values():
        for surface, piece in _junction(junction):
            pieces.setdefault(surface, []).append(piece)
    meshes = [mesh(name, pieces[name], *MATERIALS[name]) for name in MATERIALS if name in pieces]
    return [*meshes, *markings.meshes(layout)]


def _surface(band: Band) -> str:
    return SURFACES.get(band.kind, ASPHALT)


def _street(street: StreetLayout) -> Iterator[tuple[str, Piece]]:
    runs = [
        (surface, list(run))
        for surface, run in groupby((*street.left[::-1], *street.right), _surface)
    ]
    edges = markings.line_edges(street)
    for index, (surface, run) in enumerate(runs):
        first_t = max(run[0].inner_t, run[0].outer_t)
        last_t = min(run[-1].inner_t, run[-1].outer_t)
        left, right = street.line(first_t), street.line(last_t)
        if surface in RAISED:
            beside = [
                runs[other][0] for other in (index - 1, index + 1) if other in range(len(runs))
            ]
            at_left = index > 0 and beside[0] not in RAISED
            at_right = index + 1 < len(runs) and beside[-1] not in RAISED
            yield from _raised(surface, left, right, left_kerb=at_left, right_kerb=at_right)
            yield from _caps(left, right)
        else:
            between = {t for t in edges if last_t < t < first_t}
            for t, next_t in pairwise(sorted({first_t, last_t} | between, reverse=True)):
                yield surface, ribbon(street.line(t), street.line(next_t))


def _junction(junction: JunctionLayout) -> Iterator[tuple[str, Piece]]:
    yield ASPHALT, _roadway(junction)
    for corner in junction.corners:
        if corner.back is not None:
            yield from _raised(SIDEWALK, corner.kerb, corner.back, left_kerb=True)
    if junction.median is not None:
        left, right = junction.median[[0, 3]], junction.median[[1, 2]]
        yield from _raised(MEDIAN, left, right, left_kerb=True, right_kerb=True)


def _roadway(junction: JunctionLayout) -> Piece:
    outline = shapely.Polygon(junction.outline[:, :2])
    facets = [outline]
    if np.ptp(junction.outline[:, 2]) > LEVEL_WITHIN_M:
        grid = shapely.intersection(cells(outline.bounds, CELL_M), outline)
        facets = [polygon for cell in grid for polygon in polygons_of(cell)]
    parts = [filled(facet) for facet in facets]
    corners = np.concatenate([corners for corners, _ in parts])
    shifts = np.cumsum([0, *(len(corners) for corners, _ in parts)])
    triangles = [part + shift for (_, part), shift in zip(parts, shifts, strict=False)]
    vertices = np.column_stack([corners, junction.height(corners)])
    return Piece(vertices, np.concatenate(triangles))


def _raised(
    surface: str, left: Points, right: Points, *, left_kerb: bool, right_kerb: bool = False
) -> Iterator[tuple[str, Piece]]:
    """A strip between two lines on the ground, a kerb's height above it."""
    across = (right - left) / np.linalg.norm(right - left, axis=1, keepdims=True)
    inner_left, inner_right = left + UP, right + UP
    if left_kerb:
        inner_left = left + UP + KERB_WIDTH_M * across
        yield KERB, ribbon(left, left + UP)
        yield KERB, ribbon(left + UP, inner_left)
    if right_kerb:
        inner_right = right + UP - KERB_WIDTH_M * across
        yield KERB, ribbon(inner_right, right + UP)
        yield KERB, ribbon(right + UP, right)
    if surface == SIDEWALK:
        yield from _slabs(inner_left, inner_right)
    else:
        yield surface, ribbon(inner_left, inner_right)


def _slabs(left: Points, right: Points) -> Iterator[tuple[str, Piece]]:
    """A sidewalk between two lines: slabs, and the joints across it and along a wide one."""
    along = curves.stations((left + right) / 2)
    width = float(np.linalg.norm(left - right, axis=1).max())
    rows = _cuts(float(along[-1]), JOINT_SPACING_M)
    columns = _cuts(width, width / np.ceil(width / WIDEST_SLAB_M)) / width
    for row, (start, end) in enumerate(pairwise(rows)):
        at = np.array([start, *along[(along > start) & (along < end)], end])
        near, far = (
            np.stack([np.interp(at, along, axis) for axis in line.T], axis=1)
            for line in (left, right)
        )
        for column, (first, last) in enumerate(pairwise(columns)):
            name = JOINTS if row % 2 or column % 2 else SIDEWALK
            yield name, ribbon(near + first * (far - near), near + last * (far - near))


def _cuts(length_m: float, spacing_m: float) -> NDArray[np.float64]:
    """Where slabs and joints end, by turns, beginning with a slab."""
    joints = np.arange(spacing_m, length_m - JOINT_M, spacing_m)
    edges = np.column_stack([joints - JOINT_M / 2, joints + JOINT_M / 2])
    return np.concatenate([[0.0], edges.ravel(), [length_m]])


def _caps(left: Points, right: Points) -> Iterator[tuple[str, Piece]]:
    """Upright ends of a raised strip; out of sight where the next one joins."""
    first, last = np.stack([left[0], right[0]]), np.stack([left[-1], right[-1]])
    yield KERB, ribbon(first + UP, first)
    yield KERB, ribbon(last, last + UP)
