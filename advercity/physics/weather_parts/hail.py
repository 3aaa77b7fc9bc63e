"""Falling hail: stones of Cheng and English (1983), sized by their diameters in the air."""

import math
from collections.abc import Iterator

import numpy as np
from advercity_dsl import Weather
from advercity_dsl.weather_components import Hail

from advercity.geometry.arrays import FloatArray
from advercity.physics.microwaves import ICE_PERMITTIVITY
from advercity.physics.weather_parts.part import (
    ParticleSizeDistribution,
    PartPhysics,
    Precipitation,
)

INTERCEPT, INTERCEPT_EXPONENT = 115.0, 3.63
"""Number of stones per m³ and mm at diameter 0 and a slope of 1/mm, and its growth with it."""
SPEED_EXPONENT = 0.8
SPEED_M_S = 9.0 * 10.0**-SPEED_EXPONENT
"""Terminal speed of a stone of 1 mm, and its growth with the diameter."""
FLUX = 3.6e-3 * math.pi / 6.0 * 0.9
"""Rate of melted water in mm/h by one stone of 1 mm per m³ falling at 1 m/s."""
REFLECTANCE = 0.3
"""An assumption between a flake and old snow: a stone's ice is milky."""

BANDS_MM = (2.0, 3.0, 4.5, 6.5, 9.0, 12.0, 16.0, 22.0, 32.0)


def find_stones(hail: Hail) -> Precipitation | None:
    """Find the stones of hail, which extinguish light as in the geometric limit.

    Their number is 115 L^3.63 exp(-L D), whose slope L follows from the rate: the flux of volume of
    stones of density 0.9, with their terminal speeds, in closed form.
    """
    if hail.rate_mm_h == 0.0:
        return None
    rate_at_slope_1 = FLUX * INTERCEPT * SPEED_M_S * math.gamma(4.0 + SPEED_EXPONENT)
    power = 4.0 + SPEED_EXPONENT - INTERCEPT_EXPONENT
    slope = (rate_at_slope_1 / hail.rate_mm_h) ** (1.0 / power)
    intercept = INTERCEPT * slope**INTERCEPT_EXPONENT
    return Precipitation(
        name="hail",
        sizes=ParticleSizeDistribution(intercept, slope, hail.largest_mm),
        extinction_per_m=math.pi * (intercept * 1e-6) / slope**3,
        compute_speed=compute_speed_m_s,
        reflectance=REFLECTANCE,
        permittivity=ICE_PERMITTIVITY,
        bands_mm=BANDS_MM,
    )


def compute_speed_m_s(diameter_mm: FloatArray | float) -> FloatArray:
    """Compute the terminal speed of hailstones, 9 m/s for one of 10 mm (Pruppacher and Klett)."""
    return SPEED_M_S * np.asarray(diameter_mm) ** SPEED_EXPONENT


def _list_words(hail: Hail, weather: Weather) -> Iterator[str]:
    if hail.rate_mm_h:
        yield f"hail of up to {hail.largest_mm:g} mm"


PHYSICS = PartPhysics(
    find_stones, list_words=_list_words, list_quantities=lambda hail: {"hail_mm_h": hail.rate_mm_h}
)
