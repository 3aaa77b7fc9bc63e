"""Components of a weather: air, fog, rain and everything else its keyframes may change.

A component that is `null` or omitted is absent; so is one with a visibility of `inf`.
"""

import math
from datetime import UTC, datetime
from typing import Annotated, Any, Literal, Self

from pydantic import (
    BeforeValidator,
    Field,
    model_validator,
)

from advercity_dsl.base import (
    InvalidCombination,
    Model,
    is_empty,
    is_none,
)
from advercity_dsl.sun_position import TimeError, compute_sun_position, parse_time
from advercity_dsl.units import (
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
            "below 10 m nothing can drive, above 50 km air is clear; write null if it is absent"
        ),
    ]
    | None,
    BeforeValidator(_none_if_infinite),
]
"""Meteorological optical range in metres: 5 % contrast, WMO-No. 8."""
Direction = Annotated[Degrees, Field(ge=-360, le=360)]


class WeatherComponent(Model):
    """A part of the weather; absent if all its values are defaults."""

    def check_with(self, weather: Any) -> None:
        """Check the part against its `Weather`.

        Raises:
            InvalidCombination: They contradict each other.
        """


class Air(WeatherComponent):
    """Clear air and haze."""

    mor_m: Visibility = 20_000
    """Visibility (5 % contrast) by clear air and haze alone; `null` is no extinction."""


class Fog(WeatherComponent):
    """Water droplets in the air."""

    mor_m: Visibility = None
    """Visibility (5 % contrast) by the fog alone; `null` is no fog."""
    droplet_um: Annotated[
        Micrometres,
        Field(ge=5, le=50),
        RangeReason("fog droplets are 5 to 50 um, larger ones fall"),
    ] = 12
    """Effective diameter of the droplets."""
    depth_m: Annotated[Metres, Field(ge=1, le=2000)] = 100
    """Height of the fog bank, which determines the transmitted daylight."""

    def check_with(self, weather: Any) -> None:
        """Check that it is thicker than the air without it."""
        air_m = weather.air.mor_m
        if self.mor_m is not None and air_m is not None and self.mor_m > air_m:
            raise InvalidCombination(
                ("fog", "mor_m"),
                f"fog of {self.mor_m:g} m is clearer than the air's {air_m:g} m (air.mor_m)",
                "lower it, or remove the fog",
                other_path=("air", "mor_m"),
            )


class Rain(WeatherComponent):
    """Falling rain."""

    rate_mm_h: Annotated[
        MillimetresPerHour, Field(ge=0, le=150), RangeReason("150 mm/h is a tropical cloudburst")
    ] = 0
    """Rate of rain: light below 2.5, heavy above 7.6, violent above 50."""
    q_ext: Annotated[
        Number,
        Field(ge=1, le=2),
        RangeReason("1 is without diffraction around a drop, 2 with it"),
    ] = 2.0
    """Extinction efficiency of a drop: 2 in the geometric limit."""


class Snow(WeatherComponent):
    """Falling and lying snow."""

    rate_mm_h: Annotated[
        MillimetresPerHour,
        Field(ge=0, le=10),
        RangeReason("the rate is that of melted water; 10 mm/h are about 10 cm of snow an hour"),
    ] = 0
    """Liquid equivalent: 1 mm/h is about 1 cm of fresh snow an hour."""
    density_g_cm3: Annotated[
        GramsPerCubicCentimetre, Field(ge=0.02, le=0.5), RangeReason("dry powder to wet snow")
    ] = 0.1
    """Density of flakes: 0.05 dry, 0.1 typical, 0.2 wet; drier flakes are larger and hide more."""
    fall_speed_m_s: Annotated[
        MetresPerSecond, Field(ge=0.1, le=5), RangeReason("even wet flakes fall slower than 5 m/s")
    ] = 1.0
    """Terminal velocity of flakes in still air."""
    depth_mm: Annotated[Millimetres, Field(ge=0, le=1000)] = 0
    """Depth of the lying snow."""
    road_coverage: Fraction = 0
    """Fraction of the carriageway covered by snow."""
    rut_coverage: Fraction = 0
    """Fraction of the wheel ruts covered by snow; traffic keeps them clearer than the rest."""

    def check_with(self, weather: Any) -> None:
        """Check that it falls in the cold, and covers ruts at most as much as the road."""
        if self.rut_coverage > self.road_coverage:
            raise InvalidCombination(
                ("snow", "rut_coverage"),
                f"{self.rut_coverage:g} is more than road_coverage, {self.road_coverage:g}",
                "wheels clear the ruts; give the same or less",
            )
        if self.rate_mm_h > 0 and weather.temperature_c > 3:
            raise InvalidCombination(
                ("temperature_c",),
                f"it snows at {weather.temperature_c:g} degC",
                "snow needs a temperature_c of 3 or less",
                other_path=("snow", "rate_mm_h"),
            )


