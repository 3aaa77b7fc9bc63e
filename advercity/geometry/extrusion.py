"""Solids between two heights over an area of the plan."""

from collections.abc import Callable, Iterator

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from advercity.geometry.mesh import (
    TriangleSurface,
    build_grid_cells,
    build_ribbon,
    extract_polygons,
    triangulate_polygon,
)
from advercity.geometry.polyline import Points

Heights = Callable[[Points], NDArray[np.float64]]
"""Heights (n,) in metres at points (n, 2)."""


def extrude_area(
    area: BaseGeometry, bottom: Heights, top: Heights, facet_m: float
) -> Iterator[TriangleSurface]:
    """Build top, bottom and sides of a solid, in facets of a size; all faces look outward."""
    for polygon in extract_polygons(area):
        cut = shapely.intersection(build_grid_cells(polygon.bounds, facet_m), polygon)
        for cell in (part for shape in cut for part in extract_polygons(shape)):
            corners, triangles = triangulate_polygon(cell)
            yield TriangleSurface(np.column_stack([corners, top(corners)]), triangles)
            below = np.column_stack([corners, bottom(corners)])
            yield TriangleSurface(below, triangles[:, ::-1])
        upright = shapely.orient_polygons(polygon)
        for ring in (upright.exterior, *upright.interiors):
            plane = shapely.get_coordinates(shapely.segmentize(ring, facet_m))
            high, low = (np.column_stack([plane, side(plane)]) for side in (top, bottom))
            yield build_ribbon(high, low)
