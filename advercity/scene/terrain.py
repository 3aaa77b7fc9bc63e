"""The ground around a road: level with the road's edge beside it, rolling between roads.

It is a grid with the road's footprint cut out, so nothing of it can show through the road.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from advercity_dsl import Road
from advercity_dsl.road import SurroundingKind
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from advercity.geometry.mesh import (
    Mesh,
    build_ribbon,
    extract_polygons,
    join_surfaces,
    triangulate_polygon,
)
from advercity.geometry.polyline import Points, polyline_stations, resample_polyline
from advercity.semantics import Semantic

MARGIN_M = 900.0
"""How far the ground goes on beyond the outermost street."""
CELL_M = 4.0
GROWTH = 1.35
"""Of one cell over the last, beyond the site."""
VERGE_WIDTH_M = 9.0
"""Within about this distance the ground follows the edge of the road."""
SOFTENING_M = 5.0
HILLS_START_M, HILLS_HEIGHT_M = 220.0, 16.0
"""How far from any road the country begins to rise, and how high its hills are about."""
BANK_WIDTH_M = 1.0
"""How far inside its outline a plateau reaches its height; a wall may stand before it."""
SNAP_M = 0.001
OVERLAP_M = 0.05
"""How far the ground reaches under the road, so that no crack opens between them."""
GROUND_DROP_M = 0.004
SKIRT_HEIGHT_M = 0.1


@dataclass(frozen=True, eq=False)
class Plateau:
    """Higher ground."""

    outline: shapely.Polygon
    height_m: float


def find_plateaus(road: Road) -> tuple[Plateau, ...]:
    """The plateaus that a road declares."""
    return tuple(
        Plateau(shapely.Polygon(item.line_m), item.height_m or 0.0)
        for item in road.surroundings
        if item.kind is SurroundingKind.PLATEAU
    )


def build_ground(
    rims: Sequence[Points], footprint: BaseGeometry, plateaus: Sequence[Plateau] = ()
) -> Mesh:
    """Grass around the streets, out to `MARGIN_M` beyond them.

    Args:
        rims: Edges (n, 3) of all paving, with it on their left.
        footprint: What is paved, where the ground is left out.
        plateaus: Higher ground.
    """
    built = shapely.buffer(footprint, -OVERLAP_M, join_style="mitre")
    cells = _build_grid_cells(shapely.bounds(built))
    for plateau in plateaus:
        for rim in (plateau.outline, shapely.buffer(plateau.outline, -BANK_WIDTH_M)):
            cells = _split_cells(cells, rim)
    shapely.prepare(built)
    free = shapely.disjoint(cells, built)
    cut = shapely.difference(cells[~free], built)
    whole = free & _are_boxes(cells)
    polygons = [*cells[free & ~whole], *(part for shape in cut for part in extract_polygons(shape))]
    parts = [
        _triangulate_boxes(cells[whole]),
        *(triangulate_polygon(polygon) for polygon in polygons),
    ]
    corners = np.concatenate([corners for corners, _ in parts])
    shifts = np.cumsum([0, *(len(corners) for corners, _ in parts)])
    triangles = np.concatenate(
        [part + shift for (_, part), shift in zip(parts, shifts, strict=False)]
    )
    corners, merged = np.unique(np.round(corners, 3), axis=0, return_inverse=True)
    triangles = _drop_flipped_triangles(corners, merged.reshape(-1)[triangles])
    z = compute_ground_height(rims, corners, plateaus)
    vertices = np.column_stack([corners, z - GROUND_DROP_M])
    return Mesh(
        name="ground",
        vertices=vertices.astype(np.float32),
        triangles=triangles.astype(np.int32),
        material="grass",
        semantic=Semantic.TERRAIN,
        normals=_compute_vertex_normals(vertices, triangles).astype(np.float32),
    )


def build_skirt(rims: Sequence[Points]) -> Mesh:
    """Upright faces below the edge of all paving, which close the step down to the ground."""
    down = np.array([0.0, 0.0, SKIRT_HEIGHT_M])
    pieces = [build_ribbon(rim, rim - down) for rim in rims]
    return join_surfaces(pieces).to_mesh("skirt", "asphalt", Semantic.ROAD)


def compute_ground_height(
    rims: Sequence[Points], points: Points, plateaus: Sequence[Plateau] = ()
) -> NDArray[np.float64]:
    """Height (n,) of the ground at points (n, 2) beside the road.

    Near a road it is the height of the nearest point on its edge, further off the mean of all
    edges, weighted by the inverse square of their distance. On a plateau it is that of the
    plateau, except near the roads that lie within its outline.
    """
    starts = np.concatenate([rim[:-1] for rim in rims])
    steps = np.concatenate([np.diff(rim, axis=0) for rim in rims])
    samples = np.concatenate(
        [
            resample_polyline(rim, max(2, int(polyline_stations(rim)[-1] / CELL_M) + 1))
            for rim in rims
        ]
    )

    def level(chunk: Points) -> NDArray[np.float64]:
        gap, beside = _find_nearest_edge(chunk, starts, steps)
        return _blend_heights(
            gap, beside, _compute_mean_edge_height(chunk, samples)
        ) + _compute_hill_height(chunk, gap)

    height = _map_in_chunks(points, level)
    for plateau in plateaus:
        height = _raise_to_plateaus(points, height, plateau, starts, steps)
    return height


def _raise_to_plateaus(
    points: Points,
    height: NDArray[np.float64],
    plateau: Plateau,
    starts: Points,
    steps: Points,
) -> NDArray[np.float64]:
    """Heights (n,) with those on a plateau lifted to it, or to the streets that climb to it."""
    depth = shapely.distance(shapely.points(points), plateau.outline.exterior)
    inside = shapely.contains_xy(plateau.outline, points[:, 0], points[:, 1])
    climbing = shapely.contains_xy(plateau.outline, *(starts + steps / 2)[:, :2].T)

    def level(chunk: Points) -> NDArray[np.float64]:
        top = np.full(len(chunk), plateau.height_m)
        return _blend_heights(*_find_nearest_edge(chunk, starts[climbing], steps[climbing]), top)

    top = np.full(len(points), plateau.height_m)
    if climbing.any() and inside.any():
        top[inside] = _map_in_chunks(points[inside], level)
    rise = np.where(inside, np.minimum(depth / BANK_WIDTH_M, 1.0), 0.0)
    return height + rise * (top - height)


def _map_in_chunks(
    points: Points, height: Callable[[Points], NDArray[np.float64]]
) -> NDArray[np.float64]:
    chunks = np.array_split(points, len(points) // 1000 + 1)
    return np.concatenate([height(chunk) for chunk in chunks])


def _find_nearest_edge(
    points: Points, starts: Points, steps: Points
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Distance (n,) to the nearest edge, and its height there."""
    along = steps[:, :2]
    squared = np.maximum((along**2).sum(axis=1), 1e-12)
    x, y = (points[:, k, None] - starts[None, :, k] for k in (0, 1))
    share = np.clip((x * along[:, 0] + y * along[:, 1]) / squared, 0.0, 1.0)
    gap = (x - share * along[:, 0]) ** 2 + (y - share * along[:, 1]) ** 2
    nearest = gap.argmin(axis=1)
    row = np.arange(len(points))
    height = starts[nearest, 2] + share[row, nearest] * steps[nearest, 2]
    return np.sqrt(gap[row, nearest]), height


