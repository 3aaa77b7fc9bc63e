"""Places along a street, where things stand beside it.

The ground beside a road, and where on it things may stand.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from advercity_dsl.road import RoadsidePlacement
from advercity_dsl.units import Point2
from numpy.typing import ArrayLike, NDArray
from shapely.geometry.base import BaseGeometry

from advercity.errors import InputError
from advercity.geometry.arrays import Float64Array
from advercity.geometry.polyline import left_normals, unit_vectors
from advercity.roads.streets import StreetLayout, StripLayout

FOLD_TOLERANCE_M = 0.3
"""By so much less than its offset a place may be off the axis; on the inside of a bend, offsets
beyond the bend's centre lead back to the street."""


@dataclass(frozen=True, eq=False)
class StreetSide:
    """One side of a stretch of a street.

    Attributes:
        street: The street.
        sign: 1 for its left, -1 for its right.
        start_m: Where the stretch begins, along the axis.
        end_m: Where it ends.
        near_offset_m: Offset of the nearer border, outwards from the edge of all paving.
        far_offset_m: Offset of the further border; the same for a line.
    """

    street: StreetLayout
    sign: int
    start_m: float
    end_m: float
    near_offset_m: float
    far_offset_m: float

    @property
    def strips(self) -> tuple[StripLayout, ...]:
        """The strips on this side of the street, from its axis outwards."""
        return self.street.strips_in_direction(along=self.sign < 0)

    @property
    def length_m(self) -> float:
        """Of the stretch."""
        return self.end_m - self.start_m

    def points_at(self, along_m: ArrayLike, offset_m: ArrayLike) -> Float64Array:
        """(..., 2) points, `along_m` from the stretch's beginning."""
        station, offset = np.broadcast_arrays(
            np.asarray(along_m, dtype=np.float64) + self.start_m, offset_m
        )
        x, y = (np.interp(station, self.street.stations, self.street.axis[:, k]) for k in (0, 1))
        outward = self.sign * left_normals(unit_vectors(self._heading(station)))
        return np.stack([x, y], axis=-1) + (self._outer_edge_m + offset)[..., None] * outward

    def yaw(self, along_m: float) -> float:
        """Heading in radians with the street on the right."""
        heading = float(self._heading(np.array(along_m + self.start_m)))
        return heading if self.sign > 0 else heading + np.pi

    def offset_line(self, offset_m: float) -> Float64Array:
        """(n, 2) points at an offset, without those that a bend leads back to the street."""
        inner = self.street.stations - self.start_m
        inner = inner[(inner > 0.01) & (inner < self.length_m - 0.01)]
        points = self.points_at(np.concatenate([[0.0], inner, [self.length_m]]), offset_m)
        return points[self.is_unfolded(points, offset_m)]

    def space_points(self, spacing_m: float, offset_m: float) -> Float64Array:
        """(n, 2) points at a spacing along the stretch, from its beginning.

        On the right they begin after half a spacing, so that both sides alternate.
        """
        start = 0.0 if self.sign > 0 else spacing_m / 2
        points = self.points_at(np.arange(start, self.length_m + 1e-6, spacing_m), offset_m)
        return points[self.is_unfolded(points, offset_m)]

    def is_unfolded(self, points: Float64Array, offset_m: ArrayLike) -> NDArray[np.bool_]:
        """Whether points (..., 2) are as far from the axis as their offsets say."""
        axis = shapely.LineString(self.street.axis[:, :2])
        away = shapely.distance(shapely.points(points), axis)
        return away > self._outer_edge_m + np.asarray(offset_m) - FOLD_TOLERANCE_M

    @property
    def _outer_edge_m(self) -> float:
        return abs(self.strips[-1].outer_t) if self.strips else 0.0

    def _heading(self, station: Float64Array) -> Float64Array:
        return np.interp(station, self.street.stations, np.unwrap(self.street.headings))


def resolve_street_sides(
    beside: RoadsidePlacement, streets: Mapping[str, StreetLayout]
) -> list[StreetSide]:
    """The sides of its street that a declaration means; InputError if it ends before."""
    street = streets[beside.street]
    length = float(street.stations[-1])
    if beside.from_m >= length:
        raise InputError(
            f"from_m is {beside.from_m:g}, but the street '{beside.street}' is only"
            f" {length:.1f} m long"
        )
    signs = {"left": (1,), "right": (-1,), "both": (1, -1)}[beside.side]
    last = min(beside.to_m or length, length)
    return [StreetSide(street, sign, beside.from_m, last, *beside.band_m) for sign in signs]


GroundHeight = Callable[[Float64Array], Float64Array]
"""World positions (n, 2) to heights (n,), metres."""


@dataclass(frozen=True, eq=False)
class Site:
    """Where things stand beside a road.

    Attributes:
        ground_height: Height of the ground.
        reserved_area: What must stay free: roadways, sidewalks, and sensors with their
            surroundings.
        street_axes: Axes of the streets.
    """

    ground_height: GroundHeight
    reserved_area: BaseGeometry
    street_axes: BaseGeometry

    def exclude(self, taken: Sequence[BaseGeometry]) -> "Site":
        """The site less ground that something has taken."""
        free = shapely.union_all([self.reserved_area, *taken])
        shapely.prepare(free)
        return replace(self, reserved_area=free)

    def project_to_ground(self, points: ArrayLike) -> Float64Array:
        """Points (n, 2) with their heights, (n, 3)."""
        plane = np.atleast_2d(np.asarray(points, dtype=np.float64))
        return np.column_stack([plane, self.ground_height(plane)])

    def is_free(self, points: ArrayLike, margin_m: float) -> NDArray[np.bool_]:
        """Whether points (n, 2) keep at least a margin from what must stay free."""
        plane = np.atleast_2d(np.asarray(points, dtype=np.float64))
        return np.asarray(shapely.distance(self.reserved_area, shapely.points(plane)) >= margin_m)

    def yaw_to_street(self, point: Point2) -> float:
        """Heading in radians from a point towards the nearest street."""
        here = shapely.Point(point)
        nearest = shapely.shortest_line(here, self.street_axes)
        dx, dy = np.diff(np.asarray(nearest.coords)[:, :2], axis=0)[0]
        return float(np.arctan2(dy, dx))


def rectangle_corners(area: tuple[Point2, Point2]) -> tuple[Float64Array, Float64Array]:
    """Lower and upper corner (2,) of a rectangle given by any two opposite corners."""
    corners = np.asarray(area, dtype=np.float64)
    return corners.min(axis=0), corners.max(axis=0)


def space_points_along(line: tuple[Point2, ...], spacing_m: float) -> Float64Array:
    """Points (n, 2) at a spacing along a line, its start included."""
    if len(line) < 2:
        return np.empty((0, 2))
    path = shapely.LineString(line)
    stations = np.arange(0.0, path.length + 1e-6, spacing_m)
    return shapely.get_coordinates(shapely.line_interpolate_point(path, stations))
