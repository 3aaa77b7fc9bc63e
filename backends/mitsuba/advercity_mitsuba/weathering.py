"""Water, ice and snow on surfaces, in the same places and amounts for every backend."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from advercity.materials import TRANSMITTED_BY_LEAVES, Texture
from advercity.physics import water
from advercity.physics.atmosphere import Atmosphere
from advercity.rendering.cover import select_decks
from advercity.rendering.ground_maps import (
    NEUTRAL_WEAR,
    NO_SHELTER,
    WEAR_STEPS,
    WEAR_TONE,
    GroundMap,
    build_shelter_map,
    build_wear_map,
    needs_shelter_map,
)
from advercity.rendering.surface_weather import (
    CLEAN_SNOW,
    DIRTY_SNOW,
    INDEX_MATCHED_RATIO,
    SNOW_DEPTH_M,
    SNOW_DEPTH_ON_ROAD_M,
    compute_surface_weather,
)
from advercity.world import World
from advercity_mitsuba.noise import hash_cell, retained_contrast, smoothstep, value_noise
from advercity_mitsuba.reflection import VARNISH_INDEX, Surface
from advercity_mitsuba.variant import dr, mi

LOGISTIC = 1.702
"""Slope of the logistic law in place of the normal distribution."""
RIPPLE_WAVELENGTH_M = 0.04
"""Wavelength of the ripples of rain in puddles."""
FILMLESS_TEXTURES = (
    Texture.GRASS,
    Texture.SOIL,
    Texture.CROPS,
    Texture.BARK,
    Texture.LEAVES,
    Texture.CROWN,
)
"""Between blades, leaves and crumbs water stays in drops."""


@dataclass(frozen=True, eq=False)
class WeatherTables:
    """Water, ice and snow on a world's surfaces, on the device; numbers as in `SurfaceWeather`.

    Attributes:
        has_snow: Whether snow lies anywhere.
        is_wet: Whether there is water or ice.
        has_decks: Whether decks keep rain off.
    """

    has_snow: bool
    is_wet: bool
    has_decks: bool
    numbers: Any
    puddles: Any
    wear: Any
    wear_extent: Any
    shelter: Any
    shelter_extent: Any
    frame_index: Any


class GroundMaps:
    """Maps of a world's ground on the device; the one of shelter is made when it is needed."""

    def __init__(self, world: World) -> None:
        self._world = world
        wear = build_wear_map(world.lanes)
        texels = (wear.texels.astype(np.float32) - NEUTRAL_WEAR) / WEAR_STEPS * (1.0, WEAR_TONE)
        self.wear, self.wear_extent = _upload(wear, texels)
        # Beyond one texel, the height field repeats.
        field = water.build_puddle_height_field()
        self.puddles = mi.Texture2f(
            mi.TensorXf(field[..., None]), wrap_mode=dr.WrapMode.Repeat, use_accel=False
        )
        self.has_decks = bool(select_decks(world.static))
        self._shelter = _upload(NO_SHELTER, NO_SHELTER.texels)
        self._has_shelter = False

    def get_shelter(self, atmosphere: Atmosphere) -> tuple[Any, Any]:
        """Get the map of shelter from snow and rain, and its extent."""
        if not self._has_shelter and needs_shelter_map(self._world, atmosphere):
            found = build_shelter_map(self._world)
            self._shelter, self._has_shelter = _upload(found, found.texels), True
        return self._shelter


def _upload(ground: GroundMap, texels: Any) -> tuple[Any, Any]:
    channels = texels.reshape(*texels.shape[:2], -1).astype(np.float32)
    texture = mi.Texture2f(mi.TensorXf(channels), wrap_mode=dr.WrapMode.Clamp, use_accel=False)
    extent = mi.Vector4f(*ground.extent)
    dr.make_opaque(extent)
    return texture, extent


def build_weather_tables(
    maps: GroundMaps, atmosphere: Atmosphere, frame_index: int
) -> WeatherTables:
    """Build the tables of a frame under an atmosphere."""
    weather = compute_surface_weather(atmosphere)
    shelter, extent = maps.get_shelter(atmosphere)
    names = vars(weather)
    return WeatherTables(
        has_snow=weather.snow_depth_m > 0.0,
        is_wet=weather.wetness > 0.0 or weather.ice_cover > 0.0,
        has_decks=maps.has_decks,
        numbers={name: dr.opaque(mi.Float, value) for name, value in names.items()},
        puddles=maps.puddles,
        wear=maps.wear,
        wear_extent=maps.wear_extent,
        shelter=shelter,
        shelter_extent=extent,
        frame_index=dr.opaque(mi.Int32, frame_index),
    )


