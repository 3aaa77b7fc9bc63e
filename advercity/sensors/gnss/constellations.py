"""Positions of navigation satellites: circular orbits in Walker constellations."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

import numpy as np
from advercity_dsl.positioning import ConstellationName

from advercity.geometry.arrays import Float64Array
from advercity.geometry.geodesy import Geodetic, enu_from_ecef

EARTH_GM_M3_S2 = 3.986004418e14
_EPOCH = datetime(2000, 1, 1, 12, tzinfo=UTC)


@dataclass(frozen=True)
class Walker:
    """A Walker constellation i: t/p/f with t satellites in p planes.

    Attributes:
        inclination_deg: Inclination i of the planes.
        satellites: Number t of satellites.
        planes: Number p of planes, evenly around the equator.
        phasing: f: each plane is ahead of the one before by f of t parts of a turn.
        radius_m: Radius of the orbits.
    """

    inclination_deg: float
    satellites: int
    planes: int
    phasing: int
    radius_m: float

    @property
    def period_s(self) -> float:
        """Time of one turn, by Kepler's third law."""
        return 2.0 * math.pi * math.sqrt(self.radius_m**3 / EARTH_GM_M3_S2)


CONSTELLATIONS: dict[ConstellationName, Walker] = {
    # Six planes with four slots as in the GPS SPS Performance Standard (2020), here evenly spaced.
    "gps": Walker(55.0, 24, 6, 2, 26_559.7e3),
    # Galileo OS SIS ICD and BeiDou's MEO satellites: both are Walker constellations by design.
    "galileo": Walker(56.0, 24, 3, 1, 29_599.8e3),
    "glonass": Walker(64.8, 24, 3, 1, 25_508.0e3),
    "beidou": Walker(55.0, 24, 3, 1, 27_906.1e3),
}


def compute_satellites(
    names: Sequence[ConstellationName], time: datetime, origin: Geodetic
) -> Float64Array:
    """Compute the positions (n, 3) of all satellites in the world frame at `origin`, metres."""
    since_s = (time - _EPOCH) / timedelta(seconds=1)
    ecef = [_compute_ecef(CONSTELLATIONS[name], since_s) for name in names]
    return enu_from_ecef(np.concatenate(ecef), origin)


def _compute_ecef(walker: Walker, since_s: float) -> Float64Array:
    """Compute Earth-centred, Earth-fixed positions (n, 3) at a time since noon of 2000-01-01."""
    number = np.arange(walker.satellites)
    slots = walker.satellites // walker.planes
    plane, slot = number // slots, number % slots
    turn = slot / slots + walker.phasing * plane / walker.satellites + since_s / walker.period_s
    along = 2.0 * np.pi * (turn % 1.0)
    # Greenwich's sidereal angle, as in the position of the sun.
    sidereal_deg = (280.46062 + 360.98564737 * since_s / 86_400.0) % 360.0
    node = 2.0 * np.pi * plane / walker.planes - math.radians(sidereal_deg)
    tilt = math.radians(walker.inclination_deg)
    ahead, beside = np.cos(along), np.sin(along) * math.cos(tilt)
    return walker.radius_m * np.column_stack(
        [
            ahead * np.cos(node) - beside * np.sin(node),
            ahead * np.sin(node) + beside * np.cos(node),
            np.sin(along) * math.sin(tilt),
        ]
    )
