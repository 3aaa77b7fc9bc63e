"""The LiDAR equation, normalised, and the threshold that an echo must pass.

Powers are in units of the threshold in the dark: an echo of 1 is found half of the time.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from advercity.weather.extinction import of_visibility

Floats = NDArray[np.floating[Any]]

NEAR_FIELD_M = 10.0
"""Below this range gain control and overlap keep echoes from growing with 1/R²."""
REFERENCE_REFLECTANCE = 0.10
REFERENCE_RANGE_M = 80.0
"""Where a target of 10 % facing the sensor in clear air is detected half the time."""
REFERENCE_VISIBILITY_M = 20_000.0
SIGNAL_TO_NOISE = 5.0
"""Of an echo at the detection threshold."""
PULSE_LENGTH_M = 0.749
"""Half of what light goes in a pulse of 5 ns: echoes closer than this are one."""
RANGE_ERROR_M = 0.75
"""Of an echo as strong as the noise."""
SUNLIT_NOISE_LX = 50_000.0 / 0.3
"""Illuminance that adds as much noise power as the receiver has in the dark."""
_DARK_THRESHOLD = (
    REFERENCE_REFLECTANCE
    / math.pi
    * math.exp(-2.0 * of_visibility(REFERENCE_VISIBILITY_M) * REFERENCE_RANGE_M)
    / (REFERENCE_RANGE_M**2 + NEAR_FIELD_M**2)
)
FULL_REFLECTANCE = 1.0 / (math.pi * _DARK_THRESHOLD)
"""Power of a white target that faces the sensor in a vacuum, times the gain 1/(R² + 10²)."""


def echo(range_m: Floats, reflected: Floats, extinction_905nm: float) -> Floats:
    """Power (n,) of a hard Lambertian target, against the threshold.

    Args:
        range_m: (n,) metres.
        reflected: (n,) reflectance times cosine of incidence.
        extinction_905nm: Of the air between, 1/m.
    """
    left = np.exp(range_m * range_m.dtype.type(-2.0 * extinction_905nm))
    return left * reflected * (FULL_REFLECTANCE / (range_m * range_m + NEAR_FIELD_M**2))


def apparent_reflectance(power: Floats, range_m: Floats) -> Floats:
    """Reflectance (n,) that a target would have in clear air; what a sensor calls intensity."""
    return power * ((range_m * range_m + NEAR_FIELD_M**2) / FULL_REFLECTANCE)


def noise_factor(illuminance_lx: float) -> float:
    """How much daylight raises the receiver's noise, and with it the threshold."""
    return math.sqrt(1.0 + illuminance_lx / SUNLIT_NOISE_LX)


def detection_margin(power: Floats) -> Floats:
    """How far (n,) an echo stands above the threshold, in standard deviations of the noise."""
    return SIGNAL_TO_NOISE * (power - 1.0)


def range_deviation_m(power: Floats, least_m: float) -> Floats:
    """Standard deviation (n,) of the range of echoes: the instrument's own and that of noise."""
    return np.sqrt(least_m**2 + (RANGE_ERROR_M / (SIGNAL_TO_NOISE * power)) ** 2)
