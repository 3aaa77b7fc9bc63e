"""Weather as physical components with additive extinctions, and its changes over time."""

from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from pydantic import (
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
from advercity_dsl.registry import add_fields
from advercity_dsl.units import (
    Celsius,
    Flag,
    RangeReason,
    Seconds,
)
from advercity_dsl.weather_components import (
    NO_HAIL,
    NO_MOON,
    Air,
    Dust,
    Fog,
    Hail,
    Lamps,
    Lens,
    Moon,
    Night,
    Rain,
    Sky,
    Snow,
    Sun,
    SurfaceWater,
    Wind,
)
from advercity_dsl.weather_parts import list_fields_of_others, load_weather_parts

LAMPS_ON_BELOW_DEG = -3.0
"""Elevation of a moving sun below which lamps light the scene: the sky leaves some 50 lx, at which
street lamps are switched on."""


class Keyframe(Model):
    """A changed weather at a time; unmentioned values run on unchanged."""

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
        """Written values, by path."""
        written = dict(iterate_written_values(self))
        del written["at_s",]
        return written

    # Omitted fields must not appear: reading them back would set them to a default.
    @model_serializer(mode="wrap")
    def _serialize_written_values(self, serialise: SerializerFunctionWrapHandler) -> dict[str, Any]:
        return _select_written(self, serialise(self))


if not TYPE_CHECKING:
    Keyframe = add_fields(Keyframe, list_fields_of_others())


def _select_written(model: Model, data: dict[str, Any]) -> dict[str, Any]:
    """Select the written fields from the data of a model."""
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
    moon: Moon = Field(default=NO_MOON, exclude_if=lambda value: value == NO_MOON)
    """The moon; new by default. It stays where it is: an hour moves it by 15 degrees."""
    sun_at: ByName[Sun] = Field(default_factory=dict)
    """Position of the sun at a road, by road id; replaces `sun` at that road."""

    keyframes: Items[Keyframe] = Field(default=(), exclude_if=is_empty)
    """Changes over time, in order; each value runs evenly between the keyframes that mention it."""

    optional: Flag = Field(default=False, exclude_if=lambda value: not value)
    """Whether only suites that name it have it: `all` leaves it out."""

    def at(self, time_s: float) -> "Weather":
        """Return the weather at a time in seconds since the first frame, without keyframes.

        Each value has its own track, from the weather's value at 0 s through its keyframes, with
        the interpolation of `interpolate_track`; the sun moves along its arc.
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
        for name in load_weather_parts().found:
            getattr(self, name).check_with(self)
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


if not TYPE_CHECKING:
    Weather = add_fields(Weather, list_fields_of_others())


def _interpolate_arc(
    track: list[tuple[float, tuple[float, float]]], time_s: float
) -> tuple[float, float]:
    """Interpolate elevation and azimuth in degrees along the arcs of a track."""
    for (from_s, before), (to_s, after) in pairwise(track):
        if time_s < to_s:
            return interpolate_direction(before, after, (time_s - from_s) / (to_s - from_s))
    return track[-1][1]
