"""Pieces of surface and how they are put together into a mesh."""

from collections.abc import Iterable
from dataclasses import dataclass

import mapbox_earcut
import numpy as np
import shapely
from numpy.typing import NDArray

from advercity.curves import Points
from advercity.semantics import Semantic
from advercity.world.scene import Mesh


@dataclass(frozen=True)
class Piece:
    """Triangles (m, 3) into vertices (n, 3), counter-clockwise seen from outside."""

    vertices: Points
    triangles: NDArray[np.int64]


def ribbon(left: Points, right: Points) -> Piece:
    """Surface between two lines (n, 3), seen from the side where `left` is on the left."""
    count = len(left)
    near = np.arange(count - 1)
    first = np.stack([near, near + count, near + count + 1], axis=1)
    second = np.stack([near, near + count + 1, near + 1], axis=1)
    return Piece(np.vstack([left, right]), np.vstack([first, second]))


def filled(polygon: shapely.Polygon) -> tuple[Points, NDArray[np.int64]]:
    """Corners (n, 2) of a polygon, holes included, and triangles (m, 3), counter-clockwise."""
    rings = [np.asarray(ring.coords)[:-1] for ring in (polygon.exterior, *polygon.interiors)]
    corners = np.concatenate(rings)
    ends = np.cumsum([len(ring) for ring in rings]).astype(np.uint32)
    triangles = mapbox_earcut.triangulate_float64(corners, ends).reshape(-1, 3).astype(np.int64)
    a, b, c = (corners[triangles[:, i]] for i in range(3))
    area = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    triangles[area < 0] = triangles[area < 0][:, ::-1]
    return corners, triangles[np.abs(area) > 1e-9]


def polygons_of(shape: shapely.Geometry) -> list[shapely.Polygon]:
    """The polygons in a geometry."""
    parts = [shape] if isinstance(shape, shapely.Polygon) else getattr(shape, "geoms", [])
    return [part for part in parts if isinstance(part, shapely.Polygon) and not part.is_empty]


def cells(bounds: tuple[float, float, float, float], size_m: float) -> NDArray[np.object_]:
    """Squares that cover a box (west, south, east, north)."""
    x, y = (np.arange(bounds[axis], bounds[axis + 2], size_m)[:, None] for axis in (0, 1))
    west, south = (grid.ravel() for grid in np.meshgrid(x, y))
    return shapely.box(west, south, west + size_m, south + size_m)


def mesh(name: str, pieces: Iterable[Piece], material: str, semantic: Semantic) -> Mesh:
    """One mesh of all pieces; flat faces."""
    pieces = list(pieces)
    shifts = np.cumsum([0, *(len(piece.vertices) for piece in pieces)])
    triangles = [p.triangles + shift for p, shift in zip(pieces, shifts, strict=False)]
    return Mesh(
        name=name,
        vertices=np.concatenate([piece.vertices for piece in pieces]).astype(np.float32),
        triangles=np.concatenate(triangles).astype(np.int32),
        material=material,
        semantic=semantic,
    )
