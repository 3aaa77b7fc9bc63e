"""Cover of the glass in front of sensors: drops, dirt or snow, by the side that the glass faces."""

import numpy as np
from advercity_dsl.weather_components import Lens
from numpy.typing import ArrayLike, NDArray

SIDE_FROM_DEG, REAR_FROM_DEG = 45.0, 135.0
"""Angles off the carrier's front from which glass faces the side, and the rear."""


def find_side(yaw_deg: ArrayLike) -> NDArray[np.intp]:
    """Find the sides (n,) that glass at yaws (n,) faces: 0 the front, 1 a side, 2 the rear."""
    off_front = np.abs((np.asarray(yaw_deg) + 180.0) % 360.0 - 180.0)
    return np.digitize(off_front, (SIDE_FROM_DEG, REAR_FROM_DEG))


def list_coverage(lens: Lens) -> tuple[float, float, float]:
    """List the covered fractions of glass at the front, the sides and the rear."""
    if not lens.enabled:
        return 0.0, 0.0, 0.0
    return lens.coverage.front, lens.coverage.side, lens.coverage.rear
