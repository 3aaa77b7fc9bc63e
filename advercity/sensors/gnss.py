"""A satellite receiver: where it is on the Earth, with the rig's white noise in degrees."""

from dataclasses import dataclass

import numpy as np
from advercity_dsl import Gnss
from numpy.typing import ArrayLike

from advercity.sensors.geodesy import Geodetic, geodetic_from_enu


@dataclass(frozen=True)
class GnssFix:
    """What a receiver reports."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float
    time_s: float
    """Since the scenario's start, as `Frame.time_s`."""


def fix(
    gnss: Gnss,
    position: ArrayLike,
    *,
    origin: Geodetic,
    time_s: float,
    rng: np.random.Generator,
) -> GnssFix:
    """The fix of a receiver at a position (3,) of the world frame around `origin`."""
    place = geodetic_from_enu(position, origin)
    noise = rng.standard_normal(3)
    return GnssFix(
        latitude_deg=place.latitude_deg + float(noise[0]) * gnss.latitude_noise_deg,
        longitude_deg=place.longitude_deg + float(noise[1]) * gnss.longitude_noise_deg,
        altitude_m=place.altitude_m + float(noise[2]) * gnss.altitude_noise_m,
        time_s=time_s,
    )
