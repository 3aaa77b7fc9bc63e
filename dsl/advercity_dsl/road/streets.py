"""Streets: axis in plan and height, cross-section strip by strip, and imported maps."""

from enum import StrEnum
from typing import Annotated, Literal, Self

from pydantic import Field, StringConstraints, model_validator

from advercity_dsl.base import CompactModel, Digest, Id, Items, Model, is_empty, is_none
from advercity_dsl.units import (
    Degrees,
    KilometresPerHour,
    Metres,
    Point2,
    PositiveMetres,
    RangeReason,
)


class StripKind(StrEnum):
    """Purpose of a strip of a cross-section."""

    LANE = "lane"
    PARKING = "parking"
    SHOULDER = "shoulder"
    EDGE = "edge"
    MEDIAN = "median"
    VERGE = "verge"
    SIDEWALK = "sidewalk"


class RoadMark(StrEnum):
    """Style of a painted line."""

    SOLID_WHITE = "solid_white"
    BROKEN_WHITE = "broken_white"
    SOLID_YELLOW = "solid_yellow"
    BROKEN_YELLOW = "broken_yellow"
    DOUBLE_YELLOW = "double_yellow"


class Strip(CompactModel):
    """A band along a street, and the line painted on its outer border."""

    kind: StripKind
    """Purpose of the strip."""
    width_m: Annotated[PositiveMetres, Field(ge=0.05, le=60)]
    """Width of the strip."""
    line: RoadMark | None = None
    """Line painted on its outer border."""
    bay_m: Annotated[PositiveMetres, Field(ge=0.5, le=60)] | None = Field(
        default=None, exclude_if=is_none
    )
    """Width of parking bays separated by lines; cars park across the strip."""

    @model_validator(mode="after")
    def _check_bays(self) -> Self:
        if self.bay_m is not None and self.kind is not StripKind.PARKING:
            raise ValueError("only a parking strip has bays")
        return self


class CrossSection(Model):
    """Strips on either side of the axis, from the axis outwards.

    Lanes on the right run along the axis, lanes on the left against it; in left-hand traffic it is
    the other way round. Lane 1 is the innermost.
    """

    left: Items[Strip] = ()
    """Strips on the left, from the axis outwards."""
    right: Items[Strip] = ()
    """Strips on the right, from the axis outwards."""
    axis_line: RoadMark | None = None
    """Line painted on the axis."""


MAX_PIECE_M = 5000
PIECE_REASON = RangeReason("a straight or curve of 5 km is longer than any site")


class AxisLine(Model):
    """A straight piece of a street's axis."""

    line_m: Annotated[PositiveMetres, Field(le=MAX_PIECE_M), PIECE_REASON]
    """Length of the piece."""


class AxisArc(Model):
    """A piece of a circle."""

    arc_m: Annotated[PositiveMetres, Field(le=MAX_PIECE_M), PIECE_REASON]
    """Length along the curve."""
    radius_m: Annotated[PositiveMetres, Field(ge=1)]
    """Radius of the circle."""
    turn: Literal["left", "right"]
    """Side to which it bends."""


class AxisPoints(Model):
    """Further points of an axis in absolute coordinates, for other shapes than lines and arcs."""

    points_m: Items[Point2]
    """Points, each [east, north]."""


class AxisHeight(Model):
    """Height of the axis at a distance along it.

    The grade is constant between two heights and changes over 4 m at each of them.
    """

    at_m: Annotated[Metres, Field(ge=0, le=100_000)]
    """Distance along the axis."""
    z_m: Annotated[Metres, Field(ge=-500, le=9000), RangeReason("no road is lower or higher")]
    """Height at the distance."""


