"""Tracks of front bumpers, as a simulation records them."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from advercity.frames import FRONT_DTYPE


def track(**columns: NDArray[Any]) -> NDArray[np.void]:
    """Build a track (n,) of `FRONT_DTYPE` of columns (n,), a row per tick."""
    fronts = np.zeros(len(next(iter(columns.values()))), dtype=FRONT_DTYPE)
    fronts["tick"] = np.arange(len(fronts))
    for name, column in columns.items():
        fronts[name] = column
    return fronts
