"""How far a LiDAR finds a target of a given reflectance in a weather, in the dark."""

import numpy as np

from advercity.sensors.lidar.power import echo

STEP_M = 0.1


def reach_m(reflectance: float, extinction_905nm: float, *, range_m: float = 200.0) -> float:
    """Range at which a target that faces the sensor is found half of the time.

    Args:
        reflectance: Of a Lambertian target, at 905 nm.
        extinction_905nm: Of the air, 1/m.
        range_m: Beyond this the sensor does not listen.
    """
    ranges = np.arange(STEP_M, range_m + STEP_M / 2, STEP_M)
    found = echo(ranges, np.full_like(ranges, reflectance), extinction_905nm) >= 1.0
    return float(ranges[found][-1]) if found.any() else 0.0
