"""Makes the device's textures of material maps."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
import sapien
from numpy.typing import NDArray

from advercity.geometry.arrays import Float64Array, Uint8Array
from advercity.material_maps import LINEAR_FROM_SRGB, MaterialMaps

Texels = NDArray[np.uint8] | NDArray[np.int8]
MAX_ROUGHNESS_RATIO = 4.0
"""Greatest ratio of a texel's roughness to the mean."""


class MapAxes(IntEnum):
    """Axes along images; shaders know them by the sign of their width."""

    WORLD = 1
    MESH = -1


@dataclass(frozen=True)
class _Textures:
    """Ratios of colour and roughness, x and y of the normal, and the width on the surface."""

    tone: sapien.render.RenderTexture2D
    greatest: tuple[float, ...]
    relief: sapien.render.RenderTexture2D | None
    tile_m: float


class MaterialTextures:
    """Textures of a world's material maps by name, made when a material first needs them.

    Args:
        maps: The maps by name.
        finest_m: Width of the finest visible detail on a surface.
    """

    def __init__(self, maps: Mapping[str, MaterialMaps], finest_m: float) -> None:
        self._maps, self._finest_m = maps, finest_m
        self._textures: dict[str, _Textures] = {}

    def apply(self, name: str, material: sapien.render.RenderMaterial, axes: MapAxes) -> None:
        """Give a material the maps of a name, if the world has them."""
        if name not in self._maps:
            return
        if name not in self._textures:
            self._textures[name] = _create_textures(self._maps[name], self._finest_m)
        found = self._textures[name]
        material.base_color_texture = found.tone
        if found.relief is not None:
            material.normal_texture = found.relief
        material.emission = [*material.emission[:3], axes * found.tile_m]
        # Parameters of gloss and glass, which our shaders have no other use for.
        material.specular, material.ior, material.transmission_roughness = found.greatest


def compute_tone_texels(maps: MaterialMaps) -> tuple[NDArray[np.uint8], tuple[float, ...]]:
    """Compute ratios of colour and roughness to their means, and the greatest of each colour.

    Returns:
        Texels (h, w, 4), in bytes of the greatest ratio, and the greatest ratios of red, green
        and blue. They are linear, so the device's means of texels are means of light.
    """
    means = maps.mean or (None, None, None)
    texels = np.empty((*maps.color.shape[:2], 4), np.uint8)
    greatest: list[float] = []
    for number, mean in enumerate(means):
        image = maps.color[..., number]
        ratio = _compute_ratios(image, LINEAR_FROM_SRGB, mean)
        greatest.append(float(ratio[image.max()]) or 1.0)
        texels[..., number] = _to_bytes(ratio / greatest[-1])[image]
    if maps.roughness is None:
        texels[..., 3] = _to_bytes(np.array(1.0 / MAX_ROUGHNESS_RATIO))
    else:
        ratio = _compute_ratios(maps.roughness, np.arange(256) / 255.0)
        texels[..., 3] = _to_bytes(ratio / MAX_ROUGHNESS_RATIO)[maps.roughness]
    return texels, tuple(greatest)


def compute_relief_texels(normal: Uint8Array) -> NDArray[np.int8]:
    """Compute x and y of normals (h, w, 2) in signed bytes.

    No unsigned byte is an even surface, and each halving for distant surfaces would tilt the mean
    further: by some hundredths, a third of a lamp's light along a road.
    """
    return np.round((normal[..., :2] / 127.5 - 1.0) * 127.0).astype(np.int8)


def _compute_ratios(
    image: Uint8Array, values: Float64Array, mean: float | None = None
) -> Float64Array:
    """Compute ratios (256,) of the values of all bytes to a mean, or to an image's (h, w)."""
    if mean is None:
        mean = float(np.bincount(image.ravel(), minlength=256) @ values / image.size)
    return values / max(mean, 1e-6)


def _to_bytes(fraction: Float64Array) -> NDArray[np.uint8]:
    return np.minimum(255.0 * fraction, 255.0).round().astype(np.uint8)


def drop_unseen_detail(texels: Texels, tile_m: float, finest_m: float) -> Texels:
    """Halve an image (h, w, channels) of a width as often as its texels stay as fine as is seen."""
    halvings = int(np.log2(max(1.0, finest_m * texels.shape[1] / tile_m)))
    for _ in range(min(halvings, min(texels.shape[:2]).bit_length() - 1)):
        height, width, channels = texels.shape
        blocks = texels.reshape(height // 2, 2, width // 2, 2, channels)
        texels = blocks.mean(axis=(1, 3), dtype=np.float32).round().astype(texels.dtype)
    return texels


def _create_textures(maps: MaterialMaps, finest_m: float) -> _Textures:
    def create(texels: Texels, texel: str) -> sapien.render.RenderTexture2D:
        kept = np.ascontiguousarray(drop_unseen_detail(texels, maps.tile_m, finest_m))
        levels = min(kept.shape[:2]).bit_length()
        return sapien.render.RenderTexture2D(kept, texel, mipmap_levels=levels)

    texels, greatest = compute_tone_texels(maps)
    return _Textures(
        tone=create(texels, "R8G8B8A8Unorm"),
        greatest=greatest,
        relief=(
            None if maps.normal is None else create(compute_relief_texels(maps.normal), "R8G8Snorm")
        ),
        tile_m=maps.tile_m,
    )