def _compute_mean_edge_height(points: Points, samples: Points) -> NDArray[np.float64]:
    """Mean height (n,) of all edges, weighted by the inverse square of their distance."""
    x, y = (points[:, k, None] - samples[None, :, k] for k in (0, 1))
    weight = 1.0 / (x * x + y * y + SOFTENING_M**2)
    return (weight @ samples[:, 2]) / weight.sum(axis=1)


def _compute_hill_height(points: Points, gap: NDArray[np.float64]) -> NDArray[np.float64]:
    """Height (n,) of hills on the horizon, where no sensor reaches."""
    x, y = points.T / HILLS_START_M
    waves = 1 + 0.5 * np.sin(1.7 * x + 0.4) * np.cos(1.3 * y) + 0.4 * np.sin(2.6 * (x + y) + 1.9)
    rise = np.clip((gap - HILLS_START_M) / (2 * HILLS_START_M), 0.0, 1.0)
    return HILLS_HEIGHT_M * waves * rise**2 * (3 - 2 * rise)


def _blend_heights(
    gap: NDArray[np.float64], beside: NDArray[np.float64], beyond: NDArray[np.float64]
) -> NDArray[np.float64]:
    follow = np.exp(-((gap / VERGE_WIDTH_M) ** 2))
    return follow * beside + (1.0 - follow) * beyond


