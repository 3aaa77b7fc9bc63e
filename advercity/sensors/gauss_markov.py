"""Errors that wander: slow to change, never far from zero."""

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def wander(rng: np.random.Generator, first: int, last: int, *, memory: float, axes: int) -> Array:
    """First-order Gauss-Markov process of variance 1 at steps `first` to `last`, both included.

    It has its variance from step 0 on, and is the sum of all steps up to each, so that any stretch
    of it can be asked for by itself.

    Args:
        rng: At its beginning; the same for every stretch.
        first: Step, from 0.
        last: Step.
        memory: Correlation of neighbouring steps: exp(-dt / tau).
        axes: Independent processes.

    Returns:
        (last - first + 1, axes).
    """
    steps = rng.standard_normal((last + 1, axes))
    steps[1:] *= math.sqrt(1.0 - memory**2)
    states = np.empty((last - first + 1, axes))
    states[0] = memory ** np.arange(first, -1, -1) @ steps[: first + 1]
    for row in range(1, len(states)):
        states[row] = memory * states[row - 1] + steps[first + row]
    return states
