"""A satellite receiver: where it is on the Earth, as the original has it or as receivers are."""

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
    wander: ArrayLike = (0.0, 0.0, 0.0),
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
        wander: (3,) east, north and up, where its slow error stands, in standard deviations.
    """
    noise = rng.standard_normal(3)
    if gnss.mode == "realistic":
        error = gnss.white_noise_m * noise + gnss.wander_m * np.asarray(wander)
        error[2] *= gnss.vertical_factor
        return _at(geodetic_from_enu(np.asarray(position) + error, origin), time_s)
    place = geodetic_from_enu(position, origin)
    return GnssFix(
        latitude_deg=place.latitude_deg + float(noise[0]) * gnss.latitude_noise_deg,
        longitude_deg=place.longitude_deg + float(noise[1]) * gnss.longitude_noise_deg,
        altitude_m=place.altitude_m + float(noise[2]) * gnss.altitude_noise_m,
        time_s=time_s,
    )


def _at(place: Geodetic, time_s: float) -> GnssFix:
    return GnssFix(place.latitude_deg, place.longitude_deg, place.altitude_m, time_s)
