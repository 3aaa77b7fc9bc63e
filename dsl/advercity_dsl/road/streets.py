"""Cross-sections: what lies beside a street's axis, strip by strip.

Streets: an axis in plan and height, and which cross-section lies along it.

Maps of others that a road's streets come from.
"""

from enum import StrEnum
from typing import Annotated, Literal, Self

from pydantic import Field, StringConstraints, model_validator

from advercity_dsl.base import CompactModel, Digest, Id, Model, is_none
from advercity_dsl.units import Degrees, KilometresPerHour, Metres, Point2, PositiveMetres


class StripKind(StrEnum):
    """What a strip of a cross-section is for."""

    LANE = "lane"
    PARKING = "parking"
    SHOULDER = "shoulder"
    EDGE = "edge"
    MEDIAN = "median"
    VERGE = "verge"
    SIDEWALK = "sidewalk"


class RoadMark(StrEnum):
    """A painted line."""

    SOLID_WHITE = "solid_white"
    BROKEN_WHITE = "broken_white"
    SOLID_YELLOW = "solid_yellow"
    BROKEN_YELLOW = "broken_yellow"
    DOUBLE_YELLOW = "double_yellow"


class Strip(CompactModel):
    """A band along a street, as wide as it says, and the line painted on its outer border."""

    kind: StripKind
    """What it is for."""
    width_m: Annotated[PositiveMetres, Field(le=60)]
    """Its width."""
    line: RoadMark | None = None
    """What is painted on its outer border."""
    bay_m: PositiveMetres | None = Field(default=None, exclude_if=is_none)
    """Width of parking bays, which lines across the strip divide; cars stand across it."""

    @model_validator(mode="after")
    def _check_bays(self) -> Self:
        if self.bay_m is not None and self.kind is not StripKind.PARKING:
            raise ValueError("only a parking strip has bays")
        return self


class CrossSection(Model):
    """Strips on either side of the axis, from the axis outwards.

    Lanes on the right run along the axis, lanes on the left against it. Lane 1 is the innermost.
    """

    left: tuple[Strip, ...] = ()
    """Strips on the left, from the axis outwards."""
    right: tuple[Strip, ...] = ()
    """Strips on the right, from the axis outwards."""
    axis_line: RoadMark | None = None
    """What is painted on the axis."""


class AxisLine(Model):
    """A straight piece of a street's axis."""

    line_m: PositiveMetres
    """Its length."""


class AxisArc(Model):
    """A piece of a circle."""

    arc_m: PositiveMetres
    """Its length along the curve."""
    radius_m: PositiveMetres
    """Of the circle."""
    turn: Literal["left", "right"]
    """To which side it bends."""


class AxisPoints(Model):
    """Further points of an axis, absolute, for shapes that no line or arc says."""

    points_m: tuple[Point2, ...]
    """Further points, each [east, north]."""


class AxisHeight(Model):
    """Height of the axis at a distance along it.

    The grade is constant between two of them and changes over 4 m where they meet.
    """

    at_m: Annotated[Metres, Field(ge=0)]
    """Distance along the axis."""
    z_m: Metres
    """Height there."""


class Street(CompactModel):
    """One axis with one cross-section, from one junction or edge of the site to another."""

    begins: Id
    """Junction, or a name for the edge of the site."""
    ends: Id
    """Junction, or a name for the edge of the site."""
    start_m: Point2
    """Where the axis starts, [east, north]."""
    heading_deg: Degrees
    """Where it leads from there, counter-clockwise from east."""
    path: Annotated[tuple[AxisLine | AxisArc | AxisPoints, ...], Field(min_length=1)]
    """Lines and arcs, one after the other."""
    heights: tuple[AxisHeight, ...] = ()
    """Heights along the axis; left out, it is level."""
    section: Id
    """Name of one of `sections`."""
    speed_limit_km_h: Annotated[KilometresPerHour, Field(gt=0, le=200)]
    """For all of it."""


class MapFile(Model):
    """A map that others made, from which the road's network is built when it is compiled.

    OpenDRIVE and SUMO maps keep their coordinates; an OpenStreetMap one lies around the road's
    `origin_lat_deg` and `origin_lon_deg`.
    """

    source: Literal["opendrive", "osm", "sumo"]
    """Format of the map."""
    file: Annotated[str, StringConstraints(min_length=1, max_length=1000)]
    """Its path, relative to the declaration's file."""
    sha256: Digest | None = None
    """Of the file; another map under the same name is refused."""
    extent_m: tuple[Point2, Point2] | None = None
    """Two opposite corners of a rectangle; roads wholly outside are left out."""


class MapNetwork(Model):
    """What the compiler makes of a map; a spec needs no other file."""

    source: Literal["opendrive", "osm", "sumo"]
    """Format of the map."""
    sha256: Digest
    """Of the map's file."""
    network: Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9+/]+={0,2}$")]
    """The SUMO network, as zlib in Base64."""
