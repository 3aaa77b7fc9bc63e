"""Find the weather of every frame of a scenario, and the frame of its light.

Everything here is a function of the weather and the frame's number alone, so frames can be made in
any order. Air, precipitation and ground change with every frame. Light is updated only at frames
at which it has changed by `LIGHT_TOLERANCE`, because skies, clouds and light probes take seconds
to make; in between it is constant.
"""

import math
from functools import lru_cache
from itertools import pairwise

import numpy as np
from advercity_dsl import Spec, Weather
from advercity_dsl.keyframes import replace_value

from advercity.geometry.arrays import Float64Array
from advercity.physics import sky
from advercity.physics.atmosphere import (
    Atmosphere,
    LandUse,
    change_air_and_ground,
    compute_atmosphere,
    compute_fog_light_fraction,
)
from advercity.physics.clouds import choose_cloud_kind
from advercity.physics.extinction import compute_extinction
from advercity.physics.gusts import Gusts
from advercity.physics.precipitation import (
    CAMERA_HEIGHT_M,
    is_precipitating,
    wind_at_height,
)
from advercity.physics.weather_parts.part import Precipitation

LIGHT_TOLERANCE = 0.05
"""Relative change of light, or change of a fraction, at which light is updated."""
SUN_TOLERANCE_DEG = 1.0
"""Arc of the sun at which light is updated."""
MOMENTS_PER_KEYFRAME = 8
"""Moments from a keyframe to the next at which precipitation is counted: in between there may be
more of one size than at either."""
NIGHT_PATH_M = 100.0
"""Length of a path through air at night, to measure the light of lamps in it."""


class WeatherTimeline:
    """The weather of each frame.

    Args:
        weather: The weather of a scenario.
        tick_s: Time between frames.
        key: Random key of its gusts.
    """

    def __init__(self, weather: Weather, tick_s: float, *key: int | str) -> None:
        self._weather, self._tick_s = weather, tick_s
        self._gusts = Gusts(weather.wind.speed_m_s, *key)
        winds = (weather.wind, *(keyframe.wind for keyframe in weather.keyframes))
        self._is_gusty = any(wind.gust_factor > 1.0 for wind in winds)
        self._light_frames = [0]
        self._walked_to = 0
        self._paths_m = [np.zeros(3)]
        self.weather_at = lru_cache(maxsize=64)(self._compute_weather)
        self._compute_light = lru_cache(maxsize=2)(self._compute_atmosphere)
        self._change_air = lru_cache(maxsize=2)(self._change_air_and_ground)

    @staticmethod
    def from_spec(spec: Spec) -> "WeatherTimeline":
        """Build the timeline of a scenario."""
        return WeatherTimeline(spec.weather, spec.timing.tick_s, spec.seeds.weather, spec.id)

    @property
    def is_changing(self) -> bool:
        """Whether frames differ in their weather."""
        return bool(self._weather.keyframes) or self._is_gusty

    def _compute_weather(self, frame: int) -> Weather:
        time_s = frame * self._tick_s
        weather = self._weather.at(time_s)
        if not self._is_gusty:
            return weather
        ratio = self._gusts.compute_speed_ratio(weather.wind.gust_factor, time_s)
        return replace_value(weather, ("wind", "speed_m_s"), ratio * weather.wind.speed_m_s)

    def atmosphere_at(self, frame: int, land_use: LandUse) -> Atmosphere:
        """Compute the atmosphere of a frame; the same object for all frames of constant weather."""
        return self._change_air(frame if self.is_changing else 0, land_use)

    def _change_air_and_ground(self, frame: int, land_use: LandUse) -> Atmosphere:
        light = self._compute_light(self.find_light_frame(frame), land_use)
        return change_air_and_ground(light, self.weather_at(frame)) if self.is_changing else light

    def _compute_atmosphere(self, frame: int, land_use: LandUse) -> Atmosphere:
        return compute_atmosphere(self.weather_at(frame), land_use)

    def find_light_frame(self, frame: int) -> int:
        """Find the frame, `frame` or an earlier one, whose light applies to `frame`."""
        if not self._weather.keyframes:
            return 0
        while self._walked_to < frame:
            self._walked_to += 1
            weather = self.weather_at(self._walked_to)
            if compare_light(self.weather_at(self._light_frames[-1]), weather) >= 1.0:
                self._light_frames.append(self._walked_to)
        return max(made for made in self._light_frames if made <= frame)

    def list_precipitation(self) -> list[Precipitation]:
        """List the precipitation over the whole time of changing weather."""
        times_s = [0.0, *(keyframe.at_s for keyframe in self._weather.keyframes)]
        moments = [*np.linspace(0.0, 1.0, MOMENTS_PER_KEYFRAME, endpoint=False)]
        between = [a + (b - a) * part for a, b in pairwise(times_s) for part in moments]
        weathers = [self._weather.at(float(time_s)) for time_s in (*between, times_s[-1])]
        return [part for weather in weathers for part in compute_extinction(weather).precipitation]

    def compute_air_path_m(self, frame: int) -> Float64Array:
        """Compute the path (3,) since frame 0 of air and flakes at the height of cameras.

        Horizontally it is the air's, in world axes; downwards the flakes' through the air.
        """
        while len(self._paths_m) <= frame:
            weather = self.weather_at(len(self._paths_m))
            velocity = wind_at_height(weather.wind, CAMERA_HEIGHT_M)
            velocity[2] = -weather.snow.fall_speed_m_s
            self._paths_m.append(self._paths_m[-1] + velocity * self._tick_s)
        return self._paths_m[frame]


def compare_light(before: Weather, after: Weather) -> float:
    """Compare the light of two weathers; 1 is a change of the tolerance."""
    if before.time != after.time or _choose_kind(before) != _choose_kind(after):
        return math.inf
    first, second = _describe_light(before), _describe_light(after)
    arc = math.acos(min(1.0, float(np.dot(_find_sun(before), _find_sun(after)))))
    changes = np.abs(np.subtract(first, second)) / LIGHT_TOLERANCE
    return max(float(changes.max()), math.degrees(arc) / SUN_TOLERANCE_DEG)


def _choose_kind(weather: Weather) -> tuple[str, bool]:
    precipitating = is_precipitating(weather)
    return choose_cloud_kind(weather.sky.oktas, precipitating=precipitating)[0], precipitating


def _find_sun(weather: Weather) -> Float64Array:
    return sky.direction_from_elevation_azimuth(weather.sun.elevation_deg, weather.sun.azimuth_deg)


def _describe_light(weather: Weather) -> list[float]:
    """Describe the light by comparable numbers: logarithms and fractions."""
    light, night = sky.daylight_for_weather(weather), weather.night
    air = compute_extinction(weather)
    of_droplets, of_grains = (
        sum(depth for part, depth in air.layers if bool(part.droplet_um) == is_wet)
        for is_wet in (True, False)
    )
    by_lamps = (night.glow_cd_m2, night.street_lx) if weather.time == "night" else ()
    return [
        math.log(light.diffuse_lx + 1e-3),
        math.log(light.direct_lx + 1.0),
        weather.sky.oktas / 8.0,
        math.log(weather.sky.turbidity),
        math.exp(-of_droplets),
        compute_fog_light_fraction(air),
        math.log(2.0 + 0.13 * of_droplets),
        math.log1p(of_grains),
        sky.ground_albedo(weather.snow.depth_mm / 1000.0),
        math.exp(-air.at_550nm * NIGHT_PATH_M) if weather.time == "night" else 0.0,
        *(math.log(value + 1e-4) for pair in by_lamps for value in (pair.urban, pair.rural)),
    ]
