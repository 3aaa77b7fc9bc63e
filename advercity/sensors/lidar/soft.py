"""Echoes of air that is thick with droplets or grains: fog, dust.

Light scattered all along the beam adds up to one broad echo near the sensor (Rasshofer, Spies and
Spies 2011). Tabulated once per weather; a beam costs a few look-ups.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from advercity.sensors.lidar.power import PULSE_LENGTH_M, echo

Array = NDArray[np.float64]
Floats = NDArray[np.floating[Any]]

LIDAR_RATIO_SR = {"fog": 18.8, "dust": 50.0, "spray": 20.0}
"""Extinction over backscatter: O'Connor et al., JTECH 21, 777 (2004) for droplets."""
NEAREST_M = 0.5
FLUCTUATION = 0.3
"""Standard deviation of the logarithm of an echo: droplets are never evenly spread."""
REACH_M = 60.0
STEP_M = 0.02
CUTS = 256
QUANTILES = 1 << 16
NEAR_PEAK = 0.95
"""Of the peak: an echo that only noise lifts over the threshold comes from there."""


@dataclass(frozen=True, eq=False)
class SoftTarget:
    """Fog, dust or both at once, as tables over range.

    Attributes:
        profile: (m,) power by apparent range, `NEAREST_M` + i `STEP_M`, against the threshold.
        dust_share: Share of the echo that dust sends.
    """

    profile: Floats
    dust_share: float
    _mass: Floats
    """Integral of the profile (m,) from the nearest range, from 0 to 1."""
    _range_of_mass: Floats
    """Its inverse at even steps."""
    _mass_from: Floats
    """Mass (CUTS + 1,) below the range where the profile rises through each share of its peak."""
    _mass_to: Floats
    """The same for where it falls through it."""

    @staticmethod
    def of(*, fog: float, dust: float, extinction: float) -> "SoftTarget":
        """The target of fog and dust of these extinctions, in air of `extinction` in all, 1/m."""
        by_fog, by_dust = fog / LIDAR_RATIO_SR["fog"], dust / LIDAR_RATIO_SR["dust"]
        range_m = np.arange(NEAREST_M, REACH_M, STEP_M)
        profile = pulse_profile(range_m, by_fog + by_dust, extinction)
        mass = np.cumsum(profile) - profile[0]
        mass /= mass[-1]
        levels = profile.max() * np.arange(CUTS + 1) / CUTS
        peak = int(profile.argmax())
        rise = np.searchsorted(profile[: peak + 1], levels).clip(0, peak)
        fall = len(profile) - 1 - np.searchsorted(profile[:peak:-1], levels)
        steps = np.linspace(0.0, 1.0, QUANTILES)
        return SoftTarget(
            profile=profile.astype(np.float32),
            dust_share=by_dust / (by_fog + by_dust),
            _mass=mass.astype(np.float32),
            _range_of_mass=np.interp(steps, mass, range_m).astype(np.float32),
            _mass_from=mass[rise].astype(np.float32),
            _mass_to=mass[fall].astype(np.float32),
        )

    @property
    def peak(self) -> float:
        """Power of the strongest echo."""
        return float(self.profile.max())

    def draw(self, gain: Floats, end_m: Floats, uniform: Floats) -> tuple[Floats, Floats]:
        """Range and power (n,) of the echo of every beam; where there is no room, power is 0.

        An echo comes from where the profile is above the threshold, more often from where it is
        high; its power is that of the peak, which fluctuates.

        Args:
            gain: (n,) factor on the profile, fluctuation included.
            end_m: (n,) where each beam is stopped; inf if nowhere.
            uniform: (n,) random numbers from 0 to 1.
        """
        power = gain * np.float32(self.peak)
        with np.errstate(divide="ignore"):
            cut = np.minimum(np.float32(1.0) / power, np.float32(NEAR_PEAK))
        level = (cut * CUTS).astype(np.int32)
        first, last = self._mass_from.take(level), self._mass_to.take(level)
        room = np.minimum(end_m, REACH_M) - np.float32(PULSE_LENGTH_M + NEAREST_M)
        cell = (np.maximum(room, 0.0) * (1.0 / STEP_M)).astype(np.int32)
        last = np.minimum(last, self._mass.take(cell, mode="clip"))
        width = np.maximum(last - first, 0.0)
        at = (first + uniform * width) * np.float32(QUANTILES - 1)
        power *= width > 0.0
        return self._range_of_mass.take((at + np.float32(0.5)).astype(np.int32)), power


def pulse_profile(range_m: Array, backscatter: float, extinction: float) -> Array:
    """Power (n,) against the threshold of a layer without end, by apparent range.

    A pulse of the shape sine squared, that stretches over twice `PULSE_LENGTH_M`, gathers light
    from all that it covers; the delay of its own middle is taken off.

    Args:
        range_m: (n,) metres.
        backscatter: 1/(m sr).
        extinction: 1/m.
    """
    step = PULSE_LENGTH_M / 32.0
    along = (np.arange(64) + 0.5) * step
    shape = np.sin(np.pi * along / (2.0 * PULSE_LENGTH_M)) ** 2 * step
    reached = range_m[:, None] + PULSE_LENGTH_M - along
    layer = echo(np.maximum(reached, 0.0), np.full_like(reached, math.pi * backscatter), extinction)
    return np.where(reached > 0.0, layer, 0.0) @ shape
