"""What dust does to the colour of light: scattered many times, light takes the colour of dust.

From authored weather to what light does: extinction, airlight, sky, sun and ground light.

All photometric: cd/m², lx, 1/m. Colours are linear sRGB factors with luminance 1.

From authored weather to the atmosphere that every sensor sees.
"""

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from advercity_dsl import Weather
from numpy.typing import NDArray

from advercity.geometry.arrays import Float64Array
from advercity.physics import extinction, photometry, sky
from advercity.physics.extinction import Extinction, dust_extinction
from advercity.physics.fog_transfer import FogBank, compute_fog_radiance
from advercity.physics.photometry import Colour, luminance
from advercity.physics.sky import daylight_for_weather, sun_colour

DUST_LAYER_M = 1000.0
"""Depth of the dust above the ground: that of a storm's lower part."""


def dust_colour(weather: Weather) -> Float64Array:
    """Colour (3,) at luminance 1 that a thick layer of the dust throws back.

    Van de Hulst's fit for a layer without end, by the similarity of single-scattering albedo and
    asymmetry; grey dust gives white.
    """
    albedo = np.asarray(weather.dust.ssa_rgb)
    absorbed = np.sqrt((1.0 - albedo) / np.maximum(1.0 - albedo * weather.dust.g, 1e-9))
    back = (1.0 - 0.139 * absorbed) * (1.0 - absorbed) / (1.0 + 1.17 * absorbed)
    bright = float(luminance(back))
    return back / bright if bright > 0.0 else np.ones(3)


def dust_light_fraction(weather: Weather, total: Extinction) -> float:
    """Share of scattered light, 0 to 1, that the dust has coloured."""
    dust = dust_extinction(weather).at_550nm
    if not dust:
        return 0.0
    return dust / total.at_550nm * (1.0 - math.exp(-dust * DUST_LAYER_M))


def tint_by_dust(light: Float64Array, weather: Weather, total: Extinction) -> Float64Array:
    """Light (..., 3) as dust colours it, as bright as before."""
    share = dust_light_fraction(weather, total)
    if not share:
        return light
    return (1.0 - share) * light + share * luminance(light)[..., None] * dust_colour(weather)


@dataclass(frozen=True)
class Atmosphere:
    """The physical state that every sensor sees.

    Attributes:
        extinction_550nm: Total extinction in the visible, 1/m.
        extinction_905nm: Total extinction at the LiDAR's wavelength, 1/m.
        sun_direction: Unit vector (3,) towards the sun.
        sun_lx: Direct normal illuminance by the sun, already dimmed by fog above.
        sun_colour: Colour of direct sunlight.
        sky_lx: Diffuse horizontal illuminance: what the upper half of `sky` gives.
        sky: (6, n, n, 3) float32 cubemap of luminance in cd/m² without the sun's disc, faces
            +x -x +y -y +z -z of the world; below the horizon it is the light of the ground.
            Face axes (column right, row down): +x: (-y, -z), -x: (+y, -z), +y: (+x, -z),
            -y: (-x, -z), +z: (-y, +x), -z: (-y, -x).
        airlight: (6, m, m, 4) float32 cubemap, laid out as `sky`, of the light that air near the
            ground sends to the eye for each share that it takes away: three colours in cd/m², and
            by what share this grows along an endless ray, where air is brighter higher up.
        street_lx: Mean illuminance by street lamps, 0 by day.
        wetness: 0 dry to 1 soaked.
        puddle_coverage: Share of the carriageway under standing water.
        night: Whether lamps light the scene.
        rain_mm_h: Rate of the falling rain, which ripples puddles.
        snow_depth_m: Of the snow that lies in the open.
        road_snow_cover: Share of the carriageway under snow.
        rut_snow_cover: Share of its wheel ruts under snow.
    """

    extinction_550nm: float
    extinction_905nm: float
    sun_direction: NDArray[np.float64]
    sun_lx: float
    sun_colour: Colour
    sky_lx: float
    sky: NDArray[np.float32]
    airlight: NDArray[np.float32]
    street_lx: float
    wetness: float
    puddle_coverage: float
    night: bool
    rain_mm_h: float = 0.0
    snow_depth_m: float = 0.0
    road_snow_cover: float = 0.0
    rut_snow_cover: float = 0.0

    @property
    def mor_m(self) -> float:
        """Meteorological optical range of the whole atmosphere; inf in a vacuum."""
        return math.log(20.0) / self.extinction_550nm if self.extinction_550nm else math.inf

    @property
    def ground_lx(self) -> float:
        """Illuminance of level ground in the open by sun and sky."""
        return self.sky_lx + self.sun_lx * max(0.0, float(self.sun_direction[2]))

    @property
    def horizon_airlight(self) -> Colour:
        """Airlight in cd/m² looking level, on the mean of all sides."""
        middle = self.airlight.shape[1] // 2
        level = self.airlight[:4, middle - 1 : middle + 1, :, :3]
        red, green, blue = level.mean(axis=(0, 1, 2), dtype=np.float64)
        return float(red), float(green), float(blue)

    @property
    def zenith_airlight(self) -> Colour:
        """Airlight in cd/m² along an endless ray to the zenith."""
        middle = self.airlight.shape[1] // 2
        around = slice(middle - 1, middle + 1)
        zenith = self.airlight[4, around, around].reshape(-1, 4)
        red, green, blue = (zenith[:, :3] * (1.0 + zenith[:, 3:])).mean(axis=0, dtype=np.float64)
        return float(red), float(green), float(blue)


