"""Random numbers of one scan, an independent stream for each purpose.

Draws of one effect never shift those of another: without rain all other numbers stay the same.
"""

from enum import IntEnum
from functools import lru_cache
from statistics import NormalDist
from typing import cast

import numpy as np
from numpy.typing import NDArray

NUM_LEVELS = 1 << 16
"""Number of different values of `normal` and `uniform`: two bytes a draw instead of eight."""


class StreamPurpose(IntEnum):
    """Purpose of a stream.

    Values are jumps of the generator: a new purpose goes to the end, or every dataset changes. 7 is
    unused. Values from 64 on are the point kinds of other distributions.
    """

    FIRED = 0
    SURFACE_NOISE = 1
    RANGE_NOISE = 2
    DROPOFF = 3
    SOFT_POWER = 4
    RAIN = 5
    SNOW = 6
    SPRAY = 8
    ONWARD_NOISE = 9
    SOFT_NOISE = 10
    SOFT_RANGE = 11
    SOFT_KIND = 12
    HAIL = 13
    STRAY_NOISE = 14


class RandomStreams:
    """The random streams of a sensor in a frame."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._root = cast("np.random.Philox", rng.bit_generator)

    def normal(self, purpose: StreamPurpose, count: int) -> NDArray[np.float32]:
        """Draw standard normal numbers (count,), the first of the purpose's stream."""
        return normal_quantiles().take(draw_levels(self.open_stream(purpose), count))

    def uniform(self, purpose: StreamPurpose, count: int) -> NDArray[np.float32]:
        """Draw numbers (count,) between 0 and 1, the first of the purpose's stream."""
        return (draw_levels(self.open_stream(purpose), count) + np.float32(0.5)) * np.float32(
            1.0 / NUM_LEVELS
        )

    def open_stream(self, purpose: StreamPurpose | int) -> np.random.Generator:
        """Open the generator of a purpose, always at its beginning."""
        return np.random.Generator(self._root.jumped(purpose + 1))


def draw_levels(rng: np.random.Generator, count: int) -> NDArray[np.uint16]:
    """Draw integers (count,) from 0 to `NUM_LEVELS` - 1, four from each 64-bit word."""
    return np.frombuffer(rng.bytes(2 * count), np.uint16)


@lru_cache(maxsize=1)
def normal_quantiles() -> NDArray[np.float32]:
    """Tabulate the standard normal quantile at the middle of each level, out to 4.3 sigma."""
    inverse = NormalDist().inv_cdf
    table = np.array(
        [inverse((level + 0.5) / NUM_LEVELS) for level in range(NUM_LEVELS)], np.float32
    )
    table.flags.writeable = False
    return table
