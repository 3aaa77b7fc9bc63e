"""Lays areas of the plan onto triangles in space."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from advercity.geometry.mesh import TriangleSurface
from advercity.geometry.polyline import Points

MAX_DRAPE_M = 1.5
"""Greatest difference between the heights of an area and of the triangles below it."""


@dataclass(frozen=True, eq=False)
class DrapeBase:
    """Triangles for areas to lie on.

    Attributes:
        corners: (n, 3, 3) corners, none upright.
    """

    corners: Points

    @cached_property
    def _facets(self) -> NDArray[np.object_]:
        return np.array(shapely.polygons(self.corners[:, [0, 1, 2, 0], :2]))

    @cached_property
    def _tree(self) -> shapely.STRtree:
        return shapely.STRtree(self._facets)

    def drape(self, areas: Sequence[BaseGeometry], z_m: Sequence[float]) -> TriangleSurface:
        """Lay convex areas on the triangles nearest to their heights."""
        shapes = np.array(areas, dtype=np.object_)
        area, facet = self._tree.query(shapes, predicate="intersects")
        height, z = self.corners[facet, :, 2], np.asarray(z_m)[area]
        away = np.maximum(height.min(axis=1) - z, z - height.max(axis=1))
        area, facet = area[away < MAX_DRAPE_M], facet[away < MAX_DRAPE_M]
        pieces = shapely.intersection(shapes[area], self._facets[facet])
        return _lift_to_planes(pieces, self.corners[facet])


def _lift_to_planes(pieces: NDArray[np.object_], facets: Points) -> TriangleSurface:
    """Triangulate convex polygons (n,), each in the plane of a triangle (n, 3, 3)."""
    flat = shapely.get_type_id(pieces) == shapely.GeometryType.POLYGON
    rings = shapely.get_exterior_ring(shapely.orient_polygons(pieces[flat]))
    plane, ring = shapely.get_coordinates(rings, return_index=True)
    corner = facets[flat, 0]
    normal = np.cross(facets[flat, 1] - corner, facets[flat, 2] - corner)
    slope = -normal[:, :2] / normal[:, 2:]
    z = corner[ring, 2] + ((plane - corner[ring, :2]) * slope[ring]).sum(axis=1)
    first = np.searchsorted(ring, ring)
    # A fan about the first corner of each ring, whose last corner is the first again.
    second = np.arange(len(ring) - 1)
    inside = (second > first[:-1]) & (ring[second] == ring[second + 1])
    fan = np.stack([first[:-1], second, second + 1], axis=1)[inside]
    return TriangleSurface(np.column_stack([plane, z]), fan)