LandUse = Literal["urban", "rural"]

SKY_SIZE = 256
"""Texels along an edge of the sky's cubemap."""
STREET_LIGHT_COLOUR = np.array([1.39, 0.94, 0.50])
"""4000 K, linear sRGB at luminance 1."""
STREET_LIGHT_LAYER_M = 10.0
"""Height up to which street lamps light the air."""
STREET_LIGHT_EXTENT_M = 500.0
"""How far along the ground they do."""
GREY_SKY_FROM_OKTAS = 7.0
"""Cover at which no blue is left in the sky."""
_WHITE = np.ones(3)


@dataclass(frozen=True)
class _SceneLight:
    """What an atmosphere has of light; fields as in `Atmosphere`."""

    sun_lx: float
    sky: Float64Array
    airlight: NDArray[np.floating[Any]]
    street_lx: float = 0.0


def compute_atmosphere(weather: Weather, land_use: LandUse) -> Atmosphere:
    """The atmosphere of `weather` over town or country."""
    total = extinction.total_extinction(weather)
    sun = sky.direction_from_elevation_azimuth(weather.sun.elevation_deg, weather.sun.azimuth_deg)
    if weather.time == "night":
        light = _compute_night_light(weather, land_use, total.at_550nm)
    elif weather.fog.mor_m is not None:
        light = _compute_foggy_day_light(
            weather, sun, extinction.extinction_from_mor(weather.fog.mor_m)
        )
    else:
        light = _compute_day_light(weather, sun)
    return Atmosphere(
        extinction_550nm=total.at_550nm,
        extinction_905nm=total.at_905nm,
        sun_direction=sun,
        sun_lx=light.sun_lx,
        sun_colour=sun_colour(weather.sun.elevation_deg),
        sky_lx=photometry.horizontal_illuminance(light.sky),
        sky=tint_by_dust(light.sky, weather, total).astype(np.float32),
        airlight=_tint_airlight(light.airlight, weather, total),
        street_lx=light.street_lx,
        wetness=weather.surface.wetness,
        puddle_coverage=weather.surface.puddle_coverage,
        night=weather.time == "night",
        rain_mm_h=weather.rain.rate_mm_h,
        snow_depth_m=weather.snow.depth_mm / 1000.0,
        road_snow_cover=weather.snow.road_coverage,
        rut_snow_cover=weather.snow.rut_coverage,
    )


def _compute_day_light(weather: Weather, sun: Float64Array) -> _SceneLight:
    """CIE general sky, scaled to the sky's illuminance; its horizon is the airlight.

    Over snow a share of that is light which the clouds have from the ground, and even.
    """
    light = daylight_for_weather(weather)
    albedo = sky.ground_albedo(weather.snow.depth_mm / 1000.0)
    from_ground = sky.ground_lit_fraction(albedo, weather.sky.oktas)
    even = from_ground * light.diffuse_lx / math.pi
    cie_type = sky.cie_sky_type(weather.sky.oktas, turbidity=weather.sky.turbidity)
    cloud_share = min(1.0, weather.sky.oktas / GREY_SKY_FROM_OKTAS)

    def shape(directions: Float64Array) -> Float64Array:
        relative = sky.cie_relative_luminance(directions, sun, cie_type)[..., None]
        return relative * sky.sky_colour(directions, sun, cloud_fraction=cloud_share)

    directions = photometry.cubemap_directions(SKY_SIZE)
    relative = shape(directions)
    scale = (1.0 - from_ground) * light.diffuse_lx / photometry.horizontal_illuminance(relative)
    ground = albedo * (light.diffuse_lx + light.direct_lx * max(0.0, sun[2])) / math.pi
    below = directions[..., 2:] < 0.0
    return _SceneLight(
        sun_lx=light.direct_lx,
        sky=np.where(below, ground * _WHITE, scale * relative + even),
        airlight=sky.build_airlight_cubemap(
            scale * shape(_horizon_directions()).mean(axis=0) + even,
            scale * shape(np.array([0.0, 0.0, 1.0])) + even,
        ),
    )


