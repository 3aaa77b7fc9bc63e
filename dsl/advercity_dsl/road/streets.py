"""Streets: an axis in plan and height, and which cross-section lies along it."""

from typing import Annotated, Literal

from pydantic import Field

from advercity_dsl.base import (
    Degrees,
    Id,
    KilometresPerHour,
    Metres,
    Model,
    Point2,
    PositiveMetres,
    Terse,
)


class Line(Model):
    """A straight piece of a street's axis."""

    line_m: PositiveMetres
    """Its length."""


class Arc(Model):
    """A piece of a circle."""

    arc_m: PositiveMetres
    """Its length along the curve."""
    radius_m: PositiveMetres
    """Of the circle."""
    turn: Literal["left", "right"]
    """To which side it bends."""


class Polyline(Model):
    """Further points of an axis, absolute, for shapes that no line or arc says."""

    points_m: tuple[Point2, ...]
    """Further points, each [east, north]."""


class Height(Model):
    """Height of the axis at a distance along it.

    The grade is constant between two of them and changes over 4 m where they meet.
    """

    at_m: Annotated[Metres, Field(ge=0)]
    """Distance along the axis."""
    z_m: Metres
    """Height there."""


class Street(Terse):
    """One axis with one cross-section, from one junction or edge of the site to another."""

    begins: Id
    """Junction, or a name for the edge of the site."""
    ends: Id
    """Junction, or a name for the edge of the site."""
    start_m: Point2
    """Where the axis starts, [east, north]."""
    heading_deg: Degrees
    """Where it leads from there, counter-clockwise from east."""
    path: Annotated[tuple[Line | Arc | Polyline, ...], Field(min_length=1)]
    """Lines and arcs, one after the other."""
    heights: tuple[Height, ...] = ()
    """Heights along the axis; left out, it is level."""
    section: Id
    """Name of one of `sections`."""
    speed_limit_km_h: Annotated[KilometresPerHour, Field(gt=0, le=200)]
    """For all of it."""
