"""Where water stands on a carriageway: a fixed field of hollows, filled up to a level."""

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from advercity.randomness import generator

Floats = NDArray[np.floating[Any]]

HOLLOW_M = 3.0
"""Distance between nodes of the field, so that puddles are two to eight metres wide."""
NODES = 128
"""Along an edge; then the field repeats."""


@lru_cache(maxsize=1)
def _field() -> Floats:
    heights = generator("puddles").random((NODES, NODES), np.float32)
    heights.flags.writeable = False
    return heights


def height(points: Floats) -> Floats:
    """Height (n,), from 0 to 1, of the field at points (n, 2 or more) of the world."""
    x, y = points[:, 0] / HOLLOW_M, points[:, 1] / HOLLOW_M
    column, row = np.floor(x), np.floor(y)
    right, up = x - column, y - row
    right, up = right * right * (3.0 - 2.0 * right), up * up * (3.0 - 2.0 * up)
    left, low = column.astype(np.int32) % NODES, row.astype(np.int32) % NODES
    beside, above = (left + 1) % NODES, (low + 1) % NODES
    field = _field()
    bottom = field[low, left] * (1.0 - right) + field[low, beside] * right
    top = field[above, left] * (1.0 - right) + field[above, beside] * right
    return bottom * (1.0 - up) + top * up


@lru_cache(maxsize=16)
def level(coverage: float) -> float:
    """Water level that covers that share of the ground."""
    grid = np.arange(NODES * 4) * (HOLLOW_M / 4.0)
    points = np.stack(np.meshgrid(grid, grid), axis=-1).reshape(-1, 2).astype(np.float32)
    return float(np.quantile(height(points), coverage))


def covered(points: Floats, coverage: float) -> NDArray[np.bool_]:
    """Whether each point (n, 2 or more) of the world is under water."""
    return height(points) < level(coverage)
