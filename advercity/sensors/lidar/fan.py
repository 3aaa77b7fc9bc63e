"""Beams that spread around a sensor, and which of them may meet a box."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from advercity_dsl import Lidar
from numpy.typing import NDArray

from advercity.poses import Matrix, inverse, transform
from advercity.sensors.lidar.beams import bearings_rad, elevations_rad, offsets_rad

Floats = NDArray[np.floating[Any]]
Rows = NDArray[np.intp]

_TURN_RAD = 2.0 * math.pi


@dataclass(frozen=True, eq=False)
class Fan:
    """Beams in upright columns around a sensor, all channels at each bearing.

    Attributes:
        world_from_fan: (4, 4); bearings turn about its z axis.
        bearing_rad: (m,) float32 of every column, ascending, from 0 to 2 pi.
        elevation_rad: (c,) float32 of the beams of each column, ascending.
        spread_rad: How far a beam may stray from its bearing and elevation.
    """

    world_from_fan: Matrix
    bearing_rad: Floats
    elevation_rad: Floats
    spread_rad: float

    @staticmethod
    def of(lidar: Lidar, world_from_lidar: Matrix) -> "Fan":
        """The beams of a LiDAR."""
        return Fan(
            world_from_lidar,
            bearings_rad(lidar.azimuths),
            elevations_rad(lidar).astype(np.float32),
            spread_rad=float(np.abs(offsets_rad(lidar)).max()),
        )

    def towards(self, corners: Matrix) -> Rows:
        """Beams (n,) that may meet the hull of points (c, 3) of the world, metres; ascending."""
        own = transform(inverse(self.world_from_fan), corners)
        bearing = math.atan2(*own.mean(axis=0)[1::-1])
        ahead = own[:, 0] * math.cos(bearing) + own[:, 1] * math.sin(bearing)
        near = float(ahead.min())
        if near <= 0.0:
            return np.arange(len(self.bearing_rad) * len(self.elevation_rad))
        aside = np.arctan2(own[:, 1] * math.cos(bearing) - own[:, 0] * math.sin(bearing), ahead)
        far = float(np.hypot(own[:, 0], own[:, 1]).max())
        low, high = float(own[:, 2].min()), float(own[:, 2].max())
        bottom = math.atan2(low, near if low < 0.0 else far) - self.spread_rad
        top = math.atan2(high, near if high > 0.0 else far) + self.spread_rad
        first = (bearing + float(aside.min()) - self.spread_rad) % _TURN_RAD
        span = float(np.ptp(aside)) + 2.0 * self.spread_rad
        columns = np.flatnonzero((self.bearing_rad - first) % _TURN_RAD <= span)
        channels = np.flatnonzero((self.elevation_rad >= bottom) & (self.elevation_rad <= top))
        return (columns[:, None] * len(self.elevation_rad) + channels).ravel()
