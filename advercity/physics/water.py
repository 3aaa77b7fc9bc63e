"""What water does to light: at its surface, and as a film over something rough.

Where water stands on a carriageway: a fixed field of hollows, filled up to a level.

Every sensor reads the same field, so that a LiDAR loses the road where a camera sees it mirror.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from advercity.geometry.arrays import FloatArray
from advercity.randomness import create_generator

WATER_REFRACTIVE_INDEX = 1.333
"""Refractive index of water in the visible."""
DIFFUSE_EXTERNAL_REFLECTANCE = 0.0664
"""Share of diffuse light that a water surface reflects from outside."""
DIFFUSE_INTERNAL_REFLECTANCE = (
    1.0 - (1.0 - DIFFUSE_EXTERNAL_REFLECTANCE) / WATER_REFRACTIVE_INDEX**2
)
"""The same from inside, where much is totally reflected."""


def fresnel_reflectance(cosine: FloatArray, refractive_index: float) -> FloatArray:
    """Share (n,) of unpolarised light that a smooth surface of that refractive index reflects."""
    refracted = np.sqrt(1.0 - (1.0 - cosine**2) / refractive_index**2)
    across = (cosine - refractive_index * refracted) / (cosine + refractive_index * refracted)
    along = (refractive_index * cosine - refracted) / (refractive_index * cosine + refracted)
    return (across**2 + along**2) / 2.0


def wet_albedo(albedo: FloatArray) -> FloatArray:
    """Albedo (n,) of a Lambertian surface under a film of water, the film's own mirror left out.

    Light that the surface sends up is held back by the film and gets another chance to be lost
    (Angstrom 1925). The whole surface reflects `EXTERNAL` more.
    """
    return (
        (1.0 - DIFFUSE_EXTERNAL_REFLECTANCE)
        * (1.0 - DIFFUSE_INTERNAL_REFLECTANCE)
        * albedo
        / (1.0 - albedo * DIFFUSE_INTERNAL_REFLECTANCE)
    )


HOLLOW_SPACING_M = 3.0
"""Distance between hollows, so that puddles are two to eight metres wide."""
HOLLOWS_PER_EDGE = 128
"""Along an edge; then the field repeats."""
TEXELS_PER_HOLLOW = 4
"""Texels to a hollow along an edge."""
PUDDLE_TEXEL_M = HOLLOW_SPACING_M / TEXELS_PER_HOLLOW
SHORE_ROUGHNESS = 0.25
"""What a texel adds to the height of its hollow at most, so that shores are not smooth."""


@lru_cache(maxsize=1)
def build_puddle_height_field() -> NDArray[np.float32]:
    """Heights (n, n), about 0 to 1, of a square that repeats; north is up the rows.

    Texels are `TEXEL_M` apart; (0, 0) is that of the world's origin. Between them it is linear.
    """
    rng = create_generator("puddles")
    hollows = rng.random((HOLLOWS_PER_EDGE, HOLLOWS_PER_EDGE), np.float32)
    ragged = rng.random(
        (HOLLOWS_PER_EDGE * TEXELS_PER_HOLLOW, HOLLOWS_PER_EDGE * TEXELS_PER_HOLLOW), np.float32
    )
    share = np.arange(TEXELS_PER_HOLLOW, dtype=np.float32) / TEXELS_PER_HOLLOW
    share = share * share * (3.0 - 2.0 * share)
    for axis in (0, 1):
        hollows = np.moveaxis(hollows, axis, -1)
        beyond = np.roll(hollows, -1, axis=-1)[..., None]
        hollows = (hollows[..., None] * (1.0 - share) + beyond * share).reshape(len(hollows), -1)
        hollows = np.moveaxis(hollows, -1, axis)
    heights = (hollows + SHORE_ROUGHNESS * (ragged - 0.5)).astype(np.float32)
    heights.flags.writeable = False
    return heights


def puddle_field_height(points: FloatArray) -> FloatArray:
    """Height (n,) of the field at points (n, 2 or more) of the world."""
    heights = build_puddle_height_field()
    x, y = points[:, 0] / PUDDLE_TEXEL_M, points[:, 1] / PUDDLE_TEXEL_M
    column, row = np.floor(x), np.floor(y)
    right, up = x - column, y - row
    left, low = column.astype(np.int32) % len(heights), row.astype(np.int32) % len(heights)
    beside, above = (left + 1) % len(heights), (low + 1) % len(heights)
    bottom = heights[low, left] * (1.0 - right) + heights[low, beside] * right
    top = heights[above, left] * (1.0 - right) + heights[above, beside] * right
    return bottom * (1.0 - up) + top * up


@lru_cache(maxsize=16)
def puddle_water_level(coverage: float) -> float:
    """Water level that covers that share of the ground."""
    heights = build_puddle_height_field()
    for axis in (0, 1):
        between = (heights + np.roll(heights, -1, axis)) / 2.0
        heights = np.concatenate([heights, between], axis)
    return float(np.quantile(heights, coverage))


def is_in_puddle(points: FloatArray, coverage: float) -> NDArray[np.bool_]:
    """Whether each point (n, 2 or more) of the world is under water."""
    return puddle_field_height(points) < puddle_water_level(coverage)
