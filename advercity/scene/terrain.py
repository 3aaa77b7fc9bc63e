"""Models the ground around roads: level with their edges, rolling between them, with plateaus.

Its mesh is a grid without the paved area, so the ground cannot show through the road.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from advercity_dsl import Road
from advercity_dsl.road import SurroundingKind
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from advercity.geometry.arrays import Float64Array
from advercity.geometry.mesh import (
    GRID_M,
    Mesh,
    build_ribbon,
    extract_polygons,
    join_surfaces,
    triangulate_polygon,
)
from advercity.geometry.polyline import Points, polyline_stations, resample_polyline
from advercity.semantics import Semantic

MARGIN_M = 900.0
"""Extent of the ground beyond the outermost street."""
CELL_M = 4.0
GROWTH = 1.35
"""Factor from one cell size to the next, beyond the site."""
VERGE_WIDTH_M = 9.0
"""Distance from the road over which the ground departs from the height of its edge."""
SOFTENING_M = 5.0
"""Added to distances in quadrature: weights stay finite on the edges themselves."""
HILLS_START_M, HILLS_HEIGHT_M = 220.0, 16.0
"""Distance from all roads at which hills begin, and their usual height."""
BANK_WIDTH_M = 1.0
"""Width of the slope of a plateau, inside its outline; outside there may be a retaining wall."""
OVERLAP_M = 0.05
"""Overlap of the ground under the road, so no crack opens between them."""
HEIGHT_DECIMALS = 6
"""Digits of heights in metres computed alike by all processors."""
GROUND_DROP_M = 0.004
"""Drop of the ground below the edge of the road: surfaces at one height would flicker."""
SKIRT_HEIGHT_M = 0.1


@dataclass(frozen=True, eq=False)
class Plateau:
    """Ground at a declared height within an outline."""

    outline: shapely.Polygon
    height_m: float


@dataclass(frozen=True, eq=False)
class Cutting:
    """Ground under a deck, level with the edges of the lower street.

    Attributes:
        outline: Area of the deck, and a little beside it.
        opening: Area around it for finding edges of the lower street.
        rim: Area of the deck with its abutments, along which the ground may have a step.
    """

    outline: BaseGeometry
    opening: BaseGeometry
    rim: BaseGeometry


def find_plateaus(road: Road) -> tuple[Plateau, ...]:
    """List the plateaus declared by a road."""
    return tuple(
        Plateau(shapely.Polygon(item.line_m), item.height_m or 0.0)
        for item in road.surroundings
        if item.kind is SurroundingKind.PLATEAU
    )


@dataclass(frozen=True, eq=False)
class EdgeSegments:
    """Segments of the edges of all paving.

    Attributes:
        starts: (m, 3) first points.
        steps: (m, 3) vectors to the last points.
    """

    starts: Points
    steps: Points

    @cached_property
    def _tree(self) -> shapely.STRtree:
        ends = np.stack([self.starts, self.starts + self.steps], axis=1)
        return shapely.STRtree(np.asarray(shapely.linestrings(ends[..., :2])))

    def select_inside(self, outline: BaseGeometry) -> "EdgeSegments":
        """Select the segments whose middle is inside an outline."""
        inside = shapely.contains_xy(outline, *(self.starts + self.steps / 2)[:, :2].T)
        return EdgeSegments(self.starts[inside], self.steps[inside])

    def find_nearest(self, points: Points) -> tuple[Float64Array, Float64Array]:
        """Find the distance (n,) of points (n, 2) to the nearest segment, and its height there."""
        places = shapely.points(points)
        _, far_m = self._tree.query_nearest(places, all_matches=False, return_distance=True)
        # Of equally near segments (within rounding), as at corners, the first one counts.
        within_m = far_m * (1 + 1e-9) + 1e-9
        row, segment = self._tree.query(places, predicate="dwithin", distance=within_m)
        along = self.steps[segment, :2]
        squared = np.maximum((along**2).sum(axis=1), 1e-12)
        x, y = (points[row] - self.starts[segment, :2]).T
        fraction = np.clip((x * along[:, 0] + y * along[:, 1]) / squared, 0.0, 1.0)
        squared_distance = (x - fraction * along[:, 0]) ** 2 + (y - fraction * along[:, 1]) ** 2
        order = np.lexsort((segment, row))
        best = order[np.unique(row[order], return_index=True)[1]]
        height = self.starts[segment[best], 2] + fraction[best] * self.steps[segment[best], 2]
        return np.sqrt(squared_distance[best]), height


@dataclass(frozen=True, eq=False)
class GroundModel:
    """Height of the ground around roads, built once for a world.

    Near a road it is the height of the nearest point of its edge, further off the mean of all
    edges, weighted by the inverse square of their distance. On a plateau it is the plateau's,
    except near roads climbing to it.

    Attributes:
        segments: Segments of all edges.
        samples: (k, 3) points along all edges at about `CELL_M`.
        plateaus: Higher ground.
        cuttings: Ground under decks.
    """

    segments: EdgeSegments
    samples: Points
    plateaus: Sequence[Plateau]
    cuttings: Sequence[Cutting] = ()

    @classmethod
    def from_edges(
        cls,
        edges: Sequence[Points],
        plateaus: Sequence[Plateau] = (),
        cuttings: Sequence[Cutting] = (),
    ) -> "GroundModel":
        """Build the model from the edges (n, 3) of all paving on the ground."""
        samples = [
            resample_polyline(edge, max(2, int(polyline_stations(edge)[-1] / CELL_M) + 1))
            for edge in edges
        ]
        segments = EdgeSegments(
            np.concatenate([edge[:-1] for edge in edges]),
            np.concatenate([np.diff(edge, axis=0) for edge in edges]),
        )
        return cls(segments, np.concatenate(samples), plateaus, cuttings)

    def height_at(self, points: Points) -> Float64Array:
        """Compute the height (n,) of the ground at points (n, 2) off the road, to a micrometre."""
        distance, edge_height = self.segments.find_nearest(points)
        mean_height = _compute_mean_edge_height(points, self.samples)
        height = _blend_heights(distance, edge_height, mean_height)
        height += _compute_hill_height(points, distance)
        for plateau in self.plateaus:
            height = self._raise_to_plateau(points, height, plateau)
        for cutting in self.cuttings:
            self._lower_into_cutting(points, height, cutting)
        # Last digits of exponentials and sines depend on the processor; normals would show them.
        return np.round(height, HEIGHT_DECIMALS)

    def _lower_into_cutting(self, points: Points, height: Float64Array, cutting: Cutting) -> None:
        """Lower heights (n,) under a deck, in place, to the nearest edge below it."""
        inside = shapely.dwithin(cutting.outline, shapely.points(points), GRID_M)
        below = self.segments.select_inside(cutting.opening)
        if len(below.starts) > 0 and inside.any():
            height[inside] = below.find_nearest(points[inside])[1]

    def _raise_to_plateau(
        self, points: Points, height: Float64Array, plateau: Plateau
    ) -> Float64Array:
        """Raise heights (n,) within a plateau to it, or to the streets climbing to it."""
        depth = shapely.distance(shapely.points(points), plateau.outline.exterior)
        inside = shapely.contains_xy(plateau.outline, points[:, 0], points[:, 1])
        climbing = self.segments.select_inside(plateau.outline)
        top = np.full(len(points), plateau.height_m)
        if len(climbing.starts) > 0 and inside.any():
            top[inside] = _blend_heights(*climbing.find_nearest(points[inside]), top[inside])
        rise = np.where(inside, np.minimum(depth / BANK_WIDTH_M, 1.0), 0.0)
        return height + rise * (top - height)


def build_ground(model: GroundModel, paved_area: BaseGeometry) -> Mesh:
    """Build the mesh of grass around the paved area, out to `MARGIN_M` beyond it."""
    hole = shapely.buffer(paved_area, -OVERLAP_M, join_style="mitre")
    cells = _build_grid_cells(shapely.bounds(hole))
    for plateau in model.plateaus:
        for outline in (plateau.outline, shapely.buffer(plateau.outline, -BANK_WIDTH_M)):
            cells = _split_cells(cells, outline)
    for cutting in model.cuttings:
        for outline in (cutting.outline, cutting.rim):
            cells = _split_cells(cells, outline)
    shapely.prepare(hole)
    free = shapely.disjoint(cells, hole)
    cut = shapely.difference(cells[~free], hole)
    whole = free & _are_boxes(cells)
    polygons = [*cells[free & ~whole], *(part for shape in cut for part in extract_polygons(shape))]
    # Most cells are whole boxes, which are quick to triangulate as arrays.
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
    vertices = np.column_stack([corners, model.height_at(corners) - GROUND_DROP_M])
    return Mesh(
        name="ground",
        vertices=vertices.astype(np.float32),
        triangles=triangles.astype(np.int32),
        material="grass",
        semantic=Semantic.TERRAIN,
        normals=_compute_vertex_normals(vertices, triangles).astype(np.float32),
    )


def build_skirt(edges: Sequence[Points]) -> Mesh:
    """Build upright faces below the edges (n, 3) of all paving, to close the step to the ground."""
    down = np.array([0.0, 0.0, SKIRT_HEIGHT_M])
    skirt = join_surfaces([build_ribbon(edge, edge - down) for edge in edges])
    return skirt.to_mesh("skirt", "asphalt", Semantic.ROAD)


def _compute_mean_edge_height(points: Points, samples: Points) -> Float64Array:
    """Average the heights of all edges (n,), weighted by the inverse square of their distance."""
    # Tables of points by samples in one piece would need gigabytes.
    chunks = np.array_split(points, len(points) // 1000 + 1)
    return np.concatenate([_average_by_distance(chunk, samples) for chunk in chunks])


def _average_by_distance(points: Points, samples: Points) -> Float64Array:
    x, y = (points[:, k, None] - samples[None, :, k] for k in (0, 1))
    weight = 1.0 / (x * x + y * y + SOFTENING_M**2)
    return (weight @ samples[:, 2]) / weight.sum(axis=1)


def _compute_hill_height(points: Points, distance: Float64Array) -> Float64Array:
    """Compute the height (n,) of hills on the horizon, beyond the range of all sensors."""
    x, y = points.T / HILLS_START_M
    waves = 1 + 0.5 * np.sin(1.7 * x + 0.4) * np.cos(1.3 * y) + 0.4 * np.sin(2.6 * (x + y) + 1.9)
    rise = np.clip((distance - HILLS_START_M) / (2 * HILLS_START_M), 0.0, 1.0)
    return HILLS_HEIGHT_M * waves * rise**2 * (3 - 2 * rise)


def _blend_heights(distance: Float64Array, near: Float64Array, far: Float64Array) -> Float64Array:
    weight = np.exp(-((distance / VERGE_WIDTH_M) ** 2))
    return weight * near + (1.0 - weight) * far


def _are_boxes(cells: NDArray[np.object_]) -> NDArray[np.bool_]:
    west, south, east, north = shapely.bounds(cells).T
    return np.isclose(shapely.area(cells), (east - west) * (north - south), rtol=1e-9)


def _triangulate_boxes(boxes: NDArray[np.object_]) -> tuple[Points, NDArray[np.int64]]:
    """Triangulate boxes into corners (4 n, 2) and triangles (2 n, 3), counter-clockwise."""
    west, south, east, north = shapely.bounds(boxes).T
    x, y = np.stack([west, east, east, west], 1), np.stack([south, south, north, north], 1)
    first = 4 * np.arange(len(boxes))[:, None, None]
    triangles = first + np.array([(0, 1, 2), (0, 2, 3)])
    return np.column_stack([x.ravel(), y.ravel()]), triangles.reshape(-1, 3)


def _split_cells(cells: NDArray[np.object_], outline: BaseGeometry) -> NDArray[np.object_]:
    shapely.prepare(outline)
    passed = shapely.intersects(cells, outline) & ~shapely.contains_properly(outline, cells)
    parts = [
        polygon
        for cut in (shapely.intersection, shapely.difference)
        for shape in cut(cells[passed], outline)
        for polygon in extract_polygons(shape)
    ]
    return np.array([*cells[~passed], *parts], dtype=object)


def _build_grid_cells(bounds: Float64Array) -> NDArray[np.object_]:
    x, y = (_compute_grid_lines(bounds[axis], bounds[axis + 2]) for axis in (0, 1))
    west, south = (grid.ravel() for grid in np.meshgrid(x[:-1], y[:-1]))
    east, north = (grid.ravel() for grid in np.meshgrid(x[1:], y[1:]))
    return shapely.box(west, south, east, north)


def _compute_grid_lines(first: float, last: float) -> Float64Array:
    """Compute grid lines: even over the site, with growing distances beyond it."""
    inside = np.linspace(first - CELL_M, last + CELL_M, int((last - first) / CELL_M) + 3)
    count = int(np.log(1 + MARGIN_M * (GROWTH - 1) / CELL_M) / np.log(GROWTH)) + 1
    outside = CELL_M * (GROWTH ** np.arange(1, count + 1) - 1) * GROWTH / (GROWTH - 1)
    return np.concatenate([inside[0] - outside[::-1], inside, inside[-1] + outside])


def _drop_flipped_triangles(corners: Points, triangles: NDArray[np.int64]) -> NDArray[np.int64]:
    """Drop slivers turned over by rounding."""
    a, b, c = (corners[triangles[:, corner]] for corner in range(3))
    area = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    return triangles[area > GRID_M**2]


def _compute_vertex_normals(vertices: Points, triangles: NDArray[np.int64]) -> Points:
    a, b, c = (vertices[triangles[:, corner]] for corner in range(3))
    faces = np.cross(b - a, c - a)
    sums = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(sums, triangles[:, corner], faces)
    return sums / np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-12)