def _is_one_of(kind: Any, textures: tuple[Texture, ...]) -> Any:
    found = mi.Bool(False)
    for texture in textures:
        found |= kind == int(texture)
    return found


def is_road(kind: Any) -> Any:
    """Whether a texture is a carriageway's."""
    return _is_one_of(kind, (Texture.ASPHALT, Texture.MARKING))


def compute_wear(w: WeatherTables, p: Any, footprint: Any) -> tuple[Any, Any]:
    """Compute the wear of a carriageway.

    Returns:
        Excess of polish by tyres over the mean of its lane (up to 1), and the change of its albedo
        by tyres, oil and the age of its paving.
    """
    uv = (mi.Point2f(p.x, p.y) - w.wear_extent.xy) * w.wear_extent.zw
    inside = dr.all((uv >= 0.0) & (uv <= 1.0))
    kept = dr.select(inside, retained_contrast(3.0, footprint), 0.0)
    polish, tone = w.wear.eval(uv)
    return kept * polish, kept * tone


def _cover_fraction(fraction: Any, noise: Any, sigma: float, kept: Any, soft: float) -> Any:
    """Compute the coverage of a pixel by patches of noise above a threshold.

    Noise finer than the pixel's footprint is not resolved and blends.
    """
    likely = dr.clip(fraction, 1e-3, 1.0 - 1e-3)
    at = sigma / LOGISTIC * dr.log(likely / (1.0 - likely))
    lost = sigma * sigma * (1.0 - kept * kept)
    return 1.0 / (1.0 + dr.exp(-LOGISTIC * (kept * noise + at) / dr.sqrt(lost + soft * soft)))


def _standing_water(w: WeatherTables, kind: Any, p: Any, n: Any, footprint: Any) -> Any:
    """Compute the fraction of a pixel under standing water."""
    sigma, sharp, wavelength = 0.2, 0.02, 6.0
    kept = retained_contrast(wavelength, footprint)
    uv = mi.Point2f(p.x, p.y) / water.PUDDLE_TEXEL_M + 0.5
    texels = water.HOLLOWS_PER_EDGE * water.TEXELS_PER_HOLLOW
    height = 0.5 + (w.puddles.eval(uv / texels)[0] - 0.5) * kept
    soft = dr.sqrt(sigma * sigma * (1.0 - kept * kept) + sharp * sharp)
    level = w.numbers["puddle_level"]
    covered = 1.0 / (1.0 + dr.exp(LOGISTIC * (height - level) / soft))
    return dr.select((level > -0.5) & is_road(kind) & (n.z > 0.9), covered, 0.0)


def _ripple_normal(w: WeatherTables, p: Any, footprint: Any) -> Any:
    """Compute the normal of standing water in rain: rings of waves around drops, as shaders do."""
    layers, cell_m, length_m, width_m = 5, 0.13, 0.03, 0.022
    reach, off_middle, edge, deviation = 0.3, 0.1, 0.1, 0.301
    slope = w.numbers["ripple_slope"] * retained_contrast(RIPPLE_WAVELENGTH_M, footprint)
    total = mi.Vector2f(0.0)
    for layer in range(layers):
        q = mi.Vector2f(p.x / cell_m + 0.37 * layer, p.y / cell_m + 0.61 * layer)
        cell = dr.floor(q)
        f = q - cell
        salt = 200 + 3 * (layers * w.frame_index + layer)
        i = mi.Vector2i(cell)
        drawn = [hash_cell(i.x, i.y, salt + number) for number in range(3)]
        away = f - 0.5 - off_middle * mi.Vector2f(drawn[0], drawn[1])
        age = 0.5 + 0.5 * drawn[2]
        far = dr.norm(away)
        behind = cell_m * (far - reach * age)
        rim = dr.minimum(f, 1.0 - f) / edge
        wave = dr.sin(2.0 * dr.pi * behind / length_m) * dr.exp(-dr.square(behind / width_m))
        wave *= dr.sqrt(1.0 - age) * dr.minimum(dr.min(rim), 1.0)
        total += wave / dr.maximum(far, 1e-3) * away
    return dr.normalize(mi.Vector3f(slope / deviation * total.x, slope / deviation * total.y, 1.0))


