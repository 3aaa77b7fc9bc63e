"""Falling snow: flakes of Gunn and Marshall (1958), sized by their melted diameters."""

import math
from collections.abc import Iterator

import numpy as np
from advercity_dsl import Weather
from advercity_dsl.weather_components import Snow

from advercity.geometry.arrays import FloatArray
from advercity.physics.extinction import mor_from_extinction
from advercity.physics.microwaves import ICE_PERMITTIVITY, mix_permittivities, water_permittivity
from advercity.physics.weather_parts.part import (
    Deposit,
    ParticleSizeDistribution,
    PartPhysics,
    Precipitation,
)

TERMS = ((500, "heavy snow"), (1000, "moderate snow"), (math.inf, "light snow"))
"""Upper limit of visibility in metres in the snow alone for each term."""
MAX_DIAMETER_MM = 20.0
ICE_DENSITY_G_CM3 = 0.917
WET_DENSITY_G_CM3 = 0.2
"""Density at and above which flakes are wet; this and the next are assumptions."""
WET_WATER_FRACTION = 0.1
"""Melted fraction of the volume of a wet flake's ice."""
REFLECTANCE = 0.2
BANDS_MM = (0.4, 0.6, 0.8, 1.1, 1.5, 2.0, 3.0, 5.0)
SPEED_FACTORS = (0.7, 1.0, 1.3)


def find_flakes(snow: Snow) -> Precipitation | None:
    """Find the flakes of snow; their density sets their diameters.

    A flake's area grows with (1 / density)^(2/3) relative to the drop it melts to.
    """
    rate_mm_h, density_g_cm3 = snow.rate_mm_h, snow.density_g_cm3
    if rate_mm_h == 0.0:
        return None
    swelling = density_g_cm3 ** (-1.0 / 3.0)
    intercept, slope = 3.8e3 * rate_mm_h**-0.87, 2.55 * rate_mm_h**-0.48
    melted = math.pi * intercept * 1e-6 / slope**3
    return Precipitation(
        name="snow",
        sizes=ParticleSizeDistribution(intercept, slope, MAX_DIAMETER_MM / swelling, swelling),
        extinction_per_m=melted * density_g_cm3 ** (-2.0 / 3.0),
        compute_speed=_compute_equal_speed,
        speed_m_s=snow.fall_speed_m_s,
        reflectance=REFLECTANCE,
        permittivity=_compute_permittivity(swelling**-3.0),
        bands_mm=BANDS_MM,
        speed_factors=SPEED_FACTORS,
        sways=True,
    )


def _compute_equal_speed(diameter_mm: FloatArray | float) -> FloatArray:
    return np.ones_like(np.asarray(diameter_mm, float))


def _compute_permittivity(density_g_cm3: float) -> complex:
    """Compute the permittivity of flakes by their fractions of ice and water."""
    density = min(density_g_cm3, ICE_DENSITY_G_CM3)
    inclusion = ICE_PERMITTIVITY
    if density >= WET_DENSITY_G_CM3:
        inclusion = mix_permittivities(inclusion, water_permittivity(), WET_WATER_FRACTION)
    return mix_permittivities(1.0 + 0j, inclusion, density / ICE_DENSITY_G_CM3)


def _list_words(snow: Snow, weather: Weather) -> Iterator[str]:
    flakes = find_flakes(snow)
    if flakes:
        mor_m = mor_from_extinction(flakes.extinction_per_m)
        yield next(name for below, name in TERMS if mor_m < below)


def _find_deposit(snow: Snow) -> Deposit | None:
    if not (snow.depth_mm or snow.road_coverage):
        return None
    return Deposit("snow", snow.depth_mm / 1000.0, snow.road_coverage, snow.rut_coverage)


PHYSICS = PartPhysics(
    find_flakes,
    _find_deposit,
    _list_words,
    list_quantities=lambda snow: {"snow_mm_h": snow.rate_mm_h},
)
