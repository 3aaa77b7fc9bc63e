"""Sampled streets with their strips side by side, and the ids of their edges in SUMO.

Across a street, `t` is the offset from its axis in metres, positive to the left of the axis'
direction. Traffic drives on the right: strips at negative `t` are travelled along the axis (`+`),
strips at positive `t` against it (`-`). So a street has up to two edges in the SUMO network,
`<street>+` and `<street>-`. Left-hand roads are mirrored first (`plan_frame`).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from advercity_dsl.road import CrossSection, Road, RoadMark, Street, StripKind
from advercity_dsl.units import KM_H_PER_M_S
from numpy.typing import ArrayLike, NDArray

from advercity.geometry import curves, polyline
from advercity.geometry.polyline import Points, StationedPolyline
from advercity.identity_cache import cache_by_identity

MAX_LEVEL_STEP_M = 8.0
"""Largest distance between samples of level lines."""
MAX_SLOPED_STEP_M = 2.0
"""The same where heights are declared: short enough for vertical curves."""
MAX_LAID_OUT_ROADS = 64


@dataclass(frozen=True)
class StripLayout:
    """A strip from `inner_t` near the axis to `outer_t`; its paint is on the outer edge."""

    kind: StripKind
    inner_t: float
    outer_t: float
    paint: RoadMark | None
    lane_number: int
    """Number of a driving lane, 1 is the innermost; 0 for other strips."""
    bay_width_m: float | None = None
    """Width of its parking bays along the street, if it has any."""

    @property
    def width_m(self) -> float:
        """Distance between its edges."""
        return abs(self.outer_t - self.inner_t)

    @property
    def centre_t(self) -> float:
        """Offset of its middle."""
        return (self.inner_t + self.outer_t) / 2


@dataclass(frozen=True)
class StreetLayout:
    """A street, sampled.

    Attributes:
        id: Declared id.
        begins: Id of the junction, or of the edge of the site, at its start.
        ends: Id of the junction, or of the edge of the site, at its end.
        axis: (n, 3) points; the ends are exact.
        headings: (n,) tangents of the curve, radians, which chords are only close to.
        stations: (n,) arc lengths in metres, not sums of chords.
        left_strips: Strips left of the axis, from the axis outwards.
        right_strips: Strips right of the axis, from the axis outwards.
        axis_paint: Line painted on the axis.
        speed_limit_m_s: Limit in both directions.
        is_left_hand: Whether it is the mirror image of a street, with traffic on the left.
    """

    id: str
    begins: str
    ends: str
    axis: Points
    headings: NDArray[np.float64]
    stations: NDArray[np.float64]
    left_strips: tuple[StripLayout, ...]
    right_strips: tuple[StripLayout, ...]
    axis_paint: RoadMark | None
    speed_limit_m_s: float
    is_left_hand: bool = False

    def offset_line(self, t: float) -> Points:
        """Compute points (n, 3) at offset `t`, in the direction of the axis."""
        plane = polyline.offset_points(self.axis[:, :2], self.headings, t)
        return np.column_stack([plane, self.axis[:, 2]])

    def points_at(self, station: ArrayLike, t: ArrayLike) -> Points:
        """Compute points (..., 3) on the facets at distances along the axis and offsets from it."""
        station, t = np.broadcast_arrays(station, t)
        axis = StationedPolyline(self.axis, self.stations).points_at(station)
        # Headings jump by a turn at west, where interpolation would swing the point around.
        heading = np.interp(station, self.stations, np.unwrap(self.headings))
        plane = polyline.offset_points(axis[..., :2], heading, t)
        return np.concatenate([plane, axis[..., 2:]], axis=-1)

    def directed_line(self, t: float, *, along: bool) -> Points:
        """Compute points (n, 3) at offset `t`, along the axis or against it."""
        return self.offset_line(t) if along else self.offset_line(t)[::-1]

    def directed_tangents(self, *, along: bool) -> Points:
        """Compute unit tangents (n, 2) of the axis, along it or against it."""
        tangents = polyline.unit_vectors(self.headings)
        return tangents if along else -tangents[::-1]

    def strips_in_direction(self, *, along: bool) -> tuple[StripLayout, ...]:
        """Strips for travel along the axis or against it, from the axis outwards."""
        return self.right_strips if along != self.is_left_hand else self.left_strips

    def find_lane(self, number: int, *, along: bool) -> StripLayout:
        """Find a driving lane by its number; 1 is the innermost."""
        return next(
            strip for strip in self.strips_in_direction(along=along) if strip.lane_number == number
        )


@cache_by_identity(MAX_LAID_OUT_ROADS)
def lay_out_streets(road: Road) -> Mapping[str, StreetLayout]:
    """Sample the declared streets of a road, by id."""
    return {name: _lay_out_street(name, item, road) for name, item in road.streets.items()}


def _lay_out_street(name: str, declared: Street, road: Road) -> StreetLayout:
    section = road.sections[declared.section]
    plane, headings, along = curves.sample_reference_line(
        declared.start_m,
        np.radians(declared.heading_deg),
        declared.path,
        line_step_m=MAX_SLOPED_STEP_M if len(declared.heights) > 1 else MAX_LEVEL_STEP_M,
    )
    return StreetLayout(
        id=name,
        begins=declared.begins,
        ends=declared.ends,
        axis=np.column_stack([plane, curves.sample_elevation(along, declared.heights)]),
        headings=headings,
        stations=along,
        left_strips=_lay_out_strips(section, leftwards=True),
        right_strips=_lay_out_strips(section, leftwards=False),
        axis_paint=section.axis_line,
        speed_limit_m_s=declared.speed_limit_km_h / KM_H_PER_M_S,
    )


def _lay_out_strips(section: CrossSection, *, leftwards: bool) -> tuple[StripLayout, ...]:
    strips = section.left if leftwards else section.right
    sign = 1.0 if leftwards else -1.0
    edges = sign * np.concatenate([[0.0], np.cumsum([strip.width_m for strip in strips])])
    lanes = np.cumsum([strip.kind is StripKind.LANE for strip in strips])
    return tuple(
        StripLayout(
            kind=strip.kind,
            inner_t=float(inner),
            outer_t=float(outer),
            paint=strip.line,
            lane_number=int(number) if strip.kind is StripKind.LANE else 0,
            bay_width_m=strip.bay_m,
        )
        for strip, (inner, outer), number in zip(strips, pairwise(edges), lanes, strict=True)
    )


def sumo_edge_id(street: str, *, along: bool) -> str:
    """Build the id of the edge along a street's axis, or against it."""
    return f"{street}{'+' if along else '-'}"


