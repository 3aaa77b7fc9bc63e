"""Streets, sampled, with their strips side by side.

Across a street, `t` is the offset from its axis in metres, positive to the left of the axis'
direction. Traffic drives on the right: strips at negative `t` are travelled along the axis (`+`),
those at positive `t` against it (`-`).
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from advercity_dsl.road import CrossSection, Paint, Road, Street, StripKind
from numpy.typing import ArrayLike, NDArray

from advercity import curves
from advercity.curves import Points

LEVEL_STEP_M = 8.0
"""Distance between samples on level lines."""
SLOPED_STEP_M = 2.0


@dataclass(frozen=True)
class Band:
    """A strip, placed from `inner_t` near the axis to `outer_t`; its paint is on the outer edge."""

    kind: StripKind
    inner_t: float
    outer_t: float
    paint: Paint | None
    number: int
    """Of a driving lane, counted from 1, the innermost; 0 for other strips."""
    bay_m: float | None = None
    """Width of its parking bays."""

    @property
    def along(self) -> bool:
        """Whether it is travelled along the axis."""
        return self.outer_t < 0

    @property
    def width_m(self) -> float:
        """From edge to edge."""
        return abs(self.outer_t - self.inner_t)

    @property
    def centre_t(self) -> float:
        """Midway between its edges."""
        return (self.inner_t + self.outer_t) / 2


@dataclass(frozen=True)
class StreetLayout:
    """A street, sampled.

    Attributes:
        id: As declared.
        begins: Junction or edge of the site at its start.
        ends: The same at its end.
        axis: (n, 3) points, ends exact.
        headings: (n,) radians.
        stations: (n,) metres along the axis.
        left: Bands from the axis to the left.
        right: Bands from the axis to the right.
        axis_paint: Line painted on the axis.
        speed_limit_m_s: For both directions.
    """

    id: str
    begins: str
    ends: str
    axis: Points
    headings: NDArray[np.float64]
    stations: NDArray[np.float64]
    left: tuple[Band, ...]
    right: tuple[Band, ...]
    axis_paint: Paint | None
    speed_limit_m_s: float

    def line(self, t: float) -> Points:
        """(n, 3) points at offset `t`, in the direction of the axis."""
        plane = curves.offset(self.axis[:, :2], self.headings, t)
        return np.column_stack([plane, self.axis[:, 2]])

    def at(self, station: ArrayLike, t: ArrayLike) -> Points:
        """(..., 3) points at distances along the axis and offsets from it, on its facets."""
        station, t = np.broadcast_arrays(station, t)
        x, y, z, heading = (
            np.interp(station, self.stations, column)
            for column in (*self.axis.T, np.unwrap(self.headings))
        )
        plane = curves.offset(np.stack([x, y], axis=-1), heading, t)
        return np.concatenate([plane, z[..., None]], axis=-1)

    def travelled(self, t: float, *, along: bool) -> Points:
        """(n, 3) points at offset `t`, in the direction of travel."""
        return self.line(t) if along else self.line(t)[::-1]

    def side(self, *, along: bool) -> tuple[Band, ...]:
        """Bands that are travelled that way, from the axis outwards."""
        return self.right if along else self.left

    def lane(self, number: int, *, along: bool) -> Band:
        """A driving lane; 1 is the innermost."""
        return next(band for band in self.side(along=along) if band.number == number)


def lay_street(name: str, declared: Street, road: Road) -> StreetLayout:
    """Sample a declared street of a road."""
    section = road.sections[declared.section]
    plane, headings, along = curves.axis(
        declared.start_m,
        np.radians(declared.heading_deg),
        declared.path,
        line_step_m=SLOPED_STEP_M if len(declared.heights) > 1 else LEVEL_STEP_M,
    )
    return StreetLayout(
        id=name,
        begins=declared.begins,
        ends=declared.ends,
        axis=np.column_stack([plane, curves.heights(along, declared.heights)]),
        headings=headings,
        stations=along,
        left=_bands(section, leftwards=True),
        right=_bands(section, leftwards=False),
        axis_paint=section.axis_line,
        speed_limit_m_s=declared.speed_limit_km_h / 3.6,
    )


def _bands(section: CrossSection, *, leftwards: bool) -> tuple[Band, ...]:
    strips = section.left if leftwards else section.right
    sign = 1.0 if leftwards else -1.0
    edges = sign * np.concatenate([[0.0], np.cumsum([strip.width_m for strip in strips])])
    lanes = np.cumsum([strip.kind is StripKind.LANE for strip in strips])
    return tuple(
        Band(
            kind=strip.kind,
            inner_t=float(inner),
            outer_t=float(outer),
            paint=strip.line,
            number=int(number) if strip.kind is StripKind.LANE else 0,
            bay_m=strip.bay_m,
        )
        for strip, (inner, outer), number in zip(strips, pairwise(edges), lanes, strict=True)
    )