def _snowfall_fraction(w: WeatherTables, p: Any) -> Any:
    """Compute the fraction of falling snow on the ground, less under trees and roofs."""
    clearance, offset = 0.4, 0.7
    total = mi.Float(0.0)
    for x, y in ((0, 0), (-1, 1), (1, -1), (-1, -1), (1, 1)):
        at = mi.Point2f(p.x + offset * x, p.y + offset * y)
        top, sheltered, *_ = w.shelter.eval((at - w.shelter_extent.xy) * w.shelter_extent.zw)
        total += dr.select(p.z < top - clearance, 1.0 - sheltered, 1.0)
    return total / 5.0


def _rainfall_fraction(w: WeatherTables, p: Any) -> Any:
    """Compute the fraction of rain on the ground, none under decks."""
    tolerance, offset = 0.05, 0.5
    if not w.has_decks:
        return mi.Float(1.0)
    total = mi.Float(0.0)
    for x, y in ((0, 0), (-1, 1), (1, -1), (-1, -1), (1, 1)):
        at = mi.Point2f(p.x + offset * x, p.y + offset * y)
        underside = w.shelter.eval((at - w.shelter_extent.xy) * w.shelter_extent.zw)[2]
        total += dr.select(p.z < underside + tolerance, 0.0, 1.0)
    return total / 5.0


def _patch_noise(p: Any, footprint: Any) -> tuple[Any, Any]:
    """Evaluate noise of ragged patches, and the resolved fraction of its contrast."""
    gain, wavelength, weight = 0.75, 2.1, 0.38
    total, resolved, everything = mi.Float(0.0), mi.Float(0.0), 0.0
    q = p + 0.25 * mi.Point2f(value_noise(p / 1.3, 94), value_noise(p / 1.3, 95))
    for octave in range(6):
        kept = retained_contrast(wavelength, footprint)
        q = mi.Point2f(0.8 * q.x - 0.6 * q.y, 0.6 * q.x + 0.8 * q.y)
        total += weight * kept * value_noise(q / wavelength, 91 + 8 * octave)
        resolved += weight * weight * kept
        everything += weight * weight
        wavelength *= 0.43
        weight *= gain
    return total, dr.sqrt(resolved / everything)


def _snow_cover(w: WeatherTables, kind: Any, snowless: Any, p: Any, n: Any, footprint: Any) -> Any:
    """Compute the fraction of a pixel under lying snow; traffic clears ruts of roads."""
    sigma, soft = 0.2, 0.04
    road = is_road(kind)
    upward = dr.clip((n.z - 0.35) / 0.4, 0.0, 1.0)
    scale = dr.select(road, mi.Float(SNOW_DEPTH_ON_ROAD_M), SNOW_DEPTH_M)
    cover = upward * (1.0 - dr.exp(-w.numbers["snow_depth_m"] / scale)) * _snowfall_fraction(w, p)
    rut = smoothstep(0.1, 0.5, compute_wear(w, p, footprint)[0])
    cleared = dr.lerp(w.numbers["snow_between_ruts"], w.numbers["snow_in_ruts"], rut)
    cover *= dr.select(road, cleared, 1.0)
    resolved, kept = _patch_noise(mi.Point2f(p.x, p.y), footprint)
    noise = dr.select(kept > 0.0, resolved / kept, 0.0)
    ragged = _cover_fraction(cover, noise, sigma, kept, soft)
    cover = dr.select(kind == int(Texture.PLAIN), cover, ragged)
    return dr.select(snowless | (upward <= 0.0), 0.0, cover)


def _snow_albedo(w: WeatherTables, kind: Any, p: Any, footprint: Any) -> Any:
    clean, dirty = mi.Color3f(*CLEAN_SNOW), mi.Color3f(*DIRTY_SNOW)
    driven = smoothstep(0.0, 0.5, compute_wear(w, p, footprint)[0])
    return dr.select(is_road(kind), dr.lerp(clean, dirty, driven), clean)


def _snow_normal(p: Any, n: Any, footprint: Any) -> Any:
    wavelength, slope = 0.45, 0.12
    slope = slope * retained_contrast(wavelength, footprint)
    q = mi.Point2f(0.8 * p.x - 0.6 * p.y, 0.6 * p.x + 0.8 * p.y) / wavelength
    return dr.normalize(n + slope * mi.Vector3f(value_noise(q, 96), value_noise(q, 97), 0.0))


