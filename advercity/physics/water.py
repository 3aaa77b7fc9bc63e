"""Optics of water surfaces and films, and puddles as hollows of a fixed height field.

Every sensor reads the same field, so a LiDAR loses the road where a camera sees a reflection.
"""

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from advercity.geometry.arrays import FloatArray
from advercity.randomness import create_generator

WATER_REFRACTIVE_INDEX = 1.333
"""Refractive index of water in the visible."""
DIFFUSE_EXTERNAL_REFLECTANCE = 0.0664
"""Reflectance of a water surface for diffuse light from outside."""
DIFFUSE_INTERNAL_REFLECTANCE = (
    1.0 - (1.0 - DIFFUSE_EXTERNAL_REFLECTANCE) / WATER_REFRACTIVE_INDEX**2
)
"""Reflectance for diffuse light from inside, with much total reflection."""


def fresnel_reflectance(cosine: FloatArray, refractive_index: float) -> FloatArray:
    """Compute the Fresnel reflectance (n,) for unpolarised light by the cosine (n,) outside."""
    refracted_cosine = np.sqrt(1.0 - (1.0 - cosine**2) / refractive_index**2)
    inside = refractive_index * refracted_cosine
    s_polarised = (cosine - inside) / (cosine + inside)
    outside = refractive_index * cosine
    p_polarised = (outside - refracted_cosine) / (outside + refracted_cosine)
    return (s_polarised**2 + p_polarised**2) / 2.0


ICE_TEXTURE_MM = 0.5
"""Thickness of ice at which 1/e of the texture of asphalt still shows; half a usual mean texture
depth, an assumption."""


def compute_ice_cover(ice_mm: float) -> float:
    """Compute the fraction of a surface's texture filled by clear ice of a thickness.

    Its index of refraction, 1.31, is close enough to water's for all sensors to see it as a film.
    """
    return -math.expm1(-ice_mm / ICE_TEXTURE_MM)


HOLLOW_SPACING_M = 3.0
"""Distance between hollows; puddles are two to eight metres wide."""
HOLLOWS_PER_EDGE = 128
"""Hollows along an edge of the field, which then repeats."""
TEXELS_PER_HOLLOW = 4
"""Texels per hollow along an edge."""
PUDDLE_TEXEL_M = HOLLOW_SPACING_M / TEXELS_PER_HOLLOW
SHORE_ROUGHNESS = 0.25
"""Amplitude of the noise that roughens shores, relative to the hollows' heights."""


@lru_cache(maxsize=1)
def build_puddle_height_field() -> NDArray[np.float32]:
    """Build the heights (n, n), about 0 to 1, of a periodic square; rows ascend to the north.

    Texels are `PUDDLE_TEXEL_M` apart, texel (0, 0) is at the world's origin, and heights between
    texels are interpolated linearly. The array is read-only.
    """
    rng = create_generator("puddles")
    hollows = rng.random((HOLLOWS_PER_EDGE, HOLLOWS_PER_EDGE), np.float32)
    edge = HOLLOWS_PER_EDGE * TEXELS_PER_HOLLOW
    ragged = rng.random((edge, edge), np.float32)
    fraction = np.arange(TEXELS_PER_HOLLOW, dtype=np.float32) / TEXELS_PER_HOLLOW
    smooth = fraction * fraction * (3.0 - 2.0 * fraction)
    for axis in (0, 1):
        hollows = np.moveaxis(hollows, axis, -1)
        beyond = np.roll(hollows, -1, axis=-1)[..., None]
        hollows = (hollows[..., None] * (1.0 - smooth) + beyond * smooth).reshape(len(hollows), -1)
        hollows = np.moveaxis(hollows, -1, axis)
    heights = (hollows + SHORE_ROUGHNESS * (ragged - 0.5)).astype(np.float32)
    heights.flags.writeable = False
    return heights


def puddle_field_height(points: FloatArray) -> FloatArray:
    """Interpolate the height (n,) of the field at points (n, 2 or more) of the world."""
    heights = build_puddle_height_field()
    x, y = points[:, 0] / PUDDLE_TEXEL_M, points[:, 1] / PUDDLE_TEXEL_M
    column, row = np.floor(x), np.floor(y)
    right, up = x - column, y - row
    left, low = column.astype(np.int32) % len(heights), row.astype(np.int32) % len(heights)
    right_of_it, above = (left + 1) % len(heights), (low + 1) % len(heights)
    bottom = heights[low, left] * (1.0 - right) + heights[low, right_of_it] * right
    top = heights[above, left] * (1.0 - right) + heights[above, right_of_it] * right
    return bottom * (1.0 - up) + top * up


@lru_cache(maxsize=16)
def puddle_water_level(coverage: float) -> float:
    """Compute the water level that covers a fraction of the ground."""
    heights = build_puddle_height_field()
    # The quantile needs values between texels too, which linear interpolation makes less extreme.
    for axis in (0, 1):
        between = (heights + np.roll(heights, -1, axis)) / 2.0
        heights = np.concatenate([heights, between], axis)
    return float(np.quantile(heights, coverage))


def is_in_puddle(points: FloatArray, coverage: float) -> NDArray[np.bool_]:
    """Return whether each point (n, 2 or more) of the world is under water."""
    return puddle_field_height(points) < puddle_water_level(coverage)
