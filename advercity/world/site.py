"""The ground beside a road, and where on it things may stand."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from advercity_dsl.base import Point2
from numpy.typing import ArrayLike, NDArray
from shapely.geometry.base import BaseGeometry

Floats = NDArray[np.float64]
GroundHeight = Callable[[Floats], Floats]
"""World positions (n, 2) to heights (n,), metres."""


@dataclass(frozen=True, eq=False)
class Site:
    """Where things stand beside a road.

    Attributes:
        ground_height: Height of the ground.
        keep_off: What must stay free: roadways, sidewalks, and sensors with their surroundings.
        axes: Axes of the streets.
    """

    ground_height: GroundHeight
    keep_off: BaseGeometry
    axes: BaseGeometry

    def without(self, taken: Sequence[BaseGeometry]) -> "Site":
        """The site less ground that something has taken."""
        free = shapely.union_all([self.keep_off, *taken])
        shapely.prepare(free)
        return replace(self, keep_off=free)

    def on_ground(self, points: ArrayLike) -> Floats:
        """Points (n, 2) with their heights, (n, 3)."""
        plane = np.atleast_2d(np.asarray(points, dtype=np.float64))
        return np.column_stack([plane, self.ground_height(plane)])

    def is_free(self, points: ArrayLike, margin_m: float) -> NDArray[np.bool_]:
        """Whether points (n, 2) keep at least a margin from what must stay free."""
        plane = np.atleast_2d(np.asarray(points, dtype=np.float64))
        return np.asarray(shapely.distance(self.keep_off, shapely.points(plane)) >= margin_m)

    def yaw_to_street(self, point: Point2) -> float:
        """Heading in radians from a point towards the nearest street."""
        here = shapely.Point(point)
        nearest = shapely.shortest_line(here, self.axes)
        dx, dy = np.diff(np.asarray(nearest.coords)[:, :2], axis=0)[0]
        return float(np.arctan2(dy, dx))


def rectangle(area: tuple[Point2, Point2]) -> tuple[Floats, Floats]:
    """Lower and upper corner (2,) of a rectangle given by any two opposite corners."""
    corners = np.asarray(area, dtype=np.float64)
    return corners.min(axis=0), corners.max(axis=0)


def along(line: tuple[Point2, ...], spacing_m: float) -> Floats:
    """Points (n, 2) at a spacing along a line, its start included."""
    if len(line) < 2:
        return np.empty((0, 2))
    path = shapely.LineString(line)
    stations = np.arange(0.0, path.length + 1e-6, spacing_m)
    return shapely.get_coordinates(shapely.line_interpolate_point(path, stations))
