"""Compute from a weather the physical state of air and light, the same for every sensor.

Everything is photometric: cd/m², lx and 1/m. Colours are linear sRGB factors with luminance 1.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from advercity_dsl import Weather
from advercity_dsl.weather_components import Wind
from numpy.typing import NDArray

from advercity.geometry.arrays import Float64Array
from advercity.physics import photometry, sky
from advercity.physics.clouds import CloudLayer, choose_cloud_kind
from advercity.physics.extinction import AirExtinction, compute_extinction, extinction_from_mor
from advercity.physics.fog_transfer import FogBank, Scatterer, compute_fog_radiance
from advercity.physics.moonlight import compute_moonlight
from advercity.physics.photometry import LED_COLOUR, Colour
from advercity.physics.precipitation import is_precipitating
from advercity.physics.sky import Daylight, daylight_for_weather, derive_daylight, sun_colour
from advercity.physics.water import compute_ice_cover


@dataclass(frozen=True, eq=False)
class Atmosphere:
    """The physical state of air, light and ground for every sensor.

    Attributes:
        extinction: Extinction coefficients of the air by component, 1/m.
        sun_direction: Unit vector (3,) towards the sun, or at night towards a shining moon.
        sun_lx: Its direct normal illuminance at the ground, after the loss in fog.
        sun_colour: Colour of its light.
        sky_lx: Diffuse horizontal illuminance by the upper half of `sky`.
        sky: (6, n, n, 3) float32 cubemap of luminance in cd/m² without the sun's disc, faces
            +x -x +y -y +z -z of the world; below the horizon it holds the light of the ground.
            Face axes (column right, row down): +x: (-y, -z), -x: (+y, -z), +y: (+x, -z),
            -y: (-x, -z), +z: (-y, +x), -z: (-y, -x).
        airlight: (6, m, m, 4) float32 cubemap, laid out as `sky`. Three colours in cd/m²: light
            scattered towards the eye by air near the ground, per unit of opacity (the source
            function). Then its relative growth along an infinite ray, as higher air is brighter.
        street_lx: Mean illuminance by street lamps, 0 by day.
        wetness: 0 dry to 1 soaked.
        puddle_coverage: Fraction of the carriageway under standing water.
        night: Whether lamps light the scene.
        rain_mm_h: Rate of the falling rain, which ripples puddles.
        ice_cover: Fraction of the texture of surfaces filled by clear ice.
        snow_depth_m: Depth of lying snow in the open.
        road_snow_cover: Fraction of the carriageway under snow.
        rut_snow_cover: Fraction of its wheel ruts under snow.
        water_film_mm: Depth of the water film on the road, which wheels throw up as spray.
        wind: Wind at 10 m height.
        clouds: Clouds by day, for images; `sky` is the mean over all skies of their cover.
        cloud_contrast: Fraction of their contrast behind mist.
    """

    extinction: AirExtinction
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
    ice_cover: float = 0.0
    snow_depth_m: float = 0.0
    road_snow_cover: float = 0.0
    rut_snow_cover: float = 0.0
    water_film_mm: float = 0.0
    wind: Wind = field(default_factory=Wind)
    clouds: CloudLayer | None = None
    cloud_contrast: float = 1.0

    @property
    def mor_m(self) -> float:
        """Visibility (MOR) of the whole atmosphere in metres; inf in a vacuum."""
        return self.extinction.mor_m

    @property
    def is_dark(self) -> bool:
        """Whether hardly any light comes from the sky: at night, but not at dusk."""
        return self.night and self.sky_lx < DARK_SKY_LX

    @property
    def ground_lx(self) -> float:
        """Illuminance of level ground in the open by sun and sky."""
        return self.sky_lx + self.sun_lx * max(0.0, float(self.sun_direction[2]))

    @property
    def horizon_airlight(self) -> Colour:
        """Airlight in cd/m² of horizontal rays, averaged over all azimuths."""
        middle = self.airlight.shape[1] // 2
        level = self.airlight[:4, middle - 1 : middle + 1, :, :3]
        red, green, blue = level.mean(axis=(0, 1, 2), dtype=np.float64)
        return float(red), float(green), float(blue)


LandUse = Literal["urban", "rural"]

DARK_SKY_LX = 1.0
"""Illuminance below which the sky is negligible against lamps: the sun is 7 degrees down."""
SKY_SIZE = 256
"""Texels along an edge of the sky cubemap."""
STREET_LIGHT_COLOUR = np.array(LED_COLOUR)
STREET_LIGHT_LAYER_M = 10.0
"""Height up to which street lamps light the air."""
STREET_LIGHT_EXTENT_M = 500.0
"""How far along the ground street lamps light the air: no town is infinite."""
GREY_SKY_FROM_OKTAS = 7.0
"""Cloud cover at which the sky is all grey."""
FOG_BELOW_M, MIST_BELOW_M = 1000.0, 10_000.0
"""Visibilities (MOR): fog is below the first (WMO-No. 407), hardly any mist above the second."""
_WHITE = np.ones(3)


@dataclass(frozen=True)
class _SceneLight:
    """Light of an atmosphere; fields as in `Atmosphere`, before dust colours them."""

    sun_lx: float
    sky: Float64Array
    airlight: NDArray[np.floating[Any]]
    street_lx: float = 0.0

    def add(self, other: "_SceneLight") -> "_SceneLight":
        """Add the light of other sources."""
        return _SceneLight(*(a + b for a, b in self._pair(other)))

    def mix(self, other: "_SceneLight", fraction: float) -> "_SceneLight":
        """Replace a fraction by other light."""
        return _SceneLight(*(a + (b - a) * fraction for a, b in self._pair(other)))

    def _pair(self, other: "_SceneLight") -> Iterator[tuple[Any, Any]]:
        return zip(vars(self).values(), vars(other).values(), strict=True)


def compute_atmosphere(weather: Weather, land_use: LandUse) -> Atmosphere:
    """Compute the atmosphere of `weather` over a town or the country."""
    extinction = compute_extinction(weather)
    night = weather.time == "night"
    moonlight = compute_moonlight(weather)
    source = weather.moon if night and moonlight.diffuse_lx else weather.sun
    towards = sky.direction_from_elevation_azimuth(source.elevation_deg, source.azimuth_deg)
    if night:
        light = _compute_night_light(weather, land_use, extinction)
        twilight = derive_daylight(weather)
        if twilight.diffuse_lx:
            sun = sky.direction_from_elevation_azimuth(
                weather.sun.elevation_deg, weather.sun.azimuth_deg
            )
            light = light.add(_compute_day_light(weather, sun, extinction, twilight))
        if moonlight.diffuse_lx:
            light = light.add(_compute_day_light(weather, towards, extinction, moonlight))
    else:
        light = _compute_day_light(weather, towards, extinction, daylight_for_weather(weather))
    sky_lx = photometry.horizontal_illuminance(light.sky)
    return Atmosphere(
        extinction=extinction,
        sun_direction=towards,
        sun_lx=light.sun_lx,
        sun_colour=sun_colour(source.elevation_deg),
        sky_lx=sky_lx,
        sky=light.sky.astype(np.float32),
        airlight=light.airlight.astype(np.float32),
        street_lx=light.street_lx,
        night=night,
        clouds=_choose_clouds(weather, extinction, towards, light.sun_lx, sky_lx),
        cloud_contrast=1.0 - compute_fog_light_fraction(extinction),
        **_list_air_and_ground(weather),
    )


def change_air_and_ground(atmosphere: Atmosphere, weather: Weather) -> Atmosphere:
    """Return the atmosphere with the air and the ground of a weather of the same light."""
    extinction = compute_extinction(weather)
    return replace(atmosphere, extinction=extinction, **_list_air_and_ground(weather))


def _list_air_and_ground(weather: Weather) -> dict[str, Any]:
    """List precipitation and the state of the ground, as fields of `Atmosphere`."""
    return {
        "wetness": weather.surface.wetness,
        "ice_cover": compute_ice_cover(weather.surface.ice_mm),
        "puddle_coverage": weather.surface.puddle_coverage,
        "rain_mm_h": weather.rain.rate_mm_h,
        "snow_depth_m": weather.snow.depth_mm / 1000.0,
        "road_snow_cover": weather.snow.road_coverage,
        "rut_snow_cover": weather.snow.rut_coverage,
        "water_film_mm": weather.surface.film_mm,
        "wind": weather.wind,
    }


def _choose_clouds(
    weather: Weather, extinction: AirExtinction, sun: Float64Array, sun_lx: float, sky_lx: float
) -> CloudLayer | None:
    """Choose the clouds of a day; fog and dust hide them, and at night they are dark."""
    is_hidden = compute_fog_light_fraction(extinction) == 1.0
    if weather.time == "night" or is_hidden or weather.sky.oktas == 0:
        return None
    oktas, precipitating = weather.sky.oktas, is_precipitating(weather)
    kind, base_m, depth_m = choose_cloud_kind(oktas, precipitating=precipitating)
    x, y, z = (float(axis) for axis in sun)
    lit_by_lx = sky_lx + sun_lx * max(z, 0.0)
    return CloudLayer(
        kind=kind,
        cover=weather.sky.oktas / 8.0,
        base_m=base_m,
        depth_m=depth_m,
        sun=(x, y, z),
        direct_lx=sun_lx,
        diffuse_lx=sky_lx,
        ground_lx=sky.ground_albedo(weather.snow.depth_mm / 1000.0) * lit_by_lx,
        turbidity=weather.sky.turbidity,
        haze_per_m=extinction.at_550nm,
    )


def _compute_day_light(
    weather: Weather, sun: Float64Array, extinction: AirExtinction, above: Daylight
) -> _SceneLight:
    """Compute the light of a day; in mist it is a mixture of the light without and with fog."""
    foggy = compute_fog_light_fraction(extinction)
    if foggy == 0.0:
        return _compute_fogless_light(weather, sun, above)
    light = _compute_foggy_light(weather, sun, extinction, above)
    if foggy == 1.0:
        return light
    return _compute_fogless_light(weather, sun, above).mix(light, foggy)


def compute_fog_light_fraction(extinction: AirExtinction) -> float:
    """Compute the fraction of sky light from layers such as fog and dust: 0 in thin mist.

    Below `FOG_BELOW_M` they hide the blue of the sky and its clouds; from there to `MIST_BELOW_M`
    it is proportional to their extinction.
    """
    thick, thin = (extinction_from_mor(mor_m) for mor_m in (FOG_BELOW_M, MIST_BELOW_M))
    by_layers = sum(part.extinction.at_550nm for part, _ in extinction.layers)
    return min(1.0, max(0.0, (by_layers - thin) / (thick - thin)))


def _compute_fogless_light(weather: Weather, sun: Float64Array, light: Daylight) -> _SceneLight:
    """Compute a CIE general sky, scaled to the diffuse illuminance; its horizon is the airlight.

    Over snow, part of the sky's light comes from the ground by way of the clouds; it is uniform.
    """
    albedo = sky.ground_albedo(weather.snow.depth_mm / 1000.0)
    from_ground = sky.ground_lit_fraction(albedo, weather.sky.oktas)
    uniform = from_ground * light.diffuse_lx / math.pi
    cloud_fraction = min(1.0, weather.sky.oktas / GREY_SKY_FROM_OKTAS)

    def shape(directions: Float64Array) -> Float64Array:
        relative = _cloudy_luminance(weather, sun, directions)[..., None]
        return relative * sky.sky_colour(directions, sun, cloud_fraction=cloud_fraction)

    directions = photometry.cubemap_directions(SKY_SIZE)
    relative = shape(directions)
    scale = (1.0 - from_ground) * light.diffuse_lx / photometry.horizontal_illuminance(relative)
    ground = albedo * (light.diffuse_lx + light.direct_lx * max(0.0, sun[2])) / math.pi
    below = directions[..., 2:] < 0.0
    return _SceneLight(
        sun_lx=light.direct_lx,
        sky=np.where(below, ground * _WHITE, scale * relative + uniform),
        airlight=sky.build_airlight_cubemap(
            scale * shape(sky.level_airlight_directions()) + uniform,
            scale * shape(np.array([0.0, 0.0, 1.0])) + uniform,
        ),
    )


def _cloudy_luminance(
    weather: Weather, sun: Float64Array, directions: Float64Array
) -> Float64Array:
    clouds = weather.sky
    return sky.cloudy_relative_luminance(directions, sun, clouds.oktas, turbidity=clouds.turbidity)


def _compute_foggy_light(
    weather: Weather, sun: Float64Array, extinction: AirExtinction, above: Daylight
) -> _SceneLight:
    """Compute the light scattered in fog, dust and the like, and the remaining direct sun.

    They form one layer with their total optical depth. Dust absorbs some colours more than others,
    so each colour is solved alone.
    """

    def shape(directions: Float64Array) -> Float64Array:
        return _cloudy_luminance(weather, sun, directions)

    directions = photometry.cubemap_directions(SKY_SIZE)
    relative = shape(directions)[..., None] * _WHITE
    scale = above.diffuse_lx / photometry.horizontal_illuminance(relative)
    parts, depths = zip(*extinction.layers, strict=True)
    extinction_per_m = sum(part.extinction.at_550nm for part in parts)
    fractions = [part.extinction.at_550nm / extinction_per_m for part in parts[1:]]
    fractions.insert(0, 1.0 - sum(fractions))
    rays = photometry.cubemap_directions(sky.AIRLIGHT_CUBEMAP_SIZE)

    def solve(albedos: tuple[float, ...]) -> tuple[float, Float64Array, Float64Array, Float64Array]:
        bank = FogBank(
            extinction_per_m,
            sum(depths) / extinction_per_m,
            sky.ground_albedo(weather.snow.depth_mm / 1000.0),
            tuple(
                Scatterer(fraction, part.lobes, albedo)
                for fraction, part, albedo in zip(fractions, parts, albedos, strict=True)
            ),
        )
        light = compute_fog_radiance(
            bank, sun=sun, direct_lx=above.direct_lx, sky=lambda up: scale * shape(up)
        )
        seen, scattered = light.sky_luminance(directions), light.airlight_luminance(rays)
        return light.sun_lx, seen, scattered, light.airlight_growth(rays)

    by_colour = list(zip(*(part.albedo for part in parts), strict=True))
    solved = {albedos: solve(albedos) for albedos in set(by_colour)}
    suns, seen, scattered, growth = zip(*(solved[albedos] for albedos in by_colour), strict=True)
    return _SceneLight(
        sun_lx=suns[0],
        sky=np.stack(seen, axis=-1),
        # Absorption differs between colours; the growth hardly does.
        airlight=np.stack([*scattered, growth[1]], axis=-1),
    )


def _compute_night_light(
    weather: Weather, land_use: LandUse, extinction: AirExtinction
) -> _SceneLight:
    """Compute the glow above and the ground below, seen through air lit by street lamps."""
    extinction_per_m = extinction.at_550nm
    glow_cd_m2: float = getattr(weather.night.glow_cd_m2, land_use)
    street_lx: float = getattr(weather.night.street_lx, land_use)
    glow_colour = STREET_LIGHT_COLOUR if land_use == "urban" else _WHITE
    glow, glow_lx = glow_cd_m2 * glow_colour, math.pi * glow_cd_m2
    absorbed = _absorbed_fraction(extinction)
    lit_by_lamps = sky.airlight_from_illuminance(street_lx) * STREET_LIGHT_COLOUR * (1.0 - absorbed)

    height = photometry.cubemap_directions(SKY_SIZE)[..., 2:]
    path_m = np.minimum(STREET_LIGHT_LAYER_M / np.abs(height), STREET_LIGHT_EXTENT_M)
    transmittance = np.exp(-extinction_per_m * path_m)
    ground = sky.GROUND_ALBEDO / math.pi * (glow_lx * glow_colour + street_lx * STREET_LIGHT_COLOUR)
    background = np.where(height > 0.0, glow, ground * transmittance)
    zenith_opacity = 1.0 - math.exp(-extinction_per_m * STREET_LIGHT_LAYER_M)
    return _SceneLight(
        sun_lx=0.0,
        sky=background + lit_by_lamps * (1.0 - transmittance),
        airlight=sky.build_airlight_cubemap(
            glow + lit_by_lamps, glow + lit_by_lamps * zenith_opacity
        ),
        street_lx=street_lx,
    )


def _absorbed_fraction(extinction: AirExtinction) -> Float64Array:
    """Compute the fraction (3,) of the extinguished light that particles absorb."""
    absorbed = np.zeros(3)
    for part in extinction.suspended:
        fraction = part.extinction.at_550nm / extinction.at_550nm
        absorbed += fraction * (1.0 - np.asarray(part.albedo))
    return absorbed
