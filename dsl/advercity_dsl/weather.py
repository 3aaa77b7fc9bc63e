"""Weather as physical components, each authored separately; extinctions add.

A component that is `null` (or absent) is not there. `inf` means the same for a visibility.
"""

import math
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from advercity_dsl.base import (
    Celsius,
    Declaration,
    Degrees,
    GramsPerCubicCentimetre,
    Id,
    Lux,
    Metres,
    MetresPerSecond,
    Micrometres,
    Millimetres,
    MillimetresPerHour,
    Model,
    Share,
)


def _none_if_infinite(value: float | None) -> float | None:
    return None if value is not None and math.isinf(value) else value


def _in_range(value: float | None) -> float | None:
    if value is not None and not 10 <= value <= 50_000:
        raise ValueError("a visibility lies between 10 m and 50 km; null if there is none")
    return value


Visibility = Annotated[Metres | None, AfterValidator(_none_if_infinite), AfterValidator(_in_range)]
"""Meteorological optical range in metres: 5 % contrast, WMO-No. 8."""
Direction = Annotated[Degrees, Field(ge=-360, le=360)]


class Air(Model):
    """Clear air and haze."""

    mor_m: Visibility = 20_000


class Fog(Model):
    """Water droplets in the air."""

    mor_m: Visibility = None
    droplet_um: Annotated[Micrometres, Field(ge=5, le=50)] = 12
    depth_m: Annotated[Metres, Field(gt=0, le=2000)] = 100
    """Height of the bank; with the extinction it sets how much daylight comes through."""


class Rain(Model):
    """Falling rain."""

    rate_mm_h: Annotated[MillimetresPerHour, Field(ge=0, le=150)] = 0
    q_ext: Annotated[float, Field(ge=1, le=2)] = 2.0
    """Extinction efficiency of a drop: 2 in the geometric limit."""


class Snow(Model):
    """Falling and lying snow."""

    rate_mm_h: Annotated[MillimetresPerHour, Field(ge=0, le=10)] = 0
    """Liquid equivalent."""
    density_g_cm3: Annotated[GramsPerCubicCentimetre, Field(ge=0.02, le=0.5)] = 0.1
    fall_speed_m_s: Annotated[MetresPerSecond, Field(gt=0, le=5)] = 1.0
    depth_mm: Annotated[Millimetres, Field(ge=0, le=1000)] = 0
    road_coverage: Share = 0


class Dust(Model):
    """Airborne dust."""

    mor_m: Visibility = None
    ssa_rgb: tuple[Share, Share, Share] = (0.97, 0.94, 0.88)
    g: Annotated[float, Field(gt=-1, lt=1)] = 0.70


class Wind(Model):
    """Wind at 10 m height."""

    speed_m_s: Annotated[MetresPerSecond, Field(ge=0, le=30)] = 0
    from_deg: Direction = 250


class Surface(Model):
    """Water on the ground."""

    wetness: Share = 0
    puddle_coverage: Share = 0
    film_mm: Annotated[Millimetres, Field(ge=0, le=20)] = 0


class LensCoverage(Model):
    """Share of the glass that is covered, by where the camera looks."""

    front: Share = 0
    side: Share = 0
    rear: Share = 0


class Lens(Model):
    """Drops or dirt on the glass; off as in the original unless enabled."""

    enabled: bool = False
    kind: Literal["water", "dust", "snow"] = "water"
    coverage: LensCoverage = LensCoverage()
    stray_light: Share = 0.02
    """Share of the light that the optics scatter: 0.02 clean, 0.05 damp, 0.10 dirty."""


class Sun(Model):
    """Where the sun stands: azimuth in degrees clockwise from north."""

    elevation_deg: Annotated[Degrees, Field(ge=-90, le=90)] = 60
    azimuth_deg: Direction = 180


class Sky(Model):
    """Cloud cover in eighths and how clear the air above is."""

    oktas: Annotated[int, Field(ge=0, le=8)] = 0
    turbidity: Annotated[float, Field(ge=2, le=10)] = 3
    diffuse_lx: Annotated[Lux, Field(ge=0, le=150_000)] | None = None
    """Horizontal illuminance by the sky, above any fog; `null` derives it from sun and clouds."""
    direct_lx: Annotated[Lux, Field(ge=0, le=150_000)] | None = None
    """Direct normal illuminance by the sun, above any fog; `null` derives it likewise."""


class ByLandUse(Model):
    """A figure that differs between town and country."""

    urban: Annotated[float, Field(ge=0)]
    rural: Annotated[float, Field(ge=0)]


class Night(Model):
    """Light at night that does not come from vehicles."""

    glow_cd_m2: ByLandUse = ByLandUse(urban=0.007, rural=0.0005)
    """Mean luminance of the night sky."""
    street_lx: ByLandUse = ByLandUse(urban=12, rural=0.5)
    """Mean illuminance of the road by street lamps."""


class Lamps(Model):
    """Vehicle lamps that this weather calls for; brake lamps follow the brakes."""

    low_beam: bool = True
    fog: bool = False


class Weather(Declaration):
    """The state of air, light and ground that every sensor sees."""

    kind: Literal["weather"] = "weather"
    time: Literal["day", "night"]
    air: Air = Air()
    fog: Fog = Fog()
    rain: Rain = Rain()
    snow: Snow = Snow()
    dust: Dust = Dust()
    wind: Wind = Wind()
    surface: Surface = Surface()
    lens: Lens = Lens()
    sun: Sun = Sun()
    sky: Sky = Sky()
    night: Night = Night()
    lamps: Lamps = Lamps()
    temperature_c: Annotated[Celsius, Field(ge=-60, le=60)] = 15
    sun_at: dict[Id, Sun] = Field(default_factory=dict)
    """Where the sun stands at a road, by road id; takes the place of `sun` there."""

    @model_validator(mode="after")
    def _parts_fit(self) -> Self:
        fog, air = self.fog.mor_m, self.air.mor_m
        if fog is not None and air is not None and fog > air:
            raise ValueError(
                f"fog.mor_m {fog:g} m is clearer than air.mor_m {air:g} m;"
                " lower it, or leave fog out"
            )
        if self.snow.rate_mm_h > 0 and self.temperature_c > 3:
            raise ValueError(
                f"it snows at {self.temperature_c:g} degC; snow needs temperature_c of 3 or less"
            )
        if (self.sun.elevation_deg > 0) != (self.time == "day"):
            raise ValueError(
                f"time: {self.time} but sun.elevation_deg is {self.sun.elevation_deg:g};"
                " by day it is above 0, by night below"
            )
        return self
