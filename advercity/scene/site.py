"""Locates ground for objects off the road: sides of streets, rectangles, and free parts of them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from advercity_dsl.road import RoadsidePlacement, Season
from advercity_dsl.units import Point2
from numpy.typing import ArrayLike, NDArray
from shapely.geometry.base import BaseGeometry

from advercity.errors import InputError
from advercity.geometry.arrays import Float64Array
from advercity.geometry.polyline import left_normals, unit_vectors
from advercity.roads.streets import StreetLayout, StripLayout

FOLD_TOLERANCE_M = 0.3
"""Accepted deviation of a point's distance to the axis from its offset. On the inside of a
bend, points whose offsets go beyond its centre are back at the street."""


@dataclass(frozen=True, eq=False)
class StreetSide:
    """A band along one side of a street, or a line if it has no width.

    Attributes:
        street: The street.
        sign: 1 for its left, -1 for its right.
        start_m: Station of the band's beginning on the axis.
        end_m: Station of its end.
        near_offset_m: Offset of the nearer border, outwards from the edge of all paving.
        far_offset_m: Offset of the further border.
    """

    street: StreetLayout
    sign: int
    start_m: float
    end_m: float
    near_offset_m: float
    far_offset_m: float

    @property
    def strips(self) -> tuple[StripLayout, ...]:
        """Strips on this side of the street, from its axis outwards."""
        return self.street.strips_in_direction(along=self.sign < 0)

    @property
    def length_m(self) -> float:
        """Length along the axis."""
        return self.end_m - self.start_m

    @property
    def depth_m(self) -> float:
        """Distance between the two borders."""
        return self.far_offset_m - self.near_offset_m

    def sample_grid(self, step_m: float, row_m: float) -> Float64Array:
        """Sample points (n, m, 2): n along the street, m across."""
        along = np.linspace(0.0, self.length_m, 2 + int(self.length_m / step_m))
        across = np.arange(self.near_offset_m, self.far_offset_m + 1e-6, row_m)
        return self.points_at(*np.meshgrid(along, across, indexing="ij"))

    def points_at(self, along_m: ArrayLike, offset_m: ArrayLike) -> Float64Array:
        """Compute points (..., 2) from distances along the band and offsets from the paving."""
        station, offset = np.broadcast_arrays(
            np.asarray(along_m, dtype=np.float64) + self.start_m, offset_m
        )
        x, y = (np.interp(station, self.street.stations, self.street.axis[:, k]) for k in (0, 1))
        # Headings are interpolated, not taken per segment: borders of bends must not have steps.
        outward = self.sign * left_normals(unit_vectors(self._heading(station)))
        return np.stack([x, y], axis=-1) + (self._outer_edge_m + offset)[..., None] * outward

    def yaw(self, along_m: float) -> float:
        """Compute the heading in radians with the street on the right."""
        heading = float(self._heading(np.array(along_m + self.start_m)))
        return heading if self.sign > 0 else heading + np.pi

    def offset_line(self, offset_m: float) -> Float64Array:
        """Compute the line (n, 2) at an offset, without points folded back by a bend."""
        inner = self.street.stations - self.start_m
        inner = inner[(inner > 0.01) & (inner < self.length_m - 0.01)]
        points = self.points_at(np.concatenate([[0.0], inner, [self.length_m]]), offset_m)
        return points[self.is_unfolded(points, offset_m)]

    def space_points(self, spacing_m: float, offset_m: float) -> Float64Array:
        """Compute points (n, 2) at a spacing along the band.

        On the right they begin after half a spacing, so both sides alternate.
        """
        start = 0.0 if self.sign > 0 else spacing_m / 2
        points = self.points_at(np.arange(start, self.length_m + 1e-6, spacing_m), offset_m)
        return points[self.is_unfolded(points, offset_m)]

    def is_unfolded(self, points: Float64Array, offset_m: ArrayLike) -> NDArray[np.bool_]:
        """Test which points (..., 2) are as far from the axis as their offsets."""
        axis = shapely.LineString(self.street.axis[:, :2])
        distance = shapely.distance(shapely.points(points), axis)
        return distance > self._outer_edge_m + np.asarray(offset_m) - FOLD_TOLERANCE_M

    @property
    def _outer_edge_m(self) -> float:
        return abs(self.strips[-1].outer_t) if self.strips else 0.0

    def _heading(self, station: Float64Array) -> Float64Array:
        return np.interp(station, self.street.stations, np.unwrap(self.street.headings))


@dataclass(frozen=True, eq=False)
class Rectangle:
    """An upright rectangle between its lower and upper corner (2,), metres.

    Attributes:
        low: West and south.
        high: East and north.
    """

    low: Float64Array
    high: Float64Array

    @classmethod
    def from_corners(cls, corners: tuple[Point2, Point2]) -> "Rectangle":
        """Make the rectangle between any two opposite corners."""
        points = np.asarray(corners, dtype=np.float64)
        return cls(points.min(axis=0), points.max(axis=0))

    @property
    def extent(self) -> Float64Array:
        """Size (2,) along x and y."""
        return self.high - self.low

    @property
    def long_axis(self) -> int:
        """Axis of the longer side: 0 for x, 1 for y."""
        return int(np.argmax(self.extent))

    def sample_grid(self, step_m: float, row_m: float) -> Float64Array:
        """Sample points (n, m, 2): n along the longer side, m across."""
        long, short = self.long_axis, 1 - self.long_axis
        count = 2 + int(self.extent[long] / step_m)
        along = np.linspace(self.low[long], self.high[long], count)
        across = np.arange(self.low[short], self.high[short] + 1e-6, row_m)
        grid = np.meshgrid(along, across, indexing="ij")
        return np.stack(grid if long == 0 else grid[::-1], axis=-1)


def resolve_street_sides(
    beside: RoadsidePlacement, streets: Mapping[str, StreetLayout]
) -> list[StreetSide]:
    """Find the sides of a declaration's street; InputError if the street is shorter."""
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
    """Ground off the road, and its reserved part.

    Attributes:
        ground_height: Height of the ground.
        reserved_area: Area without objects: paving, buildings, surroundings of sensors.
        street_axes: Axes of the streets.
        paved_area: Roadways and sidewalks alone.
        season: Season of its plants.
    """

    ground_height: GroundHeight
    reserved_area: BaseGeometry
    street_axes: BaseGeometry
    paved_area: BaseGeometry
    season: Season = Season.SUMMER

    def exclude(self, areas: Sequence[BaseGeometry]) -> "Site":
        """Return the site with more area reserved."""
        reserved = shapely.union_all([self.reserved_area, *areas])
        shapely.prepare(reserved)
        return replace(self, reserved_area=reserved)

    def project_to_ground(self, points: ArrayLike) -> Float64Array:
        """Add the height of the ground to points (n, 2), giving (n, 3)."""
        plane = np.atleast_2d(np.asarray(points, dtype=np.float64))
        return np.column_stack([plane, self.ground_height(plane)])

    def is_free(self, points: ArrayLike, margin_m: float) -> NDArray[np.bool_]:
        """Test which points (n, 2) are at least a margin away from the reserved area."""
        plane = np.atleast_2d(np.asarray(points, dtype=np.float64))
        return np.asarray(shapely.distance(self.reserved_area, shapely.points(plane)) >= margin_m)

    def yaw_to_street(self, point: Point2) -> float:
        """Compute the heading in radians from a point towards the nearest street."""
        here = shapely.Point(point)
        nearest = shapely.shortest_line(here, self.street_axes)
        dx, dy = np.diff(np.asarray(nearest.coords)[:, :2], axis=0)[0]
        return float(np.arctan2(dy, dx))


def space_points_along(line: tuple[Point2, ...], spacing_m: float) -> Float64Array:
    """Compute points (n, 2) at a spacing along a line, from its start."""
    if len(line) < 2:
        return np.empty((0, 2))
    path = shapely.LineString(line)
    stations = np.arange(0.0, path.length + 1e-6, spacing_m)
    return shapely.get_coordinates(shapely.line_interpolate_point(path, stations))


def sample_ground_line(line: Sequence[Point2], step_m: float, site: Site) -> Float64Array:
    """Sample points (n, 3) on the ground along a line at most a step apart, with both ends."""
    path = shapely.LineString(line)
    count = max(1, int(np.ceil(path.length / step_m)))
    at = np.linspace(0.0, path.length, count + 1)
    return site.project_to_ground(shapely.get_coordinates(shapely.line_interpolate_point(path, at)))
