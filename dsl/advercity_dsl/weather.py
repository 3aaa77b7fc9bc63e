"""Weather as physical components, each authored separately; extinctions add.

A component that is `null` (or absent) is not there. `inf` means the same for a visibility.
"""

import math
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from advercity_dsl.base import Declaration, Id, InvalidCombination, Model, is_none
from advercity_dsl.units import (
    Celsius,
    Count,
    Degrees,
    Flag,
    Fraction,
    GramsPerCubicCentimetre,
    Lux,
    Metres,
    MetresPerSecond,
    Micrometres,
    Millimetres,
    MillimetresPerHour,
    Number,
    RangeReason,
)


def _none_if_infinite(value: Any) -> Any:
    return None if isinstance(value, float) and math.isinf(value) else value


Visibility = Annotated[
    Annotated[
        Metres,
        Field(ge=10, le=50_000),
        RangeReason(
            "below 10 m nothing can drive, beyond 50 km air is clear; null if it is not there"
        ),
    ]
    | None,
    BeforeValidator(_none_if_infinite),
]
"""Meteorological optical range in metres: 5 % contrast, WMO-No. 8."""
Direction = Annotated[Degrees, Field(ge=-360, le=360)]


class Air(Model):
    """Clear air and haze."""

    mor_m: Visibility = 20_000
    """Visibility (5 % contrast) by clear air and haze alone; `null` takes it away."""


class Fog(Model):
    """Water droplets in the air."""

    mor_m: Visibility = None
    """Visibility (5 % contrast) by the fog alone; `null` is no fog."""
    droplet_um: Annotated[
        Micrometres,
        Field(ge=5, le=50),
        RangeReason("fog droplets are 5 to 50 um, larger ones fall"),
    ] = 12
    """Effective diameter of the droplets."""
    depth_m: Annotated[Metres, Field(gt=0, le=2000)] = 100
    """Height of the bank; with the extinction it sets how much daylight comes through."""


class Rain(Model):
    """Falling rain."""

    rate_mm_h: Annotated[
        MillimetresPerHour, Field(ge=0, le=150), RangeReason("150 mm/h is a tropical cloudburst")
    ] = 0
    """Light below 2.5, heavy above 7.6, violent above 50."""
    q_ext: Annotated[
        Number, Field(ge=1, le=2), RangeReason("1 counts no diffraction around a drop, 2 all of it")
    ] = 2.0
    """Extinction efficiency of a drop: 2 in the geometric limit."""


class Snow(Model):
    """Falling and lying snow."""

    rate_mm_h: Annotated[
        MillimetresPerHour,
        Field(ge=0, le=10),
        RangeReason("the rate counts melted water; 10 mm/h of it is about 10 cm of snow an hour"),
    ] = 0
    """Liquid equivalent: 1 mm/h is about 1 cm of fresh snow an hour."""
    density_g_cm3: Annotated[
        GramsPerCubicCentimetre, Field(ge=0.02, le=0.5), RangeReason("dry powder to wet snow")
    ] = 0.1
    """Of the flakes: 0.05 dry, 0.1 usual, 0.2 wet; drier flakes are larger and hide more."""
    fall_speed_m_s: Annotated[
        MetresPerSecond, Field(gt=0, le=5), RangeReason("even wet flakes fall slower than 5 m/s")
    ] = 1.0
    """How fast flakes fall in still air."""
    depth_mm: Annotated[Millimetres, Field(ge=0, le=1000)] = 0
    """Of the lying snow."""
    road_coverage: Fraction = 0
    """Share of the carriageway under snow."""
    rut_coverage: Fraction = 0
    """Share of the wheel ruts under snow; traffic keeps them clearer than the rest."""

    @model_validator(mode="after")
    def _check_rut_coverage(self) -> Self:
        if self.rut_coverage > self.road_coverage:
            raise InvalidCombination(
                ("rut_coverage",),
                f"{self.rut_coverage:g} is more than road_coverage, {self.road_coverage:g}",
                "wheels clear their ruts; give them the same or less",
            )
        return self


