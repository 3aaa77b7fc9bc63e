"""GNSS receiver with noise in degrees, as in the original Adver-City, or in metres.

Noise in degrees is wider in metres from north to south than from west to east, except at the
equator. The realistic mode has white noise plus a slow Gauss-Markov error, both in metres.
"""

import numpy as np
from advercity_dsl import Gnss
from numpy.typing import ArrayLike

from advercity.geometry.geodesy import Geodetic, geodetic_from_enu
from advercity.sensors.measurements import GnssFix


def measure_gnss(
    gnss: Gnss,
    position: ArrayLike,
    *,
    origin: Geodetic,
    time_s: float,
    rng: np.random.Generator,
    slow_error: ArrayLike = (0.0, 0.0, 0.0),
) -> GnssFix:
    """Measure the fix of a receiver.

    Args:
        gnss: Mode and noise of the receiver.
        position: (3,) true position in the world frame, metres.
        origin: Geodetic position of the world frame's origin.
        time_s: Time of the fix.
        rng: Generator of this receiver and frame.
        slow_error: (3,) current slow error east, north and up, in standard deviations.
    """
    noise = rng.standard_normal(3)
    if gnss.mode == "realistic":
        error = gnss.white_noise_m * noise + gnss.wander_m * np.asarray(slow_error)
        error[2] *= gnss.vertical_factor
        return _fix_from_geodetic(geodetic_from_enu(np.asarray(position) + error, origin), time_s)
    place = geodetic_from_enu(position, origin)
    return GnssFix(
        latitude_deg=place.latitude_deg + float(noise[0]) * gnss.latitude_noise_deg,
        longitude_deg=place.longitude_deg + float(noise[1]) * gnss.longitude_noise_deg,
        altitude_m=place.altitude_m + float(noise[2]) * gnss.altitude_noise_m,
        time_s=time_s,
    )


def _fix_from_geodetic(place: Geodetic, time_s: float) -> GnssFix:
    return GnssFix(place.latitude_deg, place.longitude_deg, place.altitude_m, time_s)
