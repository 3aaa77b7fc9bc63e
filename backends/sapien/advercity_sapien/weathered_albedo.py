"""Mean albedo of surfaces after rain and snow, for light reflected onto others.

The shaders' value of each point (`ground.glsl`), averaged over patches, ruts and puddles. Light
mirrored by a film of water counts as diffuse.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from advercity.geometry.arrays import Float64Array, FloatArray
from advercity.materials import MATERIALS, Texture
from advercity.physics import water
from advercity.rendering.raycaster import MATERIAL_NAMES
from advercity.rendering.surface_weather import (
    CLEAN_SNOW,
    DIRTY_SNOW,
    INDEX_MATCHED_RATIO,
    RUT_FRACTION,
    SNOW_DEPTH_M,
    SNOW_DEPTH_ON_ROAD_M,
    SurfaceWeather,
)

_MATERIALS = [MATERIALS[name] for name in MATERIAL_NAMES]
_DRY = np.array([one.albedo for one in _MATERIALS])
_ROUGHNESS = np.array([one.roughness for one in _MATERIALS])
_METALLIC = np.array([one.metallic for one in _MATERIALS])
_IS_ROAD = np.isin([one.texture for one in _MATERIALS], (Texture.ASPHALT, Texture.MARKING))
_FILMLESS = (
    *(Texture.GRASS, Texture.SOIL, Texture.CROPS),
    *(Texture.BARK, Texture.LEAVES, Texture.CROWN),
)
_HOLDS_FILM = ~np.isin([one.texture for one in _MATERIALS], _FILMLESS)


@dataclass(frozen=True)
class WeatheredAlbedo:
    """Albedo under a weather."""

    weather: SurfaceWeather

    def look_up(self, material: NDArray[np.int16], upward: FloatArray) -> Float64Array:
        """Look up the albedo (n, 3) of materials (n,), into `MATERIAL_NAMES`.

        `upward` is the vertical component (n,) of normals.
        """
        wet = self._wet(material, upward)
        cover = self._cover_by_snow(material, upward)[:, None]
        ruts = np.where(_IS_ROAD[material], RUT_FRACTION, 0.0)[:, None]
        snow = CLEAN_SNOW + ruts * np.subtract(DIRTY_SNOW, CLEAN_SNOW)
        return wet + cover * (snow - wet)

    def _wet(self, material: NDArray[np.int16], upward: FloatArray) -> Float64Array:
        dry, weather = _DRY[material], self.weather
        if weather.wetness <= 0.0 and weather.ice_cover <= 0.0:
            return dry
        porous = _smoothstep(0.45, 0.6, _ROUGHNESS[material]) * (1.0 - _METALLIC[material])
        facing = 0.5 + 0.5 * np.maximum(upward, 0.0)
        wet = max(weather.wetness, weather.ice_cover) * porous * facing
        outside, inside = water.DIFFUSE_EXTERNAL_REFLECTANCE, water.DIFFUSE_INTERNAL_REFLECTANCE
        soaked = INDEX_MATCHED_RATIO * (1.0 - outside) * (1.0 - inside) * dry / (1.0 - dry * inside)
        mirrored = outside * porous * _HOLDS_FILM[material] * _smoothstep(0.3, 1.0, wet)
        return dry + wet[:, None] * (soaked - dry) + mirrored[:, None]

    def _cover_by_snow(self, material: NDArray[np.int16], upward: FloatArray) -> Float64Array:
        weather, is_road = self.weather, _IS_ROAD[material]
        covering_m = np.where(is_road, SNOW_DEPTH_ON_ROAD_M, SNOW_DEPTH_M)
        level = np.clip((upward - 0.35) / 0.4, 0.0, 1.0)
        between, in_ruts = weather.snow_between_ruts, weather.snow_in_ruts
        left = np.where(is_road, between + RUT_FRACTION * (in_ruts - between), 1.0)
        return level * left * (1.0 - np.exp(-weather.snow_depth_m / covering_m))


def _smoothstep(low: float, high: float, value: FloatArray) -> Float64Array:
    t = np.clip((np.asarray(value, np.float64) - low) / (high - low), 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)
