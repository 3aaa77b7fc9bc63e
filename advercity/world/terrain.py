"""The ground around a road: level with the road's edge beside it, rolling between roads.

It is a grid with the road's footprint cut out, so nothing of it can show through the road.
"""

from collections.abc import Iterator

import numpy as np
import shapely
from advercity_dsl.road import StripKind
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from advercity.semantics import Semantic
from advercity.world.curves import Points, resampled, stations
from advercity.world.layout import Layout
from advercity.world.meshing import filled, mesh, polygons_of, ribbon
from advercity.world.scene import Mesh
from advercity.world.streets import Band, StreetLayout

MARGIN_M = 160.0
"""How far the ground goes on beyond the outermost street."""
CELL_M = 4.0
GROWTH = 1.35
"""Of one cell over the last, beyond the site."""
VERGE_M = 9.0
"""Within about this distance the ground follows the edge of the road."""
SOFTENING_M = 5.0
SNAP_M = 0.001
OVERLAP_M = 0.05
"""How far the ground reaches under the road, so that no crack opens between them."""
DROP_M = 0.004
SKIRT_M = 0.1


def ground(layout: Layout, *, kerb_height_m: float) -> Mesh:
    """Grass around the streets, out to `MARGIN_M` beyond them.

    Args:
        layout: The road.
        kerb_height_m: Height of sidewalks above the roadway; the ground meets their top.
    """
    built = shapely.buffer(footprint(layout), -OVERLAP_M, join_style="mitre")
    cells = _cells(shapely.bounds(built))
    shapely.prepare(built)
    free = shapely.disjoint(cells, built)
    cut = shapely.difference(cells[~free], built)
    polygons = [*cells[free], *(polygon for shape in cut for polygon in polygons_of(shape))]
    parts = [filled(polygon) for polygon in polygons]
    corners = np.concatenate([corners for corners, _ in parts])
    shifts = np.cumsum([0, *(len(corners) for corners, _ in parts)])
    triangles = np.concatenate(
        [part + shift for (_, part), shift in zip(parts, shifts, strict=False)]
    )
    corners, merged = np.unique(np.round(corners, 3), axis=0, return_inverse=True)
    triangles = _upright(corners, merged.reshape(-1)[triangles])
    z = ground_height(layout, corners, kerb_height_m=kerb_height_m)
    vertices = np.column_stack([corners, z - DROP_M])
    return Mesh(
        name="ground",
        vertices=vertices.astype(np.float32),
        triangles=triangles.astype(np.int32),
        material="grass",
        semantic=Semantic.TERRAIN,
        normals=_normals(vertices, triangles).astype(np.float32),
    )


def skirt(layout: Layout, *, kerb_height_m: float) -> Mesh:
    """Upright faces below the edge of all paving, which close the step down to the ground."""
    down = np.array([0.0, 0.0, SKIRT_M])
    pieces = [ribbon(rim, rim - down) for rim in _rims(layout, kerb_height_m)]
    return mesh("skirt", pieces, "asphalt", Semantic.ROAD)


