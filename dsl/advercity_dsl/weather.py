"""Weather as physical components whose extinctions add up.

A component that is `null` or omitted is absent; so is one with a visibility of `inf`.
"""

import math
from itertools import pairwise
from typing import Annotated, Any, Literal, Self

from pydantic import (
    BeforeValidator,
    Field,
    SerializerFunctionWrapHandler,
    model_serializer,
    model_validator,
)

from advercity_dsl.base import (
    ByName,
    Declaration,
    InvalidCombination,
    Items,
    Model,
    ValuePath,
    is_empty,
    is_none,
)
from advercity_dsl.keyframes import (
    Track,
    get_value,
    interpolate_direction,
    interpolate_track,
    is_number,
    iterate_written_values,
    replace_value,
)
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
    Seconds,
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


class Air(Model):
    """Clear air and haze."""

    mor_m: Visibility = 20_000
    """Visibility (5 % contrast) by clear air and haze alone; `null` is no extinction."""


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
    depth_m: Annotated[Metres, Field(ge=1, le=2000)] = 100
    """Height of the fog bank, which determines the transmitted daylight."""


class Rain(Model):
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


class Snow(Model):
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


class Hail(Model):
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


class Dust(Model):
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
    """Direction that it blows from, clockwise from north."""
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
    """Thickness of clear ice (glaze) on all that is under the open sky."""


class LensCoverage(Model):
    """Fraction of the glass that is covered, by viewing direction of the camera."""

    front: Fraction = 0
    """Cameras that look ahead, which airflow keeps clearer."""
    side: Fraction = 0
    """Cameras that look sideways."""
    rear: Fraction = 0
    """Cameras that look back."""


class Lens(Model):
    """Drops or dirt on the glass; disabled by default, as in the original dataset."""

    enabled: Flag = False
    """Whether the glass is covered at all."""
    kind: Literal["water", "dust", "snow"] = "water"
    """Kind of cover."""
    coverage: LensCoverage = LensCoverage()
    """Covered fractions of the glass."""
    stray_light: Fraction = 0.02
    """Fraction of light that the optics scatter: 0.02 clean, 0.05 damp, 0.10 dirty."""


# Omitted from JSON at these values, so that specs without glare do not mention them.
DEFAULT_WITHIN_DEG, DEFAULT_SEEN_FRACTION = 25.0, 0.5


class Sun(Model):
    """Position of the sun, or the agent in whose view it must be.

    Given by `elevation_deg` and `azimuth_deg`, or by `in_view_of`, for which `advercity solve`
    computes both at every road and writes them to `sun_at`.
    """

    elevation_deg: Annotated[
        Degrees, Field(ge=-90, le=90), RangeReason("90 deg is straight overhead")
    ] = 60
    """Elevation above the horizon; negative at night."""
    azimuth_deg: Direction = 180
    """Azimuth, clockwise from north."""
    in_view_of: Literal["ego"] | None = Field(default=None, exclude_if=is_none)
    """Agent that drives into the sun, with neither the world nor traffic hiding it."""
    within_deg: Annotated[
        Degrees, Field(gt=0, le=60), RangeReason("beyond 60 deg a camera does not see it")
    ] = Field(default=DEFAULT_WITHIN_DEG, exclude_if=lambda value: value == DEFAULT_WITHIN_DEG)
    """Largest angle from the axis of the ego's front camera that counts as in view."""
    seen_share: Fraction = Field(
        default=DEFAULT_SEEN_FRACTION, exclude_if=lambda value: value == DEFAULT_SEEN_FRACTION
    )
    """Lowest fraction of the ego's path on which it is in view."""

    @model_validator(mode="after")
    def _check_exclusive_fields(self) -> Self:
        # Defaults are filled in by now; only what was written can contradict.
        given = self.model_fields_set
        if self.in_view_of is None:
            for field in ("within_deg", "seen_share"):
                if (
                    field in given
                    and getattr(self, field) != type(self).model_fields[field].default
                ):
                    raise InvalidCombination((field,), "requires in_view_of", "add in_view_of: ego")
        for field in ("elevation_deg", "azimuth_deg"):
            if self.in_view_of is not None and field in given:
                raise InvalidCombination(
                    (field,),
                    "cannot be combined with in_view_of, which determines it",
                    "remove one of the two",
                    other_path=("in_view_of",),
                )
        return self


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


class Night(Model):
    """Light at night from other sources than vehicles."""

    glow_cd_m2: ByLandUse = ByLandUse(urban=0.007, rural=0.0005)
    """Mean luminance of the night sky."""
    street_lx: ByLandUse = ByLandUse(urban=12, rural=0.5)
    """Mean illuminance of the road by street lamps."""


class Lamps(Model):
    """Vehicle lamps that are on in this weather; brake lamps follow the brakes."""

    low_beam: Flag = True
    """Headlamps."""
    fog: Flag = False
    """Fog lamps, front and rear."""


LAMPS_ON_BELOW_DEG = -3.0
"""Elevation of a moving sun below which lamps light the scene: the sky leaves some 50 lx, at which
street lamps are switched on."""


