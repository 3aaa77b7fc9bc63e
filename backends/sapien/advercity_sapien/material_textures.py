"""Makes the device's textures of material maps."""

from collections.abc import Mapping

import numpy as np
import sapien
from numpy.typing import NDArray

from advercity.material_maps import MaterialMaps

LINEAR_FROM_SRGB = np.where(
    np.arange(256) <= 10,
    np.arange(256) / 255.0 / 12.92,
    ((np.arange(256) / 255.0 + 0.055) / 1.055) ** 2.4,
)
"""Light of each byte of an sRGB image (IEC 61966-2-1)."""


class MaterialTextures:
    """Textures of a world's material maps by name, made when a material first needs them."""

    def __init__(self, maps: Mapping[str, MaterialMaps]) -> None:
        self._maps = maps
        self._textures: dict[str, tuple[sapien.render.RenderTexture2D, ...]] = {}

    def apply(self, name: str, material: sapien.render.RenderMaterial) -> None:
        """Give a material the maps of a name, if the world has them."""
        if name not in self._maps:
            return
        maps = self._maps[name]
        if name not in self._textures:
            self._textures[name] = tuple(_create_texture(texels) for texels in build_texels(maps))
        material.base_color_texture = self._textures[name][0]
        if maps.normal is not None:
            material.normal_texture = self._textures[name][1]
        material.emission = [*material.emission[:3], maps.tile_m]


def build_texels(maps: MaterialMaps) -> list[NDArray[np.float16] | NDArray[np.uint8]]:
    """Build ratios of colour and roughness to their means (h, w, 4), and x and y of the normal.

    Ratios are linear, so that means of texels, which the device takes for distant surfaces, are
    means of light.
    """
    linear = LINEAR_FROM_SRGB[maps.color[..., :3]]
    ratios = np.ones((*linear.shape[:2], 4))
    ratios[..., :3] = linear / linear.mean(axis=(0, 1))
    if maps.roughness is not None:
        ratios[..., 3] = maps.roughness / maps.roughness.mean()
    return [
        ratios.astype(np.float16),
        *([] if maps.normal is None else [np.ascontiguousarray(maps.normal[..., :2])]),
    ]


def _create_texture(
    texels: NDArray[np.float16] | NDArray[np.uint8],
) -> sapien.render.RenderTexture2D:
    texel = "R16G16B16A16Sfloat" if texels.dtype == np.float16 else "R8G8Unorm"
    levels = min(texels.shape[:2]).bit_length()
    return sapien.render.RenderTexture2D(texels, texel, mipmap_levels=levels)
