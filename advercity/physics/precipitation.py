"""What falls: how large, how many, how fast.

Diameters are in millimetres. Snow is sized by its melted diameter; `swelling` makes it a flake's.
"""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from advercity_dsl import Weather
from advercity_dsl.weather import Wind
from numpy.typing import NDArray

from advercity.geometry.arrays import FloatArray

MAX_DROP_DIAMETER_MM = 6.0
"""Drops that are larger break up."""
MAX_FLAKE_DIAMETER_MM = 20.0
ROUGHNESS_LENGTH_M = 0.5
"""Of town and fields, for the wind."""
WIND_REFERENCE_HEIGHT_M = 10.0
"""At which wind is authored."""


@dataclass(frozen=True)
class ParticleSizeDistribution:
    """Exponential: `intercept` exp(-`slope_per_mm` D) particles per m³ and mm of melted D."""

    kind: Literal["rain", "snow"]
    intercept: float
    slope_per_mm: float
    air_to_melted_diameter: float
    """Diameter in the air against melted."""
    max_melted_mm: float
    """By melted diameter."""

    def number_concentration_above(self, diameter_mm: FloatArray | float) -> FloatArray:
        """Particles per m³ (n,) that are larger, by melted diameter."""
        least = np.minimum(diameter_mm, self.max_melted_mm)
        tail = np.exp(-self.slope_per_mm * least) - math.exp(
            -self.slope_per_mm * self.max_melted_mm
        )
        return self.intercept / self.slope_per_mm * tail

    def sample_diameters_mm(
        self, min_mm: FloatArray, uniform: FloatArray, max_mm: FloatArray | float
    ) -> FloatArray:
        """Melted diameters (n,) between two bounds, drawn by numbers (n,) in [0, 1)."""
        span = 1.0 - np.exp(-self.slope_per_mm * np.maximum(max_mm - min_mm, 0.0))
        return min_mm - np.log1p(-uniform * span) / self.slope_per_mm


def rain_size_distribution(rate_mm_h: float) -> ParticleSizeDistribution:
    """Drops by Marshall and Palmer (1948)."""
    return ParticleSizeDistribution(
        "rain", 8000.0, 4.1 * rate_mm_h**-0.21, 1.0, MAX_DROP_DIAMETER_MM
    )


def snow_size_distribution(rate_mm_h: float, density_g_cm3: float) -> ParticleSizeDistribution:
    """Flakes by Gunn and Marshall (1958), as wide as their density makes them."""
    swelling = density_g_cm3 ** (-1.0 / 3.0)
    return ParticleSizeDistribution(
        "snow",
        3.8e3 * rate_mm_h**-0.87,
        2.55 * rate_mm_h**-0.48,
        swelling,
        MAX_FLAKE_DIAMETER_MM / swelling,
    )


def size_distributions(weather: Weather) -> tuple[ParticleSizeDistribution, ...]:
    """Of all that falls in `weather`."""
    rain, snow = weather.rain, weather.snow
    falling = [rain_size_distribution(rain.rate_mm_h)] if rain.rate_mm_h else []
    falling += (
        [snow_size_distribution(snow.rate_mm_h, snow.density_g_cm3)] if snow.rate_mm_h else []
    )
    return tuple(falling)


def drop_terminal_speed_m_s(diameter_mm: FloatArray | float) -> FloatArray:
    """Terminal speed of rain (Atlas, Srivastava and Sekhon 1973); mist stands still."""
    return np.maximum(9.65 - 10.3 * np.exp(-0.6 * np.asarray(diameter_mm)), 0.0)


def wind_at_height(wind: Wind, height_m: float) -> NDArray[np.float64]:
    """Velocity (3,) of the air in m/s at a height: the logarithmic profile over town."""
    grown = math.log(height_m / ROUGHNESS_LENGTH_M) / math.log(
        WIND_REFERENCE_HEIGHT_M / ROUGHNESS_LENGTH_M
    )
    speed, azimuth = wind.speed_m_s * grown, math.radians(wind.from_deg)
    return np.array([-speed * math.sin(azimuth), -speed * math.cos(azimuth), 0.0])


def snow_accumulation_mm(
    rate_mm_h: float, hours: float, density_kg_m3: float, normal_z: float
) -> float:
    """Depth of snow in mm on a surface by how far it faces up: 1 level, 0 upright, -1 below.

    Args:
        rate_mm_h: Liquid equivalent of what falls on level ground.
        hours: For which it falls, without wind.
        density_kg_m3: Of the snow that lies.
        normal_z: Upward part of the surface's normal.
    """
    return rate_mm_h * hours * 1000.0 / density_kg_m3 * max(0.0, normal_z)
