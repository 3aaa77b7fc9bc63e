"""Path loss between stations on and beside roads, by published models.

Path loss, loss behind vehicles and the spread of shadowing follow 3GPP TR 37.885 V15.3.0, clause
6.2.1, for vehicles and roadside units alike; its random quantities (whether a path is blocked, and
the height of the blocking vehicle) are given here. Fast fading, reflections, vegetation and
diffraction around corners are left out; the loss behind buildings is a mean with the last two. Rain
and fog cost 0.2 dB (50 mm/h) and 0.01 dB (0.3 g/m³) per km at 5.9 GHz, too little to matter.
"""

import math
from dataclasses import dataclass
from enum import Enum
from typing import Literal

from advercity_dsl.channel import Radio

from advercity.physics.microwaves import fog_attenuation_db_km, rain_attenuation_db_km

Environment = Literal["urban", "highway"]


class PathState(Enum):
    """Obstacles between two antennas."""

    LOS = "los"
    """Free path."""
    NLOSV = "nlosv"
    """Vehicles."""
    NLOS = "nlos"
    """Buildings, walls or the ground."""


@dataclass(frozen=True)
class RadioPath:
    """The straight path between two antennas.

    Attributes:
        state: Obstacles on it.
        distance_m: Its length.
        antenna_heights_m: Heights of the two antennas over the road.
        blocker: Id of the tallest vehicle on it; 0 if there is none.
        blocker_height_m: Its height.
    """

    state: PathState
    distance_m: float
    antenna_heights_m: tuple[float, float]
    blocker: int = 0
    blocker_height_m: float = 0.0


SHADOWING_DB = {PathState.LOS: 3.0, PathState.NLOSV: 3.0, PathState.NLOS: 4.0}
"""Standard deviation of shadowing (TR 37.885, table 6.2.1-1)."""
MIN_DISTANCE_M = 1.0
"""Nearer antennas are taken to be this far apart: the models are of far fields."""
_BLOCKED_MEAN_DB, _BLOCKED_DB = 9.0, 4.5
_HALF_BLOCKED_MEAN_DB, _HALF_BLOCKED_DB = 5.0, 4.0


def compute_path_loss_db(
    state: PathState, distance_m: float, frequency_ghz: float, environment: Environment
) -> float:
    """Compute the mean path loss without vehicles on the path (TR 37.885, table 6.2.1-1).

    The table has no buildings beside highways; its loss behind buildings of towns is taken.
    """
    distance_log = math.log10(max(distance_m, MIN_DISTANCE_M))
    frequency_log = math.log10(frequency_ghz)
    if state is PathState.NLOS:
        return 36.85 + 30.0 * distance_log + 18.9 * frequency_log
    if environment == "highway":
        return 32.4 + 20.0 * distance_log + 20.0 * frequency_log
    return 38.77 + 16.7 * distance_log + 18.2 * frequency_log


def compute_blockage_db(path: RadioPath, normal: float) -> float:
    """Compute the loss behind a vehicle (TR 37.885, clause 6.2.1).

    It is normally distributed in dB, and at least 0: more if both antennas are below the vehicle's
    roof than if one is, and none if both are above it.

    Args:
        path: The path; its state is not looked at.
        normal: Standard normal number.
    """
    low_m, high_m = sorted(path.antenna_heights_m)
    if not path.blocker or low_m > path.blocker_height_m:
        return 0.0
    if high_m < path.blocker_height_m:
        mean_db, deviation_db = _BLOCKED_MEAN_DB, _BLOCKED_DB
    else:
        mean_db, deviation_db = _HALF_BLOCKED_MEAN_DB, _HALF_BLOCKED_DB
    mean_db += max(0.0, 15.0 * math.log10(max(path.distance_m, MIN_DISTANCE_M)) - 41.0)
    return max(0.0, mean_db + deviation_db * normal)


def compute_air_attenuation_db_km(
    rain_mm_h: float, fog_water_g_m3: float, frequency_ghz: float
) -> float:
    """Compute the attenuation of vertically polarised waves by rain and fog (ITU-R P.838, P.840).

    Snow and hail are neglected: dry ice attenuates less than rain of the same rate.
    """
    rain = rain_attenuation_db_km(rain_mm_h, frequency_ghz, polarisation="vertical")
    return rain + fog_attenuation_db_km(fog_water_g_m3, frequency_ghz)


def compute_received_dbm(
    radio: Radio,
    path: RadioPath,
    environment: Environment,
    *,
    shadowing: float = 0.0,
    blockage: float = 0.0,
    air_db_km: float = 0.0,
) -> float:
    """Compute the received power.

    Args:
        radio: The radio of both stations.
        path: The path between them.
        environment: Kind of path loss.
        shadowing: Standard normal number of the place.
        blockage: Standard normal number of the blocking vehicle.
        air_db_km: Attenuation of the air.
    """
    loss_db = compute_path_loss_db(
        path.state, path.distance_m, radio.frequency_mhz / 1e3, environment
    )
    loss_db += air_db_km * path.distance_m / 1e3
    if radio.shadowing:
        loss_db += SHADOWING_DB[path.state] * shadowing
    if path.state is PathState.NLOSV:
        loss_db += compute_blockage_db(path, blockage)
    return radio.transmit_dbm + 2.0 * radio.antenna_gain_db - loss_db
