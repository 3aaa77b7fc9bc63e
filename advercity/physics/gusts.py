"""Gusts: fluctuations of the wind speed about its mean.

A sum of waves with the spectrum of Kaimal et al. (1972), `1 / (1 + 33 n)^(5/3)` of the reduced
frequency n = f z / U, and random phases. Each time can be computed on its own.
"""

import math

import numpy as np

from advercity.physics.precipitation import WIND_REFERENCE_HEIGHT_M
from advercity.randomness import create_generator

PEAK_FACTOR = 3.0
"""Strongest gust of ten minutes in standard deviations: Davenport's expected maximum of a process
rising above its mean every ten seconds."""
WAVES = 32
LONGEST_S, SHORTEST_S = 600.0, 1.0
"""Periods of the waves."""


class Gusts:
    """Wind speed relative to its mean, for a mean speed and a gust factor; `key` is random."""

    def __init__(self, mean_m_s: float, *key: int | str) -> None:
        rng = create_generator(*key, "gusts")
        ratio = LONGEST_S / SHORTEST_S
        # One wave in each of equal steps of the logarithm, to avoid early repetition.
        steps = (np.arange(WAVES) + rng.random(WAVES)) / WAVES
        self._frequency_hz = ratio**steps / LONGEST_S
        self._phase = rng.random(WAVES) * 2.0 * math.pi
        reduced = self._frequency_hz * WIND_REFERENCE_HEIGHT_M / max(mean_m_s, 1.0)
        power = self._frequency_hz * (1.0 + 33.0 * reduced) ** (-5.0 / 3.0)
        self._amplitude = np.sqrt(2.0 * power / power.sum())

    def compute_speed_ratio(self, gust_factor: float, time_s: float) -> float:
        """Compute the speed at a time relative to its mean, at least 0."""
        waves = self._amplitude * np.cos(2.0 * math.pi * self._frequency_hz * time_s + self._phase)
        return max(0.0, 1.0 + (gust_factor - 1.0) / PEAK_FACTOR * float(waves.sum()))
