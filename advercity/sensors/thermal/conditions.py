"""Heating and cooling of surfaces by air, sun and sky, computed once per weather."""

from dataclasses import dataclass

import numpy as np
from advercity_dsl import Weather

from advercity.geometry.arrays import Float64Array
from advercity.physics.atmosphere import Atmosphere
from advercity.physics.infrared import STEFAN_BOLTZMANN, InfraredAir
from advercity.physics.precipitation import CAMERA_HEIGHT_M, wind_at_height

LUMENS_PER_WATT = 110.0
"""Luminous efficacy of daylight, of the sun and of the sky within a tenth (Littlefair 1988)."""
MEAN_DAY_W_M2, CLOUD_LOSS, CLOUD_POWER = 190.0, 0.75, 3.4
"""Global irradiance, the mean of a clear day at 45 degrees at an equinox, and its loss by clouds
(Kasten and Czeplak 1980)."""
MIN_AIR_SPEED_M_S = 1.0
"""Speed of the air along a warm surface in a calm: warm air rises."""


@dataclass(frozen=True, eq=False)
class ThermalConditions:
    """Heating and cooling of surfaces by air, sun and sky.

    Attributes:
        air: Air between surfaces and camera.
        sun_direction: (3,) towards the sun.
        sun_w_m2: Irradiance by the sun, normal to its rays.
        diffuse_w_m2: Irradiance of level ground by the sky.
        mean_w_m2: Irradiance of level ground, the mean of a day.
        transfer_w_m2_k: Heat from a surface to air and surroundings per kelvin.
        wetness: 0 dry to 1 soaked.
        puddle_coverage: Fraction of the carriageway under standing water.
        snow_cover: Fraction of the ground under snow.
        road_snow_cover: Fraction of carriageways under snow.
    """

    air: InfraredAir
    sun_direction: Float64Array
    sun_w_m2: float
    diffuse_w_m2: float
    mean_w_m2: float
    transfer_w_m2_k: float
    wetness: float = 0.0
    puddle_coverage: float = 0.0
    snow_cover: float = 0.0
    road_snow_cover: float = 0.0


def derive_thermal_conditions(atmosphere: Atmosphere, weather: Weather) -> ThermalConditions:
    """Derive the conditions of a thermal camera from a weather and its atmosphere.

    Surfaces lose heat to the air by McAdams' law, 5.7 + 3.8 W/(m² K) for each m/s of wind along
    the surface, and to the surroundings by radiation.
    """
    air = InfraredAir.from_weather(weather, atmosphere.extinction)
    speed = float(np.linalg.norm(wind_at_height(weather.wind, CAMERA_HEIGHT_M)))
    is_covered = atmosphere.extinction.water_g_m3 > 0.0
    cloudiness = 1.0 if is_covered else weather.sky.oktas / 8.0
    # The moon does not warm surfaces.
    is_day = not atmosphere.night
    return ThermalConditions(
        air=air,
        sun_direction=atmosphere.sun_direction,
        sun_w_m2=is_day * atmosphere.sun_lx / LUMENS_PER_WATT,
        diffuse_w_m2=is_day * atmosphere.sky_lx / LUMENS_PER_WATT,
        mean_w_m2=MEAN_DAY_W_M2 * (1.0 - CLOUD_LOSS * cloudiness**CLOUD_POWER),
        transfer_w_m2_k=5.7
        + 3.8 * max(speed, MIN_AIR_SPEED_M_S)
        + 4.0 * STEFAN_BOLTZMANN * air.air_k**3,
        wetness=atmosphere.wetness,
        puddle_coverage=atmosphere.puddle_coverage,
        snow_cover=1.0 if atmosphere.snow_depth_m else 0.0,
        road_snow_cover=atmosphere.road_snow_cover,
    )