def _are_boxes(cells: NDArray[np.object_]) -> NDArray[np.bool_]:
    west, south, east, north = shapely.bounds(cells).T
    return np.isclose(shapely.area(cells), (east - west) * (north - south), rtol=1e-9)


def _triangulate_boxes(boxes: NDArray[np.object_]) -> tuple[Points, NDArray[np.int64]]:
    """Corners (4 n, 2) of boxes and their triangles (2 n, 3), counter-clockwise."""
    west, south, east, north = shapely.bounds(boxes).T
    x, y = np.stack([west, east, east, west], 1), np.stack([south, south, north, north], 1)
    first = 4 * np.arange(len(boxes))[:, None, None]
    triangles = first + np.array([(0, 1, 2), (0, 2, 3)])
    return np.column_stack([x.ravel(), y.ravel()]), triangles.reshape(-1, 3)


def _split_cells(cells: NDArray[np.object_], outline: BaseGeometry) -> NDArray[np.object_]:
    """Cells cut where an outline passes through them."""
    shapely.prepare(outline)
    passed = shapely.intersects(cells, outline) & ~shapely.contains_properly(outline, cells)
    parts = [
        polygon
        for cut in (shapely.intersection, shapely.difference)
        for shape in cut(cells[passed], outline)
        for polygon in extract_polygons(shape)
    ]
    return np.array([*cells[~passed], *parts], dtype=object)


def _build_grid_cells(bounds: NDArray[np.float64]) -> NDArray[np.object_]:
    x, y = (_compute_grid_lines(bounds[axis], bounds[axis + 2]) for axis in (0, 1))
    west, south = (grid.ravel() for grid in np.meshgrid(x[:-1], y[:-1]))
    east, north = (grid.ravel() for grid in np.meshgrid(x[1:], y[1:]))
    return shapely.box(west, south, east, north)


def _compute_grid_lines(first: float, last: float) -> NDArray[np.float64]:
    """Grid lines: even over the site, further and further apart beyond it."""
    inside = np.linspace(first - CELL_M, last + CELL_M, int((last - first) / CELL_M) + 3)
    count = int(np.log(1 + MARGIN_M * (GROWTH - 1) / CELL_M) / np.log(GROWTH)) + 1
    outside = CELL_M * (GROWTH ** np.arange(1, count + 1) - 1) * GROWTH / (GROWTH - 1)
    return np.concatenate([inside[0] - outside[::-1], inside, inside[-1] + outside])


def _drop_flipped_triangles(corners: Points, triangles: NDArray[np.int64]) -> NDArray[np.int64]:
    """Triangles without the slivers that rounding has turned over."""
    a, b, c = (corners[triangles[:, corner]] for corner in range(3))
    area = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    return triangles[area > SNAP_M**2]


def _compute_vertex_normals(vertices: Points, triangles: NDArray[np.int64]) -> Points:
    a, b, c = (vertices[triangles[:, corner]] for corner in range(3))
    faces = np.cross(b - a, c - a)
    sums = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(sums, triangles[:, corner], faces)
    return sums / np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-12)