class Hail(WeatherComponent):
    """Falling hailstones; where they lie, they look like snow and are written as such."""

    rate_mm_h: Annotated[
        MillimetresPerHour,
        Field(ge=0, le=50),
        RangeReason("the rate is that of melted water; sizes are known up to 50 mm/h"),
    ] = 0
    """Rate as melted water; it sets the sizes, too: the harder it hails, the larger the stones."""
    largest_mm: Annotated[
        Millimetres, Field(ge=5, le=60), RangeReason("below 5 mm it is graupel, above rare")
    ] = 40
    """Diameter of the largest stones."""


NO_HAIL = Hail()


class Dust(WeatherComponent):
    """Airborne dust."""

    mor_m: Visibility = None
    """Visibility (5 % contrast) by the dust alone; `null` is no dust, below 1 km is a storm."""
    ssa_rgb: tuple[Fraction, Fraction, Fraction] = (0.97, 0.94, 0.88)
    """Single-scattering albedo in red, green and blue; absorption tints the air."""
    g: Annotated[Number, Field(ge=-0.99, le=0.99)] = 0.70
    """Asymmetry parameter of scattering: 0 isotropic, towards 1 forward."""


class Wind(Model):
    """Wind at 10 m height."""

    speed_m_s: Annotated[
        MetresPerSecond, Field(ge=0, le=30), RangeReason("above 30 m/s, a hurricane, traffic stops")
    ] = 0
    """Mean speed."""
    from_deg: Direction = 250
    """Direction the wind blows from, clockwise from north."""
    gust_factor: Annotated[
        Number, Field(ge=1, le=3), RangeReason("gusts are up to three times the mean wind")
    ] = Field(default=1, exclude_if=lambda value: value == 1)
    """Strongest gust of ten minutes relative to the mean: 1 none, 1.4 open land, 2 in towns."""


class SurfaceWater(Model):
    """Water on the ground."""

    wetness: Fraction = 0
    """Wetness of surfaces: 0 dry, 1 soaked."""
    puddle_coverage: Fraction = 0
    """Fraction of the carriageway covered by puddles."""
    film_mm: Annotated[Millimetres, Field(ge=0, le=20)] = 0
    """Depth of the water film on the road."""
    ice_mm: Annotated[Millimetres, Field(ge=0, le=50)] = Field(default=0, exclude_if=is_empty)
    """Thickness of clear ice (glaze) on all surfaces under the open sky."""


class LensCoverage(Model):
    """Covered fraction of the glass, by viewing direction of the camera."""

    front: Fraction = 0
    """Cameras looking ahead; airflow keeps them clearer."""
    side: Fraction = 0
    """Cameras looking sideways."""
    rear: Fraction = 0
    """Cameras looking back."""


class Lens(Model):
    """Drops or dirt on the glass; disabled by default, as in the original dataset."""

    enabled: Flag = False
    """Whether the glass is covered at all."""
    kind: Literal["water", "dust", "snow"] = "water"
    """Kind of cover."""
    coverage: LensCoverage = LensCoverage()
    """Covered fractions of the glass."""
    stray_light: Fraction = 0.02
    """Fraction of light scattered by the optics: 0.02 clean, 0.05 damp, 0.10 dirty."""


