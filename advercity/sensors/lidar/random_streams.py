"""Random numbers of one turn, a stream for each purpose.

What one effect draws never shifts what another does: switching rain off leaves every other number
as it was.
"""

from enum import IntEnum
from functools import lru_cache
from statistics import NormalDist
from typing import cast

import numpy as np
from numpy.typing import NDArray

NUM_LEVELS = 1 << 16
"""Different numbers that come out of `normal` and `uniform`."""


class StreamPurpose(IntEnum):
    """What a stream is for; a new purpose goes to the end."""

    FIRED = 0
    SURFACE_NOISE = 1
    RANGE_NOISE = 2
    DROPOFF = 3
    SOFT_POWER = 4
    RAIN = 5
    SNOW = 6
    WINDOW = 7
    SPRAY = 8
    ONWARD_NOISE = 9
    SOFT_NOISE = 10
    SOFT_RANGE = 11
    SOFT_KIND = 12


class RandomStreams:
    """The streams of a sensor in a frame."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._root = cast("np.random.Philox", rng.bit_generator)

    def normal(self, purpose: StreamPurpose, count: int) -> NDArray[np.float32]:
        """Standard normal numbers (count,), the first of the purpose's stream."""
        return normal_quantiles().take(self._draw_levels(purpose, count))

    def uniform(self, purpose: StreamPurpose, count: int) -> NDArray[np.float32]:
        """Numbers (count,) between 0 and 1, the first of the purpose's stream."""
        return (self._draw_levels(purpose, count) + np.float32(0.5)) * np.float32(1.0 / NUM_LEVELS)

    def _draw_levels(self, purpose: StreamPurpose, count: int) -> NDArray[np.uint16]:
        return draw_levels(self.open_stream(purpose), count)

    def open_stream(self, purpose: StreamPurpose) -> np.random.Generator:
        """The generator for a purpose, always from its beginning."""
        return np.random.Generator(self._root.jumped(purpose + 1))


def draw_levels(rng: np.random.Generator, count: int) -> NDArray[np.uint16]:
    """Whole numbers (count,), 0 to `LEVELS` - 1: a fourth of the draws that floats would need."""
    return np.frombuffer(rng.bytes(2 * count), np.uint16)


@lru_cache(maxsize=1)
def normal_quantiles() -> NDArray[np.float32]:
    """Standard normal number of each level: the middle quantiles, out to 4.3 deviations."""
    inverse = NormalDist().inv_cdf
    table = np.array(
        [inverse((level + 0.5) / NUM_LEVELS) for level in range(NUM_LEVELS)], np.float32
    )
    table.flags.writeable = False
    return table
