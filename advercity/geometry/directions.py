"""Spreads directions evenly over a sphere."""

import numpy as np

from advercity.geometry.arrays import Float64Array


def spread_directions(count: int, *, min_sine: float = -1.0) -> Float64Array:
    """Spread unit vectors (count, 3) evenly over the sphere (Fibonacci lattice).

    `min_sine` is the sine of the lowest elevation.
    """
    index = np.arange(count) + 0.5
    # Steps of the golden angle never repeat an azimuth, so no two directions line up.
    azimuth = np.pi * (1.0 + np.sqrt(5.0)) * index
    height = 1.0 - (1.0 - min_sine) * index / count
    level = np.sqrt(1.0 - height**2)
    return np.column_stack([level * np.cos(azimuth), level * np.sin(azimuth), height])