# Omitted from JSON at these values, so specs without glare do not mention them.
DEFAULT_WITHIN_DEG, DEFAULT_SEEN_FRACTION = 25.0, 0.5


class Sun(Model):
    """Position of the sun, or the agent in whose view it must be.

    Given by `elevation_deg` and `azimuth_deg`; by a time and a place (`at`, `lat_deg`, `lon_deg`),
    from which both are computed; or by `in_view_of`, for which `advercity solve` computes both at
    every road and writes them to `sun_at`.
    """

    elevation_deg: Annotated[
        Degrees, Field(ge=-90, le=90), RangeReason("90 deg is straight overhead")
    ] = 60
    """Elevation above the horizon; negative at night."""
    azimuth_deg: Direction = 180
    """Azimuth, clockwise from north."""
    # A spec has the resulting angles instead of these three.
    at: str | None = Field(default=None, exclude=True)
    """Time, e.g. 2024-11-22T16:30 Europe/Madrid, 2024-11-22T16:30+01:00 or 2024-11-22T15:30Z. With
    neither zone nor offset, it is UTC and an hour for each 15 degrees of longitude, rounded, which
    is off legal time in many places."""
    lat_deg: Annotated[Degrees, Field(ge=-90, le=90)] | None = Field(default=None, exclude=True)
    """Latitude of the place, positive in the north."""
    lon_deg: Annotated[Degrees, Field(ge=-180, le=180)] | None = Field(default=None, exclude=True)
    """Longitude of the place, positive in the east."""
    in_view_of: Literal["ego"] | None = Field(default=None, exclude_if=is_none)
    """Agent driving into the sun, with neither the world nor traffic hiding it."""
    within_deg: Annotated[
        Degrees, Field(gt=0, le=60), RangeReason("beyond 60 deg a camera does not see it")
    ] = Field(default=DEFAULT_WITHIN_DEG, exclude_if=lambda value: value == DEFAULT_WITHIN_DEG)
    """Largest angle from the axis of the ego's front camera that counts as in view."""
    seen_share: Fraction = Field(
        default=DEFAULT_SEEN_FRACTION, exclude_if=lambda value: value == DEFAULT_SEEN_FRACTION
    )
    """Lowest fraction of the ego's path on which it is in view."""

    @property
    def time_utc(self) -> datetime | None:
        """The instant of `at` in UTC; None without it, as in a spec."""
        if self.at is None or self.lon_deg is None:
            return None
        return parse_time(self.at, self.lon_deg).astimezone(UTC)

    @model_validator(mode="after")
    def _check_exclusive_fields(self) -> Self:
        # Defaults are filled in by now; only written fields can contradict.
        given = self.model_fields_set
        if self.in_view_of is None:
            for field in ("within_deg", "seen_share"):
                if (
                    field in given
                    and getattr(self, field) != type(self).model_fields[field].default
                ):
                    raise InvalidCombination((field,), "requires in_view_of", "add in_view_of: ego")
        by = "in_view_of" if self.in_view_of is not None else "at"
        determined = {
            "in_view_of": ("elevation_deg", "azimuth_deg", "at", "lat_deg", "lon_deg"),
            "at": ("elevation_deg", "azimuth_deg") if self.at is not None else (),
        }
        for field in determined[by]:
            if field in given:
                raise InvalidCombination(
                    (field,),
                    f"cannot be combined with {by}, which determines it",
                    "remove one of the two",
                    other_path=(by,),
                )
        self._place_by_time()
        return self

    def _place_by_time(self) -> None:
        """Compute the angles from time and place, if given."""
        if self.at is None or self.lat_deg is None or self.lon_deg is None:
            values = {"at": self.at, "lat_deg": self.lat_deg, "lon_deg": self.lon_deg}
            missing = [name for name, value in values.items() if value is None]
            if len(missing) < len(values):
                written = next(name for name in values if name not in missing)
                raise InvalidCombination(
                    (written,),
                    f"requires {' and '.join(missing)}",
                    "write e.g. at: 2024-11-22T16:30, lat_deg: 45.4, lon_deg: -75.7",
                )
            return
        try:
            time = parse_time(self.at, self.lon_deg)
        except TimeError as error:
            raise InvalidCombination(("at",), error.message, error.hint) from None
        elevation_deg, azimuth_deg = compute_sun_position(time, self.lat_deg, self.lon_deg)
        # A hundredth of a degree is the accuracy of the formulas; models are frozen otherwise.
        object.__setattr__(self, "elevation_deg", round(elevation_deg, 2))
        object.__setattr__(self, "azimuth_deg", round(azimuth_deg, 2))
        self.model_fields_set.update(("elevation_deg", "azimuth_deg"))


