"""From authored weather to the atmosphere that every sensor sees."""

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from advercity_dsl import Weather
from numpy.typing import NDArray

from advercity.weather import extinction, sky
from advercity.weather.atmosphere import Atmosphere
from advercity.weather.daylight import daylight_of, sun_colour
from advercity.weather.dust import dusty
from advercity.weather.extinction import Extinction
from advercity.weather.fog_bank import FogBank, daylit

LandUse = Literal["urban", "rural"]
Array = NDArray[np.float64]

SKY_SIZE = 256
"""Texels along an edge of the sky's cubemap."""
STREET_LIGHT_COLOUR = np.array([1.39, 0.94, 0.50])
"""4000 K, linear sRGB at luminance 1."""
LIT_LAYER_M = 10.0
"""Height up to which street lamps light the air."""
LIT_EXTENT_M = 500.0
"""How far along the ground they do."""
GREY_FROM_OKTAS = 7.0
"""Cover at which no blue is left in the sky."""
_WHITE = np.ones(3)


@dataclass(frozen=True)
class _Light:
    """What an atmosphere has of light; fields as in `Atmosphere`."""

    sun_lx: float
    sky: Array
    airlight: NDArray[np.floating[Any]]
    street_lx: float = 0.0


def atmosphere_of(weather: Weather, land_use: LandUse) -> Atmosphere:
    """The atmosphere of `weather` over town or country."""
    total = extinction.of_weather(weather)
    sun = sky.direction_to(weather.sun.elevation_deg, weather.sun.azimuth_deg)
    if weather.time == "night":
        light = _night(weather, land_use, total.at_550nm)
    elif weather.fog.mor_m is not None:
        light = _day_in_fog(weather, sun, extinction.of_visibility(weather.fog.mor_m))
    else:
        light = _day(weather, sun)
    return Atmosphere(
        extinction_550nm=total.at_550nm,
        extinction_905nm=total.at_905nm,
        sun_direction=sun,
        sun_lx=light.sun_lx,
        sun_colour=sun_colour(weather.sun.elevation_deg),
        sky_lx=sky.horizontal_illuminance(light.sky),
        sky=dusty(light.sky, weather, total).astype(np.float32),
        airlight=_dusty_air(light.airlight, weather, total),
        street_lx=light.street_lx,
        wetness=weather.surface.wetness,
        puddle_coverage=weather.surface.puddle_coverage,
        night=weather.time == "night",
        rain_mm_h=weather.rain.rate_mm_h,
        snow_depth_m=weather.snow.depth_mm / 1000.0,
        road_snow_cover=weather.snow.road_coverage,
        rut_snow_cover=weather.snow.rut_coverage,
    )


def _day(weather: Weather, sun: Array) -> _Light:
    """CIE general sky, scaled to the sky's illuminance; its horizon is the airlight.

    Over snow a share of that is light which the clouds have from the ground, and even.
    """
    light = daylight_of(weather)
    albedo = sky.ground_albedo(weather.snow.depth_mm / 1000.0)
    from_ground = sky.share_from_ground(albedo, weather.sky.oktas)
    even = from_ground * light.diffuse_lx / math.pi
    cie_type = sky.sky_type(weather.sky.oktas, turbidity=weather.sky.turbidity)
    cloud_share = min(1.0, weather.sky.oktas / GREY_FROM_OKTAS)

    def shape(directions: Array) -> Array:
        relative = sky.cie_luminance(directions, sun, cie_type)[..., None]
        return relative * sky.daylight_colour(directions, sun, cloud_share=cloud_share)

    directions = sky.cubemap_directions(SKY_SIZE)
    relative = shape(directions)
    scale = (1.0 - from_ground) * light.diffuse_lx / sky.horizontal_illuminance(relative)
    ground = albedo * (light.diffuse_lx + light.direct_lx * max(0.0, sun[2])) / math.pi
    below = directions[..., 2:] < 0.0
    return _Light(
        sun_lx=light.direct_lx,
        sky=np.where(below, ground * _WHITE, scale * relative + even),
        airlight=sky.airlight_between(
            scale * shape(_horizon()).mean(axis=0) + even,
            scale * shape(np.array([0.0, 0.0, 1.0])) + even,
        ),
    )


def _day_in_fog(weather: Weather, sun: Array, fog_extinction: float) -> _Light:
    """Light scattered in the bank; what is left of the direct sun is not in it."""
    above = daylight_of(weather)
    cie_type = sky.sky_type(weather.sky.oktas, turbidity=weather.sky.turbidity)

    def shape(directions: Array) -> Array:
        return sky.cie_luminance(directions, sun, cie_type)

    directions = sky.cubemap_directions(SKY_SIZE)
    scale = above.diffuse_lx / sky.horizontal_illuminance(shape(directions)[..., None] * _WHITE)
    fog = daylit(
        FogBank(fog_extinction, weather.fog.depth_m, weather.fog.droplet_um, sky.GROUND_ALBEDO),
        sun=sun,
        direct_lx=above.direct_lx,
        sky=lambda up: scale * shape(up),
    )
    rays = sky.cubemap_directions(sky.AIRLIGHT_SIZE)
    airlight = fog.airlight(rays)[..., None] * np.ones(3)
    return _Light(
        sun_lx=fog.sun_lx,
        sky=fog.sky(directions)[..., None] * _WHITE,
        airlight=np.concatenate([airlight, fog.rise(rays)[..., None]], axis=-1),
    )


def _night(weather: Weather, land_use: LandUse, extinction_550nm: float) -> _Light:
    """Glow overhead, ground below, both seen through a layer of air that street lamps light."""
    glow_cd_m2: float = getattr(weather.night.glow_cd_m2, land_use)
    street_lx: float = getattr(weather.night.street_lx, land_use)
    glow_colour = STREET_LIGHT_COLOUR if land_use == "urban" else _WHITE
    glow_lx = math.pi * glow_cd_m2
    lit_by_glow = sky.airlight_of(glow_lx) * glow_colour
    lit_by_lamps = sky.airlight_of(street_lx) * STREET_LIGHT_COLOUR

    height = sky.cubemap_directions(SKY_SIZE)[..., 2:]
    path_m = np.minimum(LIT_LAYER_M / np.abs(height), LIT_EXTENT_M)
    left = np.exp(-extinction_550nm * path_m)
    ground = sky.GROUND_ALBEDO / math.pi * (glow_lx * glow_colour + street_lx * STREET_LIGHT_COLOUR)
    behind = np.where(height > 0.0, glow_cd_m2 * glow_colour, ground * left)
    overhead = 1.0 - math.exp(-extinction_550nm * LIT_LAYER_M)
    return _Light(
        sun_lx=0.0,
        sky=behind + lit_by_lamps * (1.0 - left),
        airlight=sky.airlight_between(
            lit_by_glow + lit_by_lamps, glow_cd_m2 * glow_colour + lit_by_lamps * overhead
        ),
        street_lx=street_lx,
    )


def _horizon() -> Array:
    turn = np.arange(72) / 72 * 2.0 * math.pi
    return np.stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)], axis=-1)


def _dusty_air(
    airlight: NDArray[np.floating[Any]], weather: Weather, total: Extinction
) -> NDArray[np.float32]:
    coloured = dusty(airlight[..., :3].astype(float), weather, total)
    return np.concatenate([coloured, airlight[..., 3:]], axis=-1).astype(np.float32)
