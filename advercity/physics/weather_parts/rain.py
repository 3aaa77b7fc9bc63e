"""Rain: drops of Marshall and Palmer (1948)."""

import math
from collections.abc import Iterator

import numpy as np
from advercity_dsl import Weather
from advercity_dsl.weather_components import Rain

from advercity.geometry.arrays import FloatArray
from advercity.physics.microwaves import FREQUENCY_HZ, rain_attenuation_db_km, water_permittivity
from advercity.physics.weather_parts.part import (
    ParticleSizeDistribution,
    PartPhysics,
    Precipitation,
)

TERMS = (
    (2.5, "light rain"),
    (7.6, "moderate rain"),
    (50, "heavy rain"),
    (math.inf, "violent rain"),
)
"""Highest rate in mm/h for each term (American Meteorological Society)."""
MAX_DIAMETER_MM = 6.0
"""Maximum diameter; larger drops break up."""
REFLECTANCE = 0.05
BANDS_MM = (*np.arange(0.5, 3.0, 0.2), 3.3, 3.9, 4.8)
GLINT_DEVIATION = 1.0
"""Falling drops oscillate and glitter (Garg and Nayar 2006)."""


def find_drops(rain: Rain) -> Precipitation | None:
    """Find the drops of rain; the attenuation of microwaves is ITU-R's.

    Their extinction, for wavelengths from 0.4 to 1.6 um, is the sum of their cross-sections in
    closed form times the extinction efficiency, which is 2 in the geometric limit.
    """
    rate_mm_h = rain.rate_mm_h
    if rate_mm_h == 0.0:
        return None
    sizes = ParticleSizeDistribution(8000.0, 4.1 * rate_mm_h**-0.21, MAX_DIAMETER_MM)
    # The 1e-6 converts mm² of cross-section to m².
    area_per_m = rain.q_ext / 2.0 * math.pi * (sizes.intercept * 1e-6) / sizes.slope_per_mm**3
    return Precipitation(
        name="rain",
        sizes=sizes,
        extinction_per_m=area_per_m,
        compute_speed=compute_speed_m_s,
        reflectance=REFLECTANCE,
        permittivity=water_permittivity(),
        attenuation_db_km=rain_attenuation_db_km(
            rate_mm_h, FREQUENCY_HZ / 1e9, polarisation="horizontal"
        ),
        bands_mm=BANDS_MM,
        is_clear=True,
        glint_deviation=GLINT_DEVIATION,
    )


def compute_speed_m_s(diameter_mm: FloatArray | float) -> FloatArray:
    """Compute the terminal speed of raindrops (Atlas, Srivastava and Sekhon 1973), at least 0."""
    return np.maximum(9.65 - 10.3 * np.exp(-0.6 * np.asarray(diameter_mm)), 0.0)


def _list_words(rain: Rain, weather: Weather) -> Iterator[str]:
    if rain.rate_mm_h:
        term = next(name for highest, name in TERMS if rain.rate_mm_h <= highest)
        yield term.replace("rain", "freezing rain") if weather.temperature_c < 0 else term


PHYSICS = PartPhysics(
    find_drops, list_words=_list_words, list_quantities=lambda rain: {"rain_mm_h": rain.rate_mm_h}
)