class Street(CompactModel):
    """One axis with one cross-section, from one junction or edge of the site to another."""

    begins: Id
    """Junction, or a name for the edge of the site."""
    ends: Id
    """Junction, or a name for the edge of the site."""
    start_m: Point2
    """Start of the axis, [east, north]."""
    heading_deg: Degrees
    """Heading at the start, counter-clockwise from east."""
    path: Annotated[Items[AxisLine | AxisArc | AxisPoints], Field(min_length=1)]
    """Lines and arcs in sequence."""
    heights: Items[AxisHeight] = ()
    """Heights along the axis; level by default."""
    section: Id
    """Name of one of `sections`."""
    speed_limit_km_h: Annotated[KilometresPerHour, Field(gt=0, le=200)]
    """Speed limit of the whole street."""


DrivingSide = Literal["right", "left"]
MapSource = Literal["opendrive", "osm", "lanelet2", "sumo"]


class MapFile(Model):
    """An external map, from which the compiler builds the road's network.

    OpenDRIVE and SUMO maps, and Lanelet2 maps with local coordinates, keep them; the origin of
    other Lanelet2 maps and of OpenStreetMap maps is at the road's `origin_lat_deg` and
    `origin_lon_deg`.
    """

    source: MapSource
    """Format of the map."""
    file: Annotated[str, StringConstraints(min_length=1, max_length=1000)]
    """Path of the map, relative to the declaration's file."""
    sha256: Digest | None = None
    """SHA-256 of the file; a map with another one is rejected."""
    extent_m: tuple[Point2, Point2] | None = None
    """Two opposite corners of a rectangle; roads entirely outside are omitted."""
    driving_side: DrivingSide | None = Field(default=None, exclude_if=is_none)
    """Side of the road on which traffic drives in an OpenStreetMap or Lanelet2 map; by default as
    its ways or opposite lanelets say, or else as is usual in the country."""

    @model_validator(mode="after")
    def _check_driving_side(self) -> Self:
        if self.driving_side is not None and self.source not in ("osm", "lanelet2"):
            raise ValueError(
                "`driving_side` is for OpenStreetMap and Lanelet2 maps; others say it themselves"
            )
        return self


class LeftOut(Model):
    """Omitted parts of a map or recording."""

    name: Annotated[str, StringConstraints(min_length=1, max_length=200)]
    """Name of the parts."""
    count: Annotated[int, Field(ge=1, le=1_000_000_000)]
    """Number of the parts."""
    line: Annotated[int, Field(ge=0, le=1_000_000_000)] = Field(
        default=0, exclude_if=lambda line: line == 0
    )
    """Line of the first part in its file; 0 where the format has no lines."""


class MapPlace(Model):
    """Place of the world's origin on the globe (WGS84), by the map's projection."""

    latitude_deg: Annotated[Degrees, Field(ge=-89, le=89)]
    """Geodetic latitude."""
    longitude_deg: Annotated[Degrees, Field(ge=-180, le=180)]
    """Longitude."""
    altitude_m: Annotated[Metres, Field(ge=-500, le=9000)]
    """Height of the origin, from the map."""
    convergence_deg: Annotated[Degrees, Field(ge=-180, le=180)]
    """Bearing of the map's north, clockwise from true north."""


class MapNetwork(Model):
    """The network compiled from a map; a spec needs no other file."""

    source: MapSource
    """Format of the map."""
    sha256: Digest
    """SHA-256 of the map's file."""
    network: Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9+/]+={0,2}$")]
    """SUMO network, compressed with zlib and encoded in Base64."""
    offset_m: Point2 = Field(default=(0.0, 0.0), exclude_if=lambda offset_m: offset_m == (0.0, 0.0))
    """Coordinates [east, north] in the map of the world frame's origin."""
    place: MapPlace | None = Field(default=None, exclude_if=is_none)
    """Place of the world's origin, if the map has a known projection."""
    driving_side: DrivingSide = Field(default="right", exclude_if=lambda side: side == "right")
    """Side of the road on which traffic drives; the network of a left-hand map is mirrored at the x
    axis, into a right-hand one."""
    left_out: Items[LeftOut] = Field(default=(), exclude_if=is_empty)
    """Omitted parts of the map."""
