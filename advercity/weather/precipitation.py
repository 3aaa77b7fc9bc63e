"""What falls: how large, how many, how fast.

Diameters are in millimetres. Snow is sized by its melted diameter; `swelling` makes it a flake's.
"""

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from advercity_dsl import Weather
from advercity_dsl.weather import Wind
from numpy.typing import NDArray

Floats = NDArray[np.floating[Any]]

LARGEST_DROP_MM = 6.0
"""Drops that are larger break up."""
LARGEST_FLAKE_MM = 20.0
ROUGHNESS_M = 0.5
"""Of town and fields, for the wind."""
REFERENCE_HEIGHT_M = 10.0
"""At which wind is authored."""


@dataclass(frozen=True)
class SizeDistribution:
    """Exponential: `intercept` exp(-`slope_per_mm` D) particles per m³ and mm of melted D."""

    kind: Literal["rain", "snow"]
    intercept: float
    slope_per_mm: float
    swelling: float
    """Diameter in the air against melted."""
    largest_mm: float
    """By melted diameter."""

    def number_above(self, diameter_mm: Floats | float) -> Floats:
        """Particles per m³ (n,) that are larger, by melted diameter."""
        least = np.minimum(diameter_mm, self.largest_mm)
        tail = np.exp(-self.slope_per_mm * least) - math.exp(-self.slope_per_mm * self.largest_mm)
        return self.intercept / self.slope_per_mm * tail

    def larger(self, least_mm: Floats, uniform: Floats, most_mm: Floats | float) -> Floats:
        """Melted diameters (n,) between two bounds, drawn by numbers (n,) in [0, 1)."""
        span = 1.0 - np.exp(-self.slope_per_mm * np.maximum(most_mm - least_mm, 0.0))
        return least_mm - np.log1p(-uniform * span) / self.slope_per_mm


def sizes_of_rain(rate_mm_h: float) -> SizeDistribution:
    """Drops by Marshall and Palmer (1948)."""
    return SizeDistribution("rain", 8000.0, 4.1 * rate_mm_h**-0.21, 1.0, LARGEST_DROP_MM)


def sizes_of_snow(rate_mm_h: float, density_g_cm3: float) -> SizeDistribution:
    """Flakes by Gunn and Marshall (1958), as wide as their density makes them."""
    swelling = density_g_cm3 ** (-1.0 / 3.0)
    return SizeDistribution(
        "snow",
        3.8e3 * rate_mm_h**-0.87,
        2.55 * rate_mm_h**-0.48,
        swelling,
        LARGEST_FLAKE_MM / swelling,
    )


def sizes_of(weather: Weather) -> tuple[SizeDistribution, ...]:
    """Of all that falls in `weather`."""
    rain, snow = weather.rain, weather.snow
    falling = [sizes_of_rain(rain.rate_mm_h)] if rain.rate_mm_h else []
    falling += [sizes_of_snow(snow.rate_mm_h, snow.density_g_cm3)] if snow.rate_mm_h else []
    return tuple(falling)


def drop_speed_m_s(diameter_mm: Floats | float) -> Floats:
    """Terminal speed of rain (Atlas, Srivastava and Sekhon 1973); mist stands still."""
    return np.maximum(9.65 - 10.3 * np.exp(-0.6 * np.asarray(diameter_mm)), 0.0)


def wind_near_ground(wind: Wind, height_m: float) -> NDArray[np.float64]:
    """Velocity (3,) of the air in m/s at a height: the logarithmic profile over town."""
    grown = math.log(height_m / ROUGHNESS_M) / math.log(REFERENCE_HEIGHT_M / ROUGHNESS_M)
    speed, azimuth = wind.speed_m_s * grown, math.radians(wind.from_deg)
    return np.array([-speed * math.sin(azimuth), -speed * math.cos(azimuth), 0.0])


def settled_mm(rate_mm_h: float, hours: float, density_kg_m3: float, normal_z: float) -> float:
    """Depth of snow in mm on a surface by how far it faces up: 1 level, 0 upright, -1 below.

    Args:
        rate_mm_h: Liquid equivalent of what falls on level ground.
        hours: For which it falls, without wind.
        density_kg_m3: Of the snow that lies.
        normal_z: Upward part of the surface's normal.
    """
    return rate_mm_h * hours * 1000.0 / density_kg_m3 * max(0.0, normal_z)
