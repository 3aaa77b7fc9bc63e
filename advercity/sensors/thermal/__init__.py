"""Thermal cameras from 8 to 14 um: surfaces, bodies, engines, sky and air."""

from advercity.sensors.thermal.conditions import ThermalConditions, derive_thermal_conditions
from advercity.sensors.thermal.image import (
    ThermalView,
    cast_thermal,
    take_thermal_image,
)

__all__ = [
    "ThermalConditions",
    "ThermalView",
    "cast_thermal",
    "derive_thermal_conditions",
    "take_thermal_image",
]