class Keyframe(Model):
    """What the weather has changed to at a time; what it does not mention runs on unchanged."""

    at_s: Annotated[
        Seconds,
        Field(gt=0, le=100_000),
        RangeReason("the weather itself is that at 0 s, and no scenario lasts longer than a day"),
    ]
    """Time since the first recorded frame."""
    air: Air = Air()
    """Clear air and haze."""
    fog: Fog = Fog()
    """Fog."""
    rain: Rain = Rain()
    """Rain."""
    snow: Snow = Snow()
    """Falling and lying snow."""
    hail: Hail = NO_HAIL
    """Hail."""
    dust: Dust = Dust()
    """Dust."""
    wind: Wind = Wind()
    """Wind at 10 m height."""
    surface: SurfaceWater = SurfaceWater()
    """Water on the ground."""
    lens: Lens = Lens()
    """Drops or dirt on cameras."""
    sun: Sun = Sun()
    """Position of the sun, which moves along the arc from the one before."""
    sky: Sky = Sky()
    """Clouds and their brightness."""
    night: Night = Night()
    """Light at night from other sources than vehicles."""
    lamps: Lamps = Lamps()
    """Lamps that drivers switch on, at once."""
    temperature_c: Annotated[Celsius, Field(ge=-60, le=60)] = 15
    """Temperature of the air."""

    @property
    def changes(self) -> dict[ValuePath, Any]:
        """Values that were written, by path."""
        written = dict(iterate_written_values(self))
        del written["at_s",]
        return written

    # What was not written must not appear: to read it back would set it to a default.
    @model_serializer(mode="wrap")
    def _serialize_written_values(self, serialise: SerializerFunctionWrapHandler) -> dict[str, Any]:
        return _select_written(self, serialise(self))


def _select_written(model: Model, data: dict[str, Any]) -> dict[str, Any]:
    """Select from the data of a model what was written of it."""
    return {
        name: _select_written(inner, data[name])
        if isinstance(inner := getattr(model, name), Model)
        else data[name]
        for name in data
        if name in model.model_fields_set
    }


