"""Sizes, numbers and velocities of falling drops and flakes.

Diameters are in millimetres. Snow is sized by its melted diameter, as in the literature.
"""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from advercity_dsl import Weather
from advercity_dsl.weather_components import Wind
from numpy.typing import NDArray

from advercity.geometry.arrays import FloatArray

MAX_DROP_DIAMETER_MM = 6.0
"""Larger drops break up."""
MAX_FLAKE_DIAMETER_MM = 20.0
HAIL_INTERCEPT, HAIL_INTERCEPT_EXPONENT = 115.0, 3.63
"""Number of hailstones per m³ and mm at diameter 0 and a slope of 1/mm, and its growth with it."""
HAIL_EXPONENT = 0.8
HAIL_SPEED_M_S = 9.0 * 10.0**-HAIL_EXPONENT
"""Terminal speed of a stone of 1 mm, and its growth with the diameter."""
HAIL_FLUX = 3.6e-3 * math.pi / 6.0 * 0.9
"""Rate of melted water in mm/h by one stone of 1 mm per m³ that falls at 1 m/s."""
ROUGHNESS_LENGTH_M = 0.5
"""Roughness length of the logarithmic wind profile, between those of fields and of towns."""
WIND_REFERENCE_HEIGHT_M = 10.0
"""Height of the authored wind."""
CAMERA_HEIGHT_M = 2.5
"""Height of cameras, at which the wind is taken that moves drops and flakes."""


@dataclass(frozen=True)
class ParticleSizeDistribution:
    """Exponential distribution: `intercept` exp(-`slope_per_mm` D), D the melted diameter.

    Attributes:
        kind: Rain, snow or hail.
        intercept: Particles per m³ and mm at D = 0.
        slope_per_mm: Decay of the number with D.
        air_to_melted_diameter: Diameter in the air relative to the melted diameter.
        max_melted_mm: Largest melted diameter.
    """

    kind: Literal["rain", "snow", "hail"]
    intercept: float
    slope_per_mm: float
    air_to_melted_diameter: float
    max_melted_mm: float

    def number_concentration_above(self, diameter_mm: FloatArray | float) -> FloatArray:
        """Compute the number per m³ (n,) of particles above a melted diameter."""
        least = np.minimum(diameter_mm, self.max_melted_mm)
        beyond = math.exp(-self.slope_per_mm * self.max_melted_mm)
        tail = np.exp(-self.slope_per_mm * least) - beyond
        return self.intercept / self.slope_per_mm * tail

    def sample_diameters_mm(
        self, min_mm: FloatArray, uniform: FloatArray, max_mm: FloatArray | float
    ) -> FloatArray:
        """Convert numbers (n,) in [0, 1) to melted diameters (n,) between two bounds."""
        span = 1.0 - np.exp(-self.slope_per_mm * np.maximum(max_mm - min_mm, 0.0))
        return min_mm - np.log1p(-uniform * span) / self.slope_per_mm


def rain_size_distribution(rate_mm_h: float) -> ParticleSizeDistribution:
    """Compute the sizes of raindrops (Marshall and Palmer 1948)."""
    return ParticleSizeDistribution(
        "rain", 8000.0, 4.1 * rate_mm_h**-0.21, 1.0, MAX_DROP_DIAMETER_MM
    )


def snow_size_distribution(rate_mm_h: float, density_g_cm3: float) -> ParticleSizeDistribution:
    """Compute the sizes of flakes (Gunn and Marshall 1958); their density sets their diameters."""
    swelling = density_g_cm3 ** (-1.0 / 3.0)
    intercept, slope = 3.8e3 * rate_mm_h**-0.87, 2.55 * rate_mm_h**-0.48
    largest_mm = MAX_FLAKE_DIAMETER_MM / swelling
    return ParticleSizeDistribution("snow", intercept, slope, swelling, largest_mm)


def hail_size_distribution(rate_mm_h: float, largest_mm: float) -> ParticleSizeDistribution:
    """Compute the sizes of hailstones (Cheng and English 1983), as diameters in the air.

    The number is 115 L^3.63 exp(-L D), whose slope L follows from the rate: the flux of volume of
    stones of density 0.9, with their terminal speeds, in closed form.
    """
    rate_at_slope_1 = HAIL_FLUX * HAIL_INTERCEPT * HAIL_SPEED_M_S * math.gamma(4.0 + HAIL_EXPONENT)
    power = 4.0 + HAIL_EXPONENT - HAIL_INTERCEPT_EXPONENT
    slope = (rate_at_slope_1 / rate_mm_h) ** (1.0 / power)
    intercept = HAIL_INTERCEPT * slope**HAIL_INTERCEPT_EXPONENT
    return ParticleSizeDistribution("hail", intercept, slope, 1.0, largest_mm)


def hail_terminal_speed_m_s(diameter_mm: FloatArray | float) -> FloatArray:
    """Compute the terminal speed of hailstones, 9 m/s for one of 10 mm (Pruppacher and Klett)."""
    return HAIL_SPEED_M_S * np.asarray(diameter_mm) ** HAIL_EXPONENT


def is_precipitating(weather: Weather) -> bool:
    """Return whether anything falls from the clouds."""
    return max(weather.rain.rate_mm_h, weather.snow.rate_mm_h, weather.hail.rate_mm_h) > 0.0


def size_distributions(weather: Weather) -> tuple[ParticleSizeDistribution, ...]:
    """Compute the size distributions of all that falls, without what is absent."""
    rain, snow, hail = weather.rain, weather.snow, weather.hail
    falling = [rain_size_distribution(rain.rate_mm_h)] if rain.rate_mm_h else []
    falling += (
        [snow_size_distribution(snow.rate_mm_h, snow.density_g_cm3)] if snow.rate_mm_h else []
    )
    falling += [hail_size_distribution(hail.rate_mm_h, hail.largest_mm)] if hail.rate_mm_h else []
    return tuple(falling)


def drop_terminal_speed_m_s(diameter_mm: FloatArray | float) -> FloatArray:
    """Compute the terminal speed of raindrops (Atlas, Srivastava and Sekhon 1973), at least 0."""
    return np.maximum(9.65 - 10.3 * np.exp(-0.6 * np.asarray(diameter_mm)), 0.0)


def wind_at_height(wind: Wind, height_m: float) -> NDArray[np.float64]:
    """Compute the velocity (3,) of the air in m/s at a height, by the logarithmic profile."""
    reference = math.log(WIND_REFERENCE_HEIGHT_M / ROUGHNESS_LENGTH_M)
    grown = math.log(height_m / ROUGHNESS_LENGTH_M) / reference
    speed, azimuth = wind.speed_m_s * grown, math.radians(wind.from_deg)
    return np.array([-speed * math.sin(azimuth), -speed * math.cos(azimuth), 0.0])
