"""advercity.geometry.boxes."""

import numpy as np
from numpy.typing import NDArray


def compute_box_corners(size: tuple[float, float, float]) -> NDArray[np.float64]:
    """Corners (8, 3) of an actor's box in its body frame; corner k has bits x, y, z of k."""
    unit = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (0.0, 1.0)])
    return unit * size


BOX_EDGES = np.array(
    [(a, a | bit) for a in range(8) for bit in (1, 2, 4) if not a & bit], dtype=np.intp
)
"""Indices (12, 2) of corners that an edge joins."""

BOX_BASE = [0, 2, 6, 4]
"""Indices of the lower corners, in order around the base."""
