"""Precipitation, and the wind that carries it."""

import math

import numpy as np
from advercity_dsl import Weather
from advercity_dsl.weather_components import Wind
from numpy.typing import NDArray

from advercity.physics.extinction import compute_extinction

ROUGHNESS_LENGTH_M = 0.5
"""Roughness length of the logarithmic wind profile, between fields and towns."""
WIND_REFERENCE_HEIGHT_M = 10.0
"""Height of the authored wind."""
CAMERA_HEIGHT_M = 2.5
"""Height of cameras, at which the wind moves drops and flakes."""


def is_precipitating(weather: Weather) -> bool:
    """Return whether anything falls from the clouds."""
    return bool(compute_extinction(weather).precipitation)


def wind_at_height(wind: Wind, height_m: float) -> NDArray[np.float64]:
    """Compute the velocity (3,) of the air in m/s at a height, by the logarithmic profile."""
    reference = math.log(WIND_REFERENCE_HEIGHT_M / ROUGHNESS_LENGTH_M)
    grown = math.log(height_m / ROUGHNESS_LENGTH_M) / reference
    speed, azimuth = wind.speed_m_s * grown, math.radians(wind.from_deg)
    return np.array([-speed * math.sin(azimuth), -speed * math.cos(azimuth), 0.0])
