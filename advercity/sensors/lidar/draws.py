"""Random numbers of one turn, a stream for each purpose.

What one effect draws never shifts what another does: switching rain off leaves every other number
as it was.
"""

from enum import IntEnum
from typing import cast

import numpy as np


class Purpose(IntEnum):
    """What a stream is for; a new purpose goes to the end."""

    FIRED = 0
    SURFACE_NOISE = 1
    RANGE_NOISE = 2
    DROPOFF = 3
    SOFT = 4
    RAIN = 5
    SNOW = 6
    WINDOW = 7
    SPRAY = 8
    ONWARD_NOISE = 9


class Draws:
    """The streams of a sensor in a frame."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._root = cast("np.random.Philox", rng.bit_generator)

    def stream(self, purpose: Purpose) -> np.random.Generator:
        """The generator for a purpose, always from its beginning."""
        return np.random.Generator(self._root.jumped(purpose + 1))
