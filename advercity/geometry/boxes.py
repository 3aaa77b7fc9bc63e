"""Boxes around bodies: corners and edges."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Box:
    """A box in the frame of its body, whose origin is on the ground.

    Attributes:
        size: Full length, width and height in metres.
        centre: Its middle.
    """

    size: tuple[float, float, float]
    centre: tuple[float, float, float]

    @staticmethod
    def on_ground(size: tuple[float, float, float]) -> "Box":
        """Build the box whose base is centred on the origin."""
        return Box(size, (0.0, 0.0, size[2] / 2))

    @property
    def corners(self) -> NDArray[np.float64]:
        """Corners (8, 3); bits 2, 1 and 0 of a row: whether it is in front, left and on top."""
        unit = [(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]
        return np.array(unit) * self.size + self.centre


BOX_EDGES = np.array(
    [(a, a | bit) for a in range(8) for bit in (1, 2, 4) if not a & bit], dtype=np.intp
)
"""(12, 2) rows of the corners at the ends of each edge: they differ in one bit."""

BOX_BASE = [0, 2, 6, 4]
"""Rows of the lower corners, in order around the base."""