class Dust(Model):
    """Airborne dust."""

    mor_m: Visibility = None
    """Visibility (5 % contrast) by the dust alone; `null` is no dust, below 1 km is a storm."""
    ssa_rgb: tuple[Fraction, Fraction, Fraction] = (0.97, 0.94, 0.88)
    """Single-scattering albedo in red, green and blue; what is not scattered tints the air."""
    g: Annotated[Number, Field(gt=-1, lt=1)] = 0.70
    """Asymmetry of scattering: 0 all round, towards 1 forward."""


class Wind(Model):
    """Wind at 10 m height."""

    speed_m_s: Annotated[
        MetresPerSecond, Field(ge=0, le=30), RangeReason("above 30 m/s, a hurricane, nobody drives")
    ] = 0
    """Mean speed."""
    from_deg: Direction = 250
    """Where it blows from, clockwise from north."""


class SurfaceWater(Model):
    """Water on the ground."""

    wetness: Fraction = 0
    """0 dry, 1 soaked."""
    puddle_coverage: Fraction = 0
    """Share of the carriageway under standing water."""
    film_mm: Annotated[Millimetres, Field(ge=0, le=20)] = 0
    """Depth of the water film on the road."""


class LensCoverage(Model):
    """Share of the glass that is covered, by where the camera looks."""

    front: Fraction = 0
    """Cameras that look ahead; the wind of driving keeps them clearer."""
    side: Fraction = 0
    """Cameras that look sideways."""
    rear: Fraction = 0
    """Cameras that look back."""


class Lens(Model):
    """Drops or dirt on the glass; off as in the original unless enabled."""

    enabled: Flag = False
    """Whether there is anything on the glass."""
    kind: Literal["water", "dust", "snow"] = "water"
    """What is on it."""
    coverage: LensCoverage = LensCoverage()
    """How much of the glass it covers."""
    stray_light: Fraction = 0.02
    """Share of the light that the optics scatter: 0.02 clean, 0.05 damp, 0.10 dirty."""


DEFAULT_WITHIN_DEG, DEFAULT_SEEN_FRACTION = 25.0, 0.5


class Sun(Model):
    """Where the sun stands, or in whose view it is to stand.

    Said by `elevation_deg` and `azimuth_deg`, or by `in_view_of`, which `advercity solve` turns
    into the former at every road and writes to `sun_at`.
    """

    elevation_deg: Annotated[
        Degrees, Field(ge=-90, le=90), RangeReason("90 deg is straight overhead")
    ] = 60
    """Above the horizon; below 0 at night."""
    azimuth_deg: Direction = 180
    """Clockwise from north."""
    in_view_of: Literal["ego"] | None = Field(default=None, exclude_if=is_none)
    """Who is to drive into the sun; found so that neither the world nor traffic hides it."""
    within_deg: Annotated[
        Degrees, Field(gt=0, le=60), RangeReason("farther off than 60 deg a camera does not see it")
    ] = Field(default=DEFAULT_WITHIN_DEG, exclude_if=lambda value: value == DEFAULT_WITHIN_DEG)
    """How far off the axis of the ego's front camera it still counts as in view."""
    seen_share: Fraction = Field(
        default=DEFAULT_SEEN_FRACTION, exclude_if=lambda value: value == DEFAULT_SEEN_FRACTION
    )
    """Share of the ego's way on which it is to be in view, at least."""

    @model_validator(mode="after")
    def _check_exclusive_fields(self) -> Self:
        said = self.model_fields_set
        if self.in_view_of is None:
            for field in ("within_deg", "seen_share"):
                if field in said and getattr(self, field) != type(self).model_fields[field].default:
                    raise InvalidCombination(
                        (field,), "goes with in_view_of", "add in_view_of: ego"
                    )
        for field in ("elevation_deg", "azimuth_deg"):
            if self.in_view_of is not None and field in said:
                raise InvalidCombination(
                    (field,),
                    "stands beside in_view_of, which is there to find it",
                    "leave one of the two out",
                    other_path=("in_view_of",),
                )
        return self


