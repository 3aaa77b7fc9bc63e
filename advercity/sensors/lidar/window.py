"""Drops and dirt on the window that a LiDAR looks through."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from advercity_dsl import Lidar
from numpy.typing import NDArray

from advercity.sensors.lidar.beams import bearings_rad

Floats = NDArray[np.floating[Any]]

SECTORS = 360
"""Parts of the window, one degree each, that a drop may block."""
DIMMING = 0.3
"""Light that a window loses, one way, where all of it is covered."""
BLOCKING = 2.0
"""Share of sectors that are blocked, against the share of glass that is covered."""
_FRONT_RAD, _REAR_RAD = math.radians(45.0), math.radians(135.0)


@dataclass(frozen=True, eq=False)
class Window:
    """What the window does to each of n beams: gain (n,), two ways, and sector (n,)."""

    gain: Floats
    coverage: Floats
    """(SECTORS,) share of the glass that is covered."""
    sector: NDArray[np.int32]

    @staticmethod
    def of(lidar: Lidar, coverage: tuple[float, float, float]) -> "Window | None":
        """None if it is clean.

        Args:
            lidar: Whose window it is.
            coverage: At the front, the sides and the rear.
        """
        if not any(coverage):
            return None
        front, side, rear = coverage
        turn = (np.arange(SECTORS) + 0.5) * (2.0 * math.pi / SECTORS)
        ahead = np.minimum(turn, 2.0 * math.pi - turn)
        by_sector = np.where(ahead < _FRONT_RAD, front, np.where(ahead < _REAR_RAD, side, rear))
        bearing = np.repeat(bearings_rad(lidar.azimuths), lidar.channels)
        sector = (bearing * (SECTORS / (2.0 * math.pi))).astype(np.int32) % SECTORS
        gain = (1.0 - DIMMING * by_sector) ** 2
        return Window(gain.astype(np.float32)[sector], by_sector.astype(np.float32), sector)

    def clear(self, uniform: Floats) -> NDArray[np.bool_]:
        """Whether each beam (n,) gets out, by random numbers (SECTORS,) from 0 to 1."""
        return (uniform >= BLOCKING * self.coverage)[self.sector]
