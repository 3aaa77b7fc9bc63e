"""Painted surfaces: colour, height and roughness, and the images made of them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from advercity.assets.maps.tile import Tile
from advercity.geometry.arrays import FloatArray, Uint8Array
from advercity.material_maps import MaterialMaps
from advercity.materials import Material

Rgb = tuple[float, float, float]
_LINEAR = np.linspace(0.0, 1.0, 2**16)
_SRGB = np.round(
    255 * np.where(_LINEAR <= 0.0031308, 12.92 * _LINEAR, 1.055 * _LINEAR ** (1 / 2.4) - 0.055)
).astype(np.uint8)
"""sRGB (IEC 61966-2-1) of linear values in 16 bits: one rounding, on every processor."""
_BYTES = np.arange(256) / 255
_LINEAR_FROM_SRGB = np.where(
    _BYTES <= 0.04045, _BYTES / 12.92, ((_BYTES + 0.055) / 1.055) ** 2.4
).astype(np.float32)


MEAN_TOLERANCE = 1e-4
"""Relative error of mean colours and roughnesses before they are rounded to bytes."""


@dataclass(frozen=True, eq=False)
class Surface:
    """A painted tile.

    Attributes:
        colour: (3, n, n) linear sRGB, in any scale.
        height_m: (n, n) height above any level.
        roughness: (n, n), in any scale.
    """

    colour: FloatArray
    height_m: FloatArray
    roughness: FloatArray


def mix(below: FloatArray | Rgb, above: FloatArray | Rgb, fraction: FloatArray) -> FloatArray:
    """Lay a colour over another one; colours are (3,) or (3, n, n), the fraction is (n, n)."""
    low, high = (np.asarray(colour, np.float32) for colour in (below, above))
    low, high = (colour[:, None, None] if colour.ndim == 1 else colour for colour in (low, high))
    return low + (high - low) * fraction


def encode_surface(surface: Surface, tile: Tile, material: Material) -> MaterialMaps:
    """Encode a surface with the mean colour and roughness of a material."""
    roughness = _scale_to_mean(surface.roughness, material.roughness)
    return MaterialMaps(
        color=_encode_colour(surface.colour, material),
        normal=_encode_normals(surface.height_m, tile.pixel_m),
        roughness=_round(roughness, 255).astype(np.uint8),
        tile_m=tile.size_m,
    )


def encode_photographs(
    color: Uint8Array,
    normal: Uint8Array | None,
    roughness: Uint8Array | None,
    material: Material,
    tile_m: float,
) -> MaterialMaps:
    """Bring photographs of a surface to the mean colour and roughness of a material.

    Args:
        color: (h, w, 3) or (h, w, 4) sRGB; the mean is over the opaque part.
        normal: (h, w, 3) as of `MaterialMaps`.
        roughness: (h, w).
        material: The material.
        tile_m: Width of the images on the surface.
    """
    opacity = color[..., 3:]
    weight = opacity[..., 0] / np.float32(255) if opacity.size else None
    linear = np.moveaxis(_LINEAR_FROM_SRGB[color[..., :3]], -1, 0)
    gloss = None
    if roughness is not None:
        scaled = _scale_to_mean(roughness.astype(np.float32), material.roughness)
        gloss = _round(scaled, 255).astype(np.uint8)
    return MaterialMaps(
        color=np.concatenate([_encode_colour(linear, material, weight), opacity], axis=-1),
        normal=normal,
        roughness=gloss,
        tile_m=tile_m,
    )


def _encode_colour(
    colour: FloatArray, material: Material, weight: FloatArray | None = None
) -> Uint8Array:
    """Encode linear colour (3, h, w) with the mean albedo of a material as sRGB (h, w, 3)."""
    channels = (
        _scale_to_mean(channel, mean, weight)
        for channel, mean in zip(colour, material.albedo, strict=True)
    )
    return np.stack([_SRGB[_round(channel, 65535)] for channel in channels], axis=-1)


def _scale_to_mean(values: FloatArray, mean: float, weight: FloatArray | None = None) -> FloatArray:
    """Scale values to a mean; values above 1 are cut, and the rest makes up for it."""
    for _ in range(30):  # a few unless most of the surface is cut
        ratio = mean / np.average(values.astype(float), weights=weight)
        if abs(ratio - 1) < MEAN_TOLERANCE:
            break
        values = np.clip(values * np.float32(ratio), 0, 1)
    return values


def _encode_normals(height_m: FloatArray, pixel_m: float) -> Uint8Array:
    """Compute the normals (n, n, 3) of a relief: x to the right, y up, 0 to 255 for -1 to 1."""
    slope_x = (np.roll(height_m, -1, 1) - np.roll(height_m, 1, 1)) / np.float32(2 * pixel_m)
    slope_y = (np.roll(height_m, 1, 0) - np.roll(height_m, -1, 0)) / np.float32(2 * pixel_m)
    length = np.sqrt(slope_x * slope_x + slope_y * slope_y + 1)
    parts = (-slope_x / length, -slope_y / length, 1 / length)
    return np.stack([_round(0.5 * part + 0.5, 255).astype(np.uint8) for part in parts], axis=-1)


def _round(values: FloatArray, highest: int) -> NDArray[np.uint16]:
    """Scale values in [0, 1] to whole numbers up to `highest`."""
    return (values * np.float32(highest) + np.float32(0.5)).astype(np.uint16)
