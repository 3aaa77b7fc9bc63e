"""Where water stands on a carriageway: a fixed field of hollows, filled up to a level.

Every sensor reads the same field, so that a LiDAR loses the road where a camera sees it mirror.
"""

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from advercity.randomness import generator

Floats = NDArray[np.floating[Any]]

HOLLOW_M = 3.0
"""Distance between hollows, so that puddles are two to eight metres wide."""
HOLLOWS = 128
"""Along an edge; then the field repeats."""
FINE = 4
"""Texels to a hollow along an edge."""
TEXEL_M = HOLLOW_M / FINE
RAGGED = 0.25
"""What a texel adds to the height of its hollow at most, so that shores are not smooth."""


@lru_cache(maxsize=1)
def field() -> NDArray[np.float32]:
    """Heights (n, n), about 0 to 1, of a square that repeats; north is up the rows.

    Texels are `TEXEL_M` apart; (0, 0) is that of the world's origin. Between them it is linear.
    """
    rng = generator("puddles")
    hollows = rng.random((HOLLOWS, HOLLOWS), np.float32)
    ragged = rng.random((HOLLOWS * FINE, HOLLOWS * FINE), np.float32)
    share = np.arange(FINE, dtype=np.float32) / FINE
    share = share * share * (3.0 - 2.0 * share)
    for axis in (0, 1):
        hollows = np.moveaxis(hollows, axis, -1)
        beyond = np.roll(hollows, -1, axis=-1)[..., None]
        hollows = (hollows[..., None] * (1.0 - share) + beyond * share).reshape(len(hollows), -1)
        hollows = np.moveaxis(hollows, -1, axis)
    heights = (hollows + RAGGED * (ragged - 0.5)).astype(np.float32)
    heights.flags.writeable = False
    return heights


def height(points: Floats) -> Floats:
    """Height (n,) of the field at points (n, 2 or more) of the world."""
    heights = field()
    x, y = points[:, 0] / TEXEL_M, points[:, 1] / TEXEL_M
    column, row = np.floor(x), np.floor(y)
    right, up = x - column, y - row
    left, low = column.astype(np.int32) % len(heights), row.astype(np.int32) % len(heights)
    beside, above = (left + 1) % len(heights), (low + 1) % len(heights)
    bottom = heights[low, left] * (1.0 - right) + heights[low, beside] * right
    top = heights[above, left] * (1.0 - right) + heights[above, beside] * right
    return bottom * (1.0 - up) + top * up


@lru_cache(maxsize=16)
def level(coverage: float) -> float:
    """Water level that covers that share of the ground."""
    heights = field()
    for axis in (0, 1):
        between = (heights + np.roll(heights, -1, axis)) / 2.0
        heights = np.concatenate([heights, between], axis)
    return float(np.quantile(heights, coverage))


def covered(points: Floats, coverage: float) -> NDArray[np.bool_]:
    """Whether each point (n, 2 or more) of the world is under water."""
    return height(points) < level(coverage)
