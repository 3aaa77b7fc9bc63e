"""Places along a street, where things stand beside it."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import shapely
from advercity_dsl.road import Beside
from numpy.typing import ArrayLike, NDArray

from advercity.curves import left_of, unit
from advercity.errors import InputError
from advercity.streets import Band, StreetLayout

Floats = NDArray[np.float64]
FOLD_M = 0.3
"""By so much less than its offset a place may be off the axis; on the inside of a bend, offsets
beyond the bend's centre lead back to the street."""


@dataclass(frozen=True, eq=False)
class Side:
    """One side of a stretch of a street.

    Attributes:
        street: The street.
        sign: 1 for its left, -1 for its right.
        first_m: Where the stretch begins, along the axis.
        last_m: Where it ends.
        near_m: Offset of the nearer border, outwards from the edge of all paving.
        far_m: Offset of the further border; the same for a line.
    """

    street: StreetLayout
    sign: int
    first_m: float
    last_m: float
    near_m: float
    far_m: float

    @property
    def bands(self) -> tuple[Band, ...]:
        """The strips on this side of the street, from its axis outwards."""
        return self.street.side(along=self.sign < 0)

    @property
    def length_m(self) -> float:
        """Of the stretch."""
        return self.last_m - self.first_m

    def at(self, along_m: ArrayLike, offset_m: ArrayLike) -> Floats:
        """(..., 2) points, `along_m` from the stretch's beginning."""
        station, offset = np.broadcast_arrays(
            np.asarray(along_m, dtype=np.float64) + self.first_m, offset_m
        )
        x, y = (np.interp(station, self.street.stations, self.street.axis[:, k]) for k in (0, 1))
        outward = self.sign * left_of(unit(self._heading(station)))
        return np.stack([x, y], axis=-1) + (self._edge_m + offset)[..., None] * outward

    def yaw(self, along_m: float) -> float:
        """Heading in radians with the street on the right."""
        heading = float(self._heading(np.array(along_m + self.first_m)))
        return heading if self.sign > 0 else heading + np.pi

    def line(self, offset_m: float) -> Floats:
        """(n, 2) points at an offset, without those that a bend leads back to the street."""
        inner = self.street.stations - self.first_m
        inner = inner[(inner > 0.01) & (inner < self.length_m - 0.01)]
        points = self.at(np.concatenate([[0.0], inner, [self.length_m]]), offset_m)
        return points[self.holds(points, offset_m)]

    def spread(self, spacing_m: float, offset_m: float) -> Floats:
        """(n, 2) points at a spacing along the stretch, from its beginning.

        On the right they begin after half a spacing, so that both sides alternate.
        """
        start = 0.0 if self.sign > 0 else spacing_m / 2
        points = self.at(np.arange(start, self.length_m + 1e-6, spacing_m), offset_m)
        return points[self.holds(points, offset_m)]

    def holds(self, points: Floats, offset_m: ArrayLike) -> NDArray[np.bool_]:
        """Whether points (..., 2) are as far from the axis as their offsets say."""
        axis = shapely.LineString(self.street.axis[:, :2])
        away = shapely.distance(shapely.points(points), axis)
        return away > self._edge_m + np.asarray(offset_m) - FOLD_M

    @property
    def _edge_m(self) -> float:
        return abs(self.bands[-1].outer_t) if self.bands else 0.0

    def _heading(self, station: Floats) -> Floats:
        return np.interp(station, self.street.stations, np.unwrap(self.street.headings))


def sides(beside: Beside, streets: Mapping[str, StreetLayout]) -> list[Side]:
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
    return [Side(street, sign, beside.from_m, last, *beside.band_m) for sign in signs]
