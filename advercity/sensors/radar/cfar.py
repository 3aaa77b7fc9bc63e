"""Detection at a constant rate of false alarms: noise around a cell, threshold, and chances.

The noise is estimated from cells at smaller and larger ranges, by their mean (CA-CFAR) or by an
order statistic (OS-CFAR; Rohling, IEEE Trans. Aerosp. Electron. Syst. 19, 608, 1983).
"""

from functools import cache
from statistics import NormalDist

import numpy as np
from advercity_dsl import Radar

from advercity.geometry.arrays import Float64Array, FloatArray, IndexArray

GUARD_CELLS, WINDOW_CELLS = 2, 16
"""Cells on each side: left out, and used for the estimate of the noise."""
ORDER_FRACTION = 0.75
"""Rank of the order statistic, over the number of cells."""
TEXTURE_DEVIATION = 1.0
"""Standard deviation of the logarithm of rain's local power: showers are never even."""
_NUM_LEVELS = 64


def list_window_steps() -> IndexArray:
    """List the steps (k,) in cells from a cell to the cells of its window."""
    steps = np.arange(GUARD_CELLS + 1, GUARD_CELLS + WINDOW_CELLS + 1)
    return np.concatenate([-steps, steps])


def estimate_noise(radar: Radar, window: Float64Array) -> Float64Array:
    """Estimate the mean power (n,) of noise from windows (n, k) around cells."""
    if radar.detector == "ca":
        return window.mean(axis=1)
    rank = round(ORDER_FRACTION * window.shape[1]) - 1
    return np.partition(window, rank, axis=1)[:, rank] / _mean_order_statistic(rank)


def compute_threshold(radar: Radar) -> float:
    """Compute the least power of a detection, over the estimated noise."""
    return 10.0 ** (radar.threshold_db / 10.0)


def compute_alarm_chance(threshold: float) -> float:
    """Compute the chance of noise in a cell above `threshold` times the mean of its window."""
    cells = 2 * WINDOW_CELLS
    return (1.0 + threshold / cells) ** -cells


def compute_clutter_chance(clutter: FloatArray, threshold: float) -> FloatArray:
    """Compute the chance (n,) of noise 1 and uneven clutter above `threshold` times their mean."""
    levels = [NormalDist().inv_cdf((row + 0.5) / _NUM_LEVELS) for row in range(_NUM_LEVELS)]
    texture = np.exp(TEXTURE_DEVIATION * np.array(levels) - TEXTURE_DEVIATION**2 / 2.0)
    local = (1.0 + clutter[:, None] * texture) / (1.0 + clutter[:, None])
    return np.exp(-threshold / local).mean(axis=1)


@cache
def _mean_order_statistic(rank: int) -> float:
    """Compute the mean of an order statistic of exponential numbers, by its rank from 0."""
    count = 2 * WINDOW_CELLS
    return sum(1.0 / (count - step) for step in range(rank + 1))
