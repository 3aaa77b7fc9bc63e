"""Makes the device's textures of material maps."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from functools import partial

import numpy as np
import sapien
from numpy.typing import NDArray

from advercity.geometry.arrays import Float64Array, Uint8Array
from advercity.material_maps import LINEAR_FROM_SRGB, MaterialMaps


class MapAxes(IntEnum):
    """Along which axes images lie; shaders know it by the sign of their width."""

    WORLD = 1
    MESH = -1


@dataclass(frozen=True)
class _Textures:
    """Ratios of colour and roughness, x and y of the normal, and the width on the surface."""

    tone: sapien.render.RenderTexture2D
    relief: sapien.render.RenderTexture2D | None
    tile_m: float


class MaterialTextures:
    """Textures of a world's material maps by name, made when a material first needs them."""

    def __init__(self, maps: Mapping[str, MaterialMaps]) -> None:
        self._maps = maps
        self._textures: dict[str, _Textures] = {}

    def apply(self, name: str, material: sapien.render.RenderMaterial, axes: MapAxes) -> None:
        """Give a material the maps of a name, if the world has them."""
        if name not in self._maps:
            return
        if name not in self._textures:
            self._textures[name] = _create_textures(self._maps[name])
        found = self._textures[name]
        material.base_color_texture = found.tone
        if found.relief is not None:
            material.normal_texture = found.relief
        material.emission = [*material.emission[:3], axes * found.tile_m]


def compute_tone_texels(maps: MaterialMaps) -> NDArray[np.float16]:
    """Compute ratios (h, w, 4) of the colour and the roughness to their means.

    Ratios are linear, so that means of texels, which the device takes for distant surfaces, are
    means of light.
    """
    means = maps.mean or (None, None, None)
    channels = [
        _compute_ratios(maps.color[..., n], LINEAR_FROM_SRGB, mean) for n, mean in enumerate(means)
    ]
    roughness = np.ones_like(channels[0])
    if maps.roughness is not None:
        roughness = _compute_ratios(maps.roughness, np.arange(256) / 255.0)
    return np.stack([*channels, roughness], axis=-1)


def _compute_ratios(
    image: Uint8Array, values: Float64Array, mean: float | None = None
) -> NDArray[np.float16]:
    """Compute ratios (h, w) of the values of the bytes of an image (h, w) to a mean, or theirs."""
    if mean is None:
        mean = float(np.bincount(image.ravel(), minlength=256) @ values / image.size)
    return (values / max(mean, 1e-6)).astype(np.float16)[image]


def _create_textures(maps: MaterialMaps) -> _Textures:
    levels = min(maps.color.shape[:2]).bit_length()
    create = partial(sapien.render.RenderTexture2D, mipmap_levels=levels)
    relief = None if maps.normal is None else np.ascontiguousarray(maps.normal[..., :2])
    return _Textures(
        tone=create(compute_tone_texels(maps), "R16G16B16A16Sfloat"),
        relief=None if relief is None else create(relief, "R8G8Unorm"),
        tile_m=maps.tile_m,
    )