def build_surface(
    w: WeatherTables,
    *,
    albedo: Any,
    roughness: Any,
    metallic: Any,
    kind: Any,
    snowless: Any,
    position: Any,
    normal: Any,
    relief: Any,
    footprint: Any,
) -> Surface:
    """Build the optical surface of a material at points, with water and snow on it.

    A water film darkens rough, porous materials and coats them smoothly (Ångström 1925; Lekner and
    Dorf 1988). On smooth ones, such as car paint, water only beads.

    Args:
        w: Weather on surfaces.
        albedo: Albedo of the dry material.
        roughness: Microfacet roughness, 0 to 1.
        metallic: 0 for dielectrics, 1 for bare metal.
        kind: Number of the material's `Texture`.
        snowless: Whether snow does not stay on it.
        position: Points of the world, metres.
        normal: Unit vectors.
        relief: The normal with the relief of images.
        footprint: Width of a pixel on the surface, metres.
    """
    porous = smoothstep(0.45, 0.6, roughness) * (1.0 - metallic)
    if not w.is_wet:
        s = Surface(
            albedo=albedo * (1.0 - metallic),
            alpha=dr.maximum(roughness * roughness, 0.02),
            coat=(1.0 - metallic) * (1.0 - porous),
            index=dr.lerp(VARNISH_INDEX, water.WATER_REFRACTIVE_INDEX, porous),
            metal=albedo * metallic,
            normal=relief,
            through=dr.select(kind == int(Texture.LEAVES), mi.Float(TRANSMITTED_BY_LEAVES), 0.0),
        )
    else:
        s = _wet_surface(
            w,
            albedo,
            roughness,
            metallic,
            porous,
            kind,
            snowless,
            position,
            normal,
            relief,
            footprint,
        )
    if not w.has_snow:
        return s
    snow = _snow_cover(w, kind, snowless, position, normal, footprint)
    snowy = dr.lerp(s.normal, _snow_normal(position, normal, footprint), snow)
    return Surface(
        albedo=dr.lerp(s.albedo, _snow_albedo(w, kind, position, footprint), snow),
        alpha=dr.lerp(s.alpha, 1.0, snow),
        coat=s.coat * (1.0 - snow),
        index=s.index,
        metal=s.metal * (1.0 - snow),
        normal=dr.normalize(snowy),
        through=s.through * (1.0 - snow),
    )


def _wet_surface(
    w: WeatherTables,
    albedo: Any,
    roughness: Any,
    metallic: Any,
    porous: Any,
    kind: Any,
    snowless: Any,
    position: Any,
    normal: Any,
    relief: Any,
    footprint: Any,
) -> Surface:
    filmed, still, glazed, glazed_blades = 0.15, 0.02, 0.1, 0.3
    outside = water.DIFFUSE_EXTERNAL_REFLECTANCE
    inside = water.DIFFUSE_INTERNAL_REFLECTANCE
    rained = _rainfall_fraction(w, position)
    wetness = rained * w.numbers["wetness"]
    puddle = dr.select(wetness > 0.0, _standing_water(w, kind, position, normal, footprint), 0.0)
    puddle *= rained
    facing = dr.lerp(0.5, 1.0, dr.maximum(normal.z, 0.0))
    wet = dr.lerp(wetness * porous * facing, 1.0, puddle)
    ice = dr.select(snowless, 0.0, rained * w.numbers["ice_cover"] * facing)
    wet = dr.maximum(wet, ice * porous)
    soaked = (
        INDEX_MATCHED_RATIO * (1.0 - outside) * (1.0 - inside) * albedo / (1.0 - albedo * inside)
    )
    holds_film = ~_is_one_of(kind, FILMLESS_TEXTURES)
    film = dr.maximum(
        dr.select(holds_film, smoothstep(0.3, 1.0, wet), 0.0),
        dr.select(holds_film, ice, glazed_blades * ice),
    )
    waves = w.numbers["ripple_slope"] * (1.0 - ice)
    waves = still + 1.41 * waves * (1.0 - retained_contrast(RIPPLE_WAVELENGTH_M, footprint))
    filmed_alpha = dr.lerp(filmed, glazed, ice)
    alpha = dr.lerp(dr.lerp(roughness * roughness, filmed_alpha, film), waves, puddle)
    # A film levels the relief under it.
    levelled = dr.normalize(dr.lerp(relief, normal, 0.7 * film))
    flooded = (puddle > 0.5) & (ice < 0.5)
    return Surface(
        albedo=dr.lerp(albedo, soaked, wet) * (1.0 - metallic),
        alpha=dr.maximum(alpha, 0.02),
        coat=(1.0 - metallic) * dr.lerp(1.0, film, porous),
        index=dr.lerp(VARNISH_INDEX, water.WATER_REFRACTIVE_INDEX, porous),
        metal=albedo * metallic,
        normal=dr.select(flooded, _ripple_normal(w, position, footprint), levelled),
        through=dr.select(kind == int(Texture.LEAVES), mi.Float(TRANSMITTED_BY_LEAVES), 0.0),
    )