def parse_edge_id(edge: str) -> tuple[str, bool]:
    """Parse the street of an edge and whether it runs along the axis; KeyError if it has none."""
    if edge.startswith(":") or edge[-1:] not in ("+", "-"):
        raise KeyError(edge)
    return edge[:-1], edge.endswith("+")


def approach_name(edge: str) -> str:
    """Name an edge as an approach to a traffic light: by its street, else by its own id."""
    try:
        return parse_edge_id(edge)[0]
    except KeyError:
        return edge


def name_crossing_signal(light: str, street: str) -> str:
    """Name the signal of those who walk over a street at a traffic light."""
    return f"{light}/{street}/crossing"


def edge_strips(street: StreetLayout, *, along: bool) -> tuple[StripLayout, ...]:
    """List the strips of an edge from the innermost driving lane, else sidewalk, outwards."""
    strips = street.strips_in_direction(along=along)
    for kind in (StripKind.LANE, StripKind.SIDEWALK):
        for index, strip in enumerate(strips):
            if strip.kind is kind:
                return strips[index:]
    return ()


def sumo_lane_index(street: StreetLayout, number: int, *, along: bool) -> int:
    """Compute the index in its edge of a lane; SUMO counts from the right, we from the axis."""
    strips = edge_strips(street, along=along)
    return next(
        index for index, strip in enumerate(reversed(strips)) if strip.lane_number == number
    )