class Sky(Model):
    """Cloud cover in eighths and how clear the air above is."""

    oktas: Annotated[Count, Field(ge=0, le=8), RangeReason("cloud cover is counted in eighths")] = 0
    """Cloud cover: 0 cloudless, 8 overcast."""
    turbidity: Annotated[Number, Field(ge=2, le=10)] = 3
    """Linke-like clearness of the air above: 2 very clear, 10 murky."""
    diffuse_lx: Annotated[Lux, Field(ge=0, le=150_000)] | None = None
    """Horizontal illuminance by the sky, above any fog; `null` derives it from sun and clouds."""
    direct_lx: Annotated[Lux, Field(ge=0, le=150_000)] | None = None
    """Direct normal illuminance by the sun, above any fog; `null` derives it likewise."""


class ByLandUse(Model):
    """A figure that differs between town and country."""

    urban: Annotated[Number, Field(ge=0, le=150_000)]
    """In town."""
    rural: Annotated[Number, Field(ge=0, le=150_000)]
    """In the country."""


class Night(Model):
    """Light at night that does not come from vehicles."""

    glow_cd_m2: ByLandUse = ByLandUse(urban=0.007, rural=0.0005)
    """Mean luminance of the night sky."""
    street_lx: ByLandUse = ByLandUse(urban=12, rural=0.5)
    """Mean illuminance of the road by street lamps."""


class Lamps(Model):
    """Vehicle lamps that this weather calls for; brake lamps follow the brakes."""

    low_beam: Flag = True
    """Headlamps."""
    fog: Flag = False
    """Fog lamps, front and rear."""


class Weather(Declaration):
    """The state of air, light and ground that every sensor sees."""

    kind: Literal["weather"] = "weather"
    time: Literal["day", "night"]
    """Whether the sun or lamps light the scene."""
    air: Air = Air()
    """Clear air and haze."""
    fog: Fog = Fog()
    """Fog; left out, there is none."""
    rain: Rain = Rain()
    """Rain; left out, there is none."""
    snow: Snow = Snow()
    """Falling and lying snow; left out, there is none."""
    dust: Dust = Dust()
    """Dust; left out, there is none."""
    wind: Wind = Wind()
    """Wind at 10 m height."""
    surface: SurfaceWater = SurfaceWater()
    """Water on the ground."""
    lens: Lens = Lens()
    """Drops or dirt on cameras."""
    sun: Sun = Sun()
    """Where the sun stands."""
    sky: Sky = Sky()
    """Clouds, and how bright they are."""
    night: Night = Night()
    """Light at night that does not come from vehicles."""
    lamps: Lamps = Lamps()
    """Which lamps drivers switch on."""
    temperature_c: Annotated[Celsius, Field(ge=-60, le=60)] = 15
    """Of the air."""
    sun_at: dict[Id, Sun] = Field(default_factory=dict)
    """Where the sun stands at a road, by road id; takes the place of `sun` there."""

    @model_validator(mode="after")
    def _check_components(self) -> Self:
        fog, air = self.fog.mor_m, self.air.mor_m
        if fog is not None and air is not None and fog > air:
            raise InvalidCombination(
                ("fog", "mor_m"),
                f"fog of {fog:g} m is clearer than the air's {air:g} m (air.mor_m)",
                "lower it, or leave fog out",
                other_path=("air", "mor_m"),
            )
        if self.snow.rate_mm_h > 0 and self.temperature_c > 3:
            raise InvalidCombination(
                ("temperature_c",),
                f"it snows at {self.temperature_c:g} degC",
                "snow needs a temperature_c of 3 or less",
                other_path=("snow", "rate_mm_h"),
            )
        self._check_sun(("sun", "elevation_deg"), self.sun)
        for road, sun in self.sun_at.items():
            self._check_sun(("sun_at", road, "elevation_deg"), sun)
        return self

    def _check_sun(self, value_path: tuple[str, ...], sun: Sun) -> None:
        if (sun.elevation_deg > 0) != (self.time == "day"):
            raise InvalidCombination(
                value_path,
                f"the sun stands at {sun.elevation_deg:g} deg, but it is {self.time} (time)",
                "by day it stands above 0, e.g. 30 deg, at night below, e.g. -30 deg",
                other_path=("time",),
            )
