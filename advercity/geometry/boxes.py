"""Corners and edges of boxes."""

import numpy as np
from numpy.typing import NDArray


def compute_box_corners(size: tuple[float, float, float]) -> NDArray[np.float64]:
    """Compute the corners (8, 3) of an actor's box in its body frame (origin on the ground).

    Bits 2, 1 and 0 of a corner's row say whether it is at the front, at the left and on top.
    """
    unit = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (0.0, 1.0)])
    return unit * size


BOX_EDGES = np.array(
    [(a, a | bit) for a in range(8) for bit in (1, 2, 4) if not a & bit], dtype=np.intp
)
"""(12, 2) rows of the corners that each edge joins: those that differ in one bit."""

BOX_BASE = [0, 2, 6, 4]
"""Rows of the lower corners, in order around the base."""