def ground_height(layout: Layout, points: Points, *, kerb_height_m: float) -> NDArray[np.float64]:
    """Height (n,) of the ground at points (n, 2) beside the road.

    Near a road it is the height of the nearest point on its edge, further off the mean of all
    edges, weighted by the inverse square of their distance.
    """
    rims = list(_rims(layout, kerb_height_m))
    starts = np.concatenate([rim[:-1] for rim in rims])
    steps = np.concatenate([np.diff(rim, axis=0) for rim in rims])
    samples = np.concatenate(
        [resampled(rim, max(2, int(stations(rim)[-1] / CELL_M) + 1)) for rim in rims]
    )
    return np.concatenate(
        [
            _blended(chunk, starts, steps, samples)
            for chunk in np.array_split(points, len(points) // 1000 + 1)
        ]
    )


def _blended(points: Points, starts: Points, steps: Points, samples: Points) -> Points:
    relative = points[:, None] - starts[None, :, :2]
    squared = np.maximum((steps[:, :2] ** 2).sum(axis=1), 1e-12)
    share = np.clip((relative * steps[None, :, :2]).sum(axis=2) / squared, 0.0, 1.0)
    gap = np.linalg.norm(relative - share[..., None] * steps[None, :, :2], axis=2)
    nearest = gap.argmin(axis=1)
    row = np.arange(len(points))
    beside = starts[nearest, 2] + share[row, nearest] * steps[nearest, 2]
    weight = 1.0 / (((points[:, None] - samples[None, :, :2]) ** 2).sum(axis=2) + SOFTENING_M**2)
    rolling = (weight @ samples[:, 2]) / weight.sum(axis=1)
    follow = np.exp(-((gap[row, nearest] / VERGE_M) ** 2))
    return follow * beside + (1.0 - follow) * rolling


def _rims(layout: Layout, kerb_height_m: float) -> Iterator[Points]:
    """Edges (n, 3) of all paving, with it on their left, at the height that the ground meets."""

    def lifted(line: Points, raised: bool) -> Points:
        return line + np.array([0.0, 0.0, kerb_height_m * raised])

    for street in layout.streets.values():
        left, right = (street.line(t) for t in _reach(street))
        yield lifted(left[::-1], _is_raised(street.left))
        yield lifted(right, _is_raised(street.right))
        if street.begins not in layout.junctions:
            yield np.stack([left[0], right[0]])
        if street.ends not in layout.junctions:
            yield np.stack([right[-1], left[-1]])
    for junction in layout.junctions.values():
        following = (*junction.arms[1:], junction.arms[0])
        for corner, arm, other in zip(junction.corners, junction.arms, following, strict=True):
            rim = lifted(corner.rim, corner.back is not None)
            if corner.back is None:
                rim[0, 2] += kerb_height_m * _is_raised(arm.bands(leftwards=True))
                rim[-1, 2] += kerb_height_m * _is_raised(other.bands(leftwards=False))
            yield rim


def _is_raised(bands: tuple[Band, ...]) -> bool:
    return bool(bands) and bands[-1].kind is StripKind.SIDEWALK


def _reach(street: StreetLayout) -> tuple[float, float]:
    """Offsets of the outer edges of a street, left and right."""
    return (
        street.left[-1].outer_t if street.left else 0.0,
        street.right[-1].outer_t if street.right else 0.0,
    )


def footprint(layout: Layout) -> BaseGeometry:
    """What streets and junctions cover, sidewalks included."""
    shapes: list[shapely.Geometry] = []
    for street in layout.streets.values():
        left, right = (street.line(t)[:, :2] for t in _reach(street))
        shapes.append(shapely.make_valid(shapely.Polygon(np.vstack([left, right[::-1]]))))
    for junction in layout.junctions.values():
        rim = np.concatenate([corner.rim[:, :2] for corner in junction.corners])
        shapes.append(shapely.make_valid(shapely.Polygon(rim)))
    return shapely.union_all(shapes, grid_size=SNAP_M)


def _cells(bounds: NDArray[np.float64]) -> NDArray[np.object_]:
    x, y = (_breaks(bounds[axis], bounds[axis + 2]) for axis in (0, 1))
    west, south = (grid.ravel() for grid in np.meshgrid(x[:-1], y[:-1]))
    east, north = (grid.ravel() for grid in np.meshgrid(x[1:], y[1:]))
    return shapely.box(west, south, east, north)


def _breaks(first: float, last: float) -> NDArray[np.float64]:
    """Grid lines: even over the site, further and further apart beyond it."""
    inside = np.linspace(first - CELL_M, last + CELL_M, int((last - first) / CELL_M) + 3)
    count = int(np.log(1 + MARGIN_M * (GROWTH - 1) / CELL_M) / np.log(GROWTH)) + 1
    outside = CELL_M * (GROWTH ** np.arange(1, count + 1) - 1) * GROWTH / (GROWTH - 1)
    return np.concatenate([inside[0] - outside[::-1], inside, inside[-1] + outside])


def _upright(corners: Points, triangles: NDArray[np.int64]) -> NDArray[np.int64]:
    """Triangles without the slivers that rounding has turned over."""
    a, b, c = (corners[triangles[:, corner]] for corner in range(3))
    area = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    return triangles[area > SNAP_M**2]


def _normals(vertices: Points, triangles: NDArray[np.int64]) -> Points:
    a, b, c = (vertices[triangles[:, corner]] for corner in range(3))
    faces = np.cross(b - a, c - a)
    sums = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(sums, triangles[:, corner], faces)
    return sums / np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-12)