def _compute_foggy_day_light(
    weather: Weather, sun: Float64Array, fog_extinction: float
) -> _SceneLight:
    """Light scattered in the bank; what is left of the direct sun is not in it."""
    above = daylight_for_weather(weather)
    cie_type = sky.cie_sky_type(weather.sky.oktas, turbidity=weather.sky.turbidity)

    def shape(directions: Float64Array) -> Float64Array:
        return sky.cie_relative_luminance(directions, sun, cie_type)

    directions = photometry.cubemap_directions(SKY_SIZE)
    scale = above.diffuse_lx / photometry.horizontal_illuminance(
        shape(directions)[..., None] * _WHITE
    )
    fog = compute_fog_radiance(
        FogBank(fog_extinction, weather.fog.depth_m, weather.fog.droplet_um, sky.GROUND_ALBEDO),
        sun=sun,
        direct_lx=above.direct_lx,
        sky=lambda up: scale * shape(up),
    )
    rays = photometry.cubemap_directions(sky.AIRLIGHT_CUBEMAP_SIZE)
    airlight = fog.airlight_luminance(rays)[..., None] * np.ones(3)
    return _SceneLight(
        sun_lx=fog.sun_lx,
        sky=fog.sky_luminance(directions)[..., None] * _WHITE,
        airlight=np.concatenate([airlight, fog.airlight_growth(rays)[..., None]], axis=-1),
    )


def _compute_night_light(
    weather: Weather, land_use: LandUse, extinction_550nm: float
) -> _SceneLight:
    """Glow overhead, ground below, both seen through a layer of air that street lamps light."""
    glow_cd_m2: float = getattr(weather.night.glow_cd_m2, land_use)
    street_lx: float = getattr(weather.night.street_lx, land_use)
    glow_colour = STREET_LIGHT_COLOUR if land_use == "urban" else _WHITE
    glow_lx = math.pi * glow_cd_m2
    lit_by_glow = sky.airlight_from_illuminance(glow_lx) * glow_colour
    lit_by_lamps = sky.airlight_from_illuminance(street_lx) * STREET_LIGHT_COLOUR

    height = photometry.cubemap_directions(SKY_SIZE)[..., 2:]
    path_m = np.minimum(STREET_LIGHT_LAYER_M / np.abs(height), STREET_LIGHT_EXTENT_M)
    left = np.exp(-extinction_550nm * path_m)
    ground = sky.GROUND_ALBEDO / math.pi * (glow_lx * glow_colour + street_lx * STREET_LIGHT_COLOUR)
    behind = np.where(height > 0.0, glow_cd_m2 * glow_colour, ground * left)
    overhead = 1.0 - math.exp(-extinction_550nm * STREET_LIGHT_LAYER_M)
    return _SceneLight(
        sun_lx=0.0,
        sky=behind + lit_by_lamps * (1.0 - left),
        airlight=sky.build_airlight_cubemap(
            lit_by_glow + lit_by_lamps, glow_cd_m2 * glow_colour + lit_by_lamps * overhead
        ),
        street_lx=street_lx,
    )


def _horizon_directions() -> Float64Array:
    turn = np.arange(72) / 72 * 2.0 * math.pi
    return np.stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)], axis=-1)


def _tint_airlight(
    airlight: NDArray[np.floating[Any]], weather: Weather, total: Extinction
) -> NDArray[np.float32]:
    coloured = tint_by_dust(airlight[..., :3].astype(float), weather, total)
    return np.concatenate([coloured, airlight[..., 3:]], axis=-1).astype(np.float32)