class Weather(Declaration):
    """State of air, light and ground, as observed by every sensor."""

    kind: Literal["weather"] = "weather"
    time: Literal["day", "night"]
    """Whether the sun or lamps light the scene."""
    air: Air = Air()
    """Clear air and haze."""
    fog: Fog = Fog()
    """Fog; none by default."""
    rain: Rain = Rain()
    """Rain; none by default."""
    snow: Snow = Snow()
    """Falling and lying snow; none by default."""
    hail: Hail = Field(default=NO_HAIL, exclude_if=lambda value: value == NO_HAIL)
    """Hail; none by default."""
    dust: Dust = Dust()
    """Dust; none by default."""
    wind: Wind = Wind()
    """Wind at 10 m height."""
    surface: SurfaceWater = SurfaceWater()
    """Water on the ground."""
    lens: Lens = Lens()
    """Drops or dirt on cameras."""
    sun: Sun = Sun()
    """Position of the sun."""
    sky: Sky = Sky()
    """Clouds and their brightness."""
    night: Night = Night()
    """Light at night from other sources than vehicles."""
    lamps: Lamps = Lamps()
    """Lamps that drivers switch on."""
    temperature_c: Annotated[Celsius, Field(ge=-60, le=60)] = 15
    """Temperature of the air."""
    sun_at: ByName[Sun] = Field(default_factory=dict)
    """Position of the sun at a road, by road id; replaces `sun` at that road."""

    keyframes: Items[Keyframe] = Field(default=(), exclude_if=is_empty)
    """Changes over time, in order; each value runs evenly between the keyframes that mention it."""

    def at(self, time_s: float) -> "Weather":
        """Return the weather at a time in seconds since the first frame, without keyframes.

        Each value has a track of its own, from the weather's own value at 0 s through the keyframes
        that mention it, and is interpolated as `interpolate_track` does, the sun along its arc.
        """
        if not self.keyframes:
            return self
        state = self.model_copy(update={"keyframes": ()})
        for path in dict.fromkeys(path for keyframe in self.keyframes for path in keyframe.changes):
            if path[0] != "sun":
                value = interpolate_track(str(path[-1]), self._build_track(path), time_s)
                state = replace_value(state, path, value)
        if self._moves_sun:
            state = self._move_sun(state, time_s)
        return state

    @property
    def _moves_sun(self) -> bool:
        return any("sun" in keyframe.model_fields_set for keyframe in self.keyframes)

    def _build_track(self, path: ValuePath) -> Track:
        """Build the track of the value at a path."""
        written = ((item.at_s, item.changes) for item in self.keyframes)
        later = [(at_s, changes[path]) for at_s, changes in written if path in changes]
        return [(0.0, get_value(self, path)), *later]

    def _move_sun(self, state: "Weather", time_s: float) -> "Weather":
        """Move the sun of a state along its arc, and make it day or night by it."""
        angles_deg = self.sun.elevation_deg, self.sun.azimuth_deg
        track = [(0.0, angles_deg)]
        for keyframe in self.keyframes:
            if "sun" in keyframe.model_fields_set:
                changes = keyframe.changes
                angles_deg = (
                    changes.get(("sun", "elevation_deg"), angles_deg[0]),
                    changes.get(("sun", "azimuth_deg"), angles_deg[1]),
                )
                track.append((keyframe.at_s, angles_deg))
        elevation_deg, azimuth_deg = _interpolate_arc(track, time_s)
        sun = self.sun.model_copy(
            update={"elevation_deg": elevation_deg, "azimuth_deg": azimuth_deg}
        )
        time = "day" if elevation_deg > LAMPS_ON_BELOW_DEG else "night"
        return state.model_copy(update={"sun": sun, "time": time})

    @model_validator(mode="after")
    def _check(self) -> Self:
        self._check_components()
        self._check_sun(("sun", "elevation_deg"), self.sun)
        for road, sun in self.sun_at.items():
            self._check_sun(("sun_at", road, "elevation_deg"), sun)
        earlier_s = 0.0
        for index, keyframe in enumerate(self.keyframes):
            self._check_keyframe(("keyframes", index), keyframe, earlier_s)
            earlier_s = keyframe.at_s
        return self

    def _check_components(self) -> None:
        fog, air, snow = self.fog.mor_m, self.air.mor_m, self.snow
        if fog is not None and air is not None and fog > air:
            raise InvalidCombination(
                ("fog", "mor_m"),
                f"fog of {fog:g} m is clearer than the air's {air:g} m (air.mor_m)",
                "lower it, or remove the fog",
                other_path=("air", "mor_m"),
            )
        if snow.rut_coverage > snow.road_coverage:
            raise InvalidCombination(
                ("snow", "rut_coverage"),
                f"{snow.rut_coverage:g} is more than road_coverage, {snow.road_coverage:g}",
                "wheels clear the ruts; give the same or less",
            )
        if snow.rate_mm_h > 0 and self.temperature_c > 3:
            raise InvalidCombination(
                ("temperature_c",),
                f"it snows at {self.temperature_c:g} degC",
                "snow needs a temperature_c of 3 or less",
                other_path=("snow", "rate_mm_h"),
            )

        if self.surface.ice_mm > 0 and self.temperature_c > 3:
            raise InvalidCombination(
                ("temperature_c",),
                f"ice lies at {self.temperature_c:g} degC",
                "ice needs a temperature_c of 3 or less",
                other_path=("surface", "ice_mm"),
            )

    def _check_keyframe(self, path: ValuePath, keyframe: Keyframe, earlier_s: float) -> None:
        if keyframe.at_s <= earlier_s:
            raise InvalidCombination(
                (*path, "at_s"),
                f"{keyframe.at_s:g} s is not after the keyframe before, {earlier_s:g} s",
                "order keyframes by time, one for each moment",
            )
        if not keyframe.changes:
            raise InvalidCombination(
                path, "changes nothing", "write what is different then, e.g. rain: {rate_mm_h: 10}"
            )
        if keyframe.sun.in_view_of is not None:
            raise InvalidCombination(
                (*path, "sun", "in_view_of"),
                "is for the weather itself: no sun is sought for a moment",
                "write elevation_deg and azimuth_deg",
            )
        if self.sun.in_view_of is not None and "sun" in keyframe.model_fields_set:
            raise InvalidCombination(
                (*path, "sun"),
                "moves the sun, whose place in_view_of determines",
                "remove one of the two",
                other_path=("sun", "in_view_of"),
            )
        self._check_derived_light(path, keyframe)
        try:
            self.at(keyframe.at_s)._check_components()
        except InvalidCombination as error:
            raise InvalidCombination(
                (*path, *error.value_path),
                f"at {keyframe.at_s:g} s: {error.message}",
                error.hint,
                other_path=(*path, *error.other_path),
            ) from None

    def _check_derived_light(self, path: ValuePath, keyframe: Keyframe) -> None:
        """Check that illuminances are either derived or written at all keyframes."""
        for field in ("diffuse_lx", "direct_lx"):
            at = ("sky", field)
            if (
                at in keyframe.changes
                and len({is_number(value) for _, value in self._build_track(at)}) > 1
            ):
                raise InvalidCombination(
                    (*path, *at),
                    "is a number at one moment and derived at another",
                    "write a number for the weather itself and at each keyframe, or none at all",
                    other_path=at,
                )

    def _check_sun(self, value_path: Items[str], sun: Sun) -> None:
        if (sun.elevation_deg > 0) != (self.time == "day"):
            raise InvalidCombination(
                value_path,
                f"the sun is at {sun.elevation_deg:g} deg, but it is {self.time} (time)",
                "write a positive elevation by day, e.g. 30 deg, a negative one at night",
                other_path=("time",),
            )


def _interpolate_arc(
    track: list[tuple[float, tuple[float, float]]], time_s: float
) -> tuple[float, float]:
    """Interpolate elevation and azimuth in degrees along the arcs of a track."""
    for (from_s, before), (to_s, after) in pairwise(track):
        if time_s < to_s:
            return interpolate_direction(before, after, (time_s - from_s) / (to_s - from_s))
    return track[-1][1]