class Sky(Model):
    """Cloud cover and clearness of the sky."""

    oktas: Annotated[Count, Field(ge=0, le=8), RangeReason("cloud cover is counted in eighths")] = 0
    """Cloud cover: 0 cloudless, 8 overcast."""
    turbidity: Annotated[Number, Field(ge=2, le=10)] = 3
    """Turbidity, similar to Linke's: 2 very clear, 10 murky."""
    diffuse_lx: Annotated[Lux, Field(ge=0, le=150_000)] | None = None
    """Horizontal illuminance by the sky above any fog; `null` derives it from sun and clouds."""
    direct_lx: Annotated[Lux, Field(ge=0, le=150_000)] | None = None
    """Direct normal illuminance by the sun above any fog; `null` derives it likewise."""


class ByLandUse(Model):
    """A figure that differs between urban and rural areas."""

    urban: Annotated[Number, Field(ge=0, le=150_000)]
    """Value in urban areas."""
    rural: Annotated[Number, Field(ge=0, le=150_000)]
    """Value in rural areas."""


class Moon(Model):
    """The moon; by day it is too faint to matter."""

    phase: Fraction = 0
    """Lit fraction of its disc: 0 new, 0.5 half, 1 full."""
    elevation_deg: Annotated[Degrees, Field(ge=-90, le=90)] = 45
    """Elevation above the horizon."""
    azimuth_deg: Direction = 180
    """Azimuth, clockwise from north."""


NO_MOON = Moon()


class Night(Model):
    """Light at night from other sources than vehicles and the moon."""

    glow_cd_m2: ByLandUse = ByLandUse(urban=0.007, rural=0.0005)
    """Mean luminance of the night sky without the moon: 108,000 * 10^(-0.4 m) at m magnitudes per
    square arcsecond. By the classes of Bortle (2001) 2e-4 is 1 to 3, 5e-4 is 4 (rural), 0.001 and
    0.002 are 5 and 6 (suburbs), 0.007 is 8 or 9 (cities); clouds make towns ten times as bright."""
    street_lx: ByLandUse = ByLandUse(urban=12, rural=0.5)
    """Mean illuminance of the road by street lamps."""


HIGH_BEAM_USERS, LED_HEADLAMPS = 0.48, 0.3


class Lamps(Model):
    """Lit vehicle lamps in this weather; brake lamps follow the brakes."""

    low_beam: Flag = True
    """Headlamps."""
    fog: Flag = False
    """Fog lamps, front and rear."""
    high_beam: Fraction = Field(default=HIGH_BEAM_USERS, exclude_if=lambda v: v == HIGH_BEAM_USERS)
    """Fraction of drivers who use high beams where they may: by night, on roads without street
    lamps, in a visibility of 1 km, and with no driver ahead whom they dazzle. Drivers used them for
    48 % of the time that they could (Borzendowski, Stafford Sewall and Tyrrell 2015)."""
    led: Fraction = Field(default=LED_HEADLAMPS, exclude_if=lambda v: v == LED_HEADLAMPS)
    """Fraction of motor vehicles with headlamps of LEDs; others have halogen bulbs, and blueprints
    may declare which. The default is an assumption: of vehicles on the road in the USA more than
    80 % had halogen bulbs in 2015 (AAA), and newer counts by class and year were not found."""
