"""A satellite receiver: where it is on the Earth, as the original has it or as receivers are."""

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
    """The fix of a receiver at a position of the world frame around `origin`.

    Noise in degrees is wider in metres from north to south than from west to east, but at the
    equator; noise in metres is not.

    Args:
        gnss: Its mode and noise.
        position: (3,) metres.
        origin: Where the world frame's origin stands.
        time_s: Of the fix.
        rng: Of this receiver and frame.
        slow_error: (3,) east, north and up, where its slow error stands, in standard deviations.
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
