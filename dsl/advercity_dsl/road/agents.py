"""Connected vehicles and roadside units: where they start or stand."""

from typing import Annotated, Literal

from pydantic import Field

from advercity_dsl.base import Degrees, Id, KilometresPerHour, Model, Point2, Point3


class EgoRoute(Model):
    """Another way of the ego through the same place, for conflicts with another manoeuvre."""

    spawn_m: Point2
    """Where it starts."""
    heading_deg: Degrees
    """Counter-clockwise from east."""
    destination_m: Point2
    """Near which the scenario ends."""
    route: Annotated[tuple[Id, ...], Field(min_length=1)]
    """Streets from spawn to the edge of the site."""


class Vehicle(Model):
    """A connected vehicle: where it starts, where it goes, how fast."""

    kind: Literal["vehicle"] = "vehicle"
    """A connected vehicle."""
    role: Literal["ego", "other"] = "other"
    """One vehicle of a road is the ego."""
    spawn_m: Point2
    """Where it starts, [east, north]."""
    heading_deg: Degrees
    """Where it looks, counter-clockwise from east."""
    destination_m: Point2
    """Where it goes, [east, north]."""
    route: tuple[Id, ...] = ()
    """Streets from spawn to the edge of the site; none takes the shortest way."""
    max_speed_km_h: Annotated[KilometresPerHour, Field(gt=0, le=200)]
    """Its own limit; it keeps the street's as well."""


class RoadsideUnit(Model):
    """Sensors that stand beside the road. Yaw, pitch and roll turn its cameras."""

    kind: Literal["roadside_unit"] = "roadside_unit"
    """Sensors beside the road."""
    position_m: Point3
    """Of its mast's head, [east, north, up]."""
    yaw_deg: Degrees
    """Where its cameras look, counter-clockwise from east."""
    pitch_deg: Degrees = 0
    """Positive looks down."""
    roll_deg: Degrees = 0
    """Positive lowers the right side."""
    lidar_upper_deg: Degrees | None = None
    """Highest beam; `null` takes the rig's."""
