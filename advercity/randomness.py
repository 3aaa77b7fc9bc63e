"""Random numbers keyed by what they are for, never by the order in which they are asked for.

Errors that wander: slow to change, never far from zero.
"""

import hashlib
import math
from statistics import NormalDist

import numpy as np
from advercity_dsl.distribution import Choice, Distribution, Uniform

from advercity.geometry.arrays import Float64Array


def draw_number(item: Distribution, rng: np.random.Generator) -> float:
    """A number drawn from a distribution by one draw of `rng`."""
    if isinstance(item, Choice):
        return item.choice[int(rng.integers(len(item.choice)))]
    share = float(rng.random())
    if isinstance(item, Uniform):
        low, high = item.uniform
        return low + (high - low) * share
    bell = NormalDist(item.normal.mean, item.normal.sd)
    low, high = item.normal.within
    below, above = bell.cdf(low), bell.cdf(high)
    level = min(max(below + (above - below) * share, 1e-12), 1 - 1e-12)
    return min(max(bell.inv_cdf(level), low), high)


def create_generator(*key: int | str) -> np.random.Generator:
    """A Philox generator that is a pure function of `key`.

    Example: `generator(spec.seeds.sensors, "lidar", agent_id, frame)`. Two keys that differ
    anywhere give independent streams (the key is hashed to Philox's 128 bits).
    """
    text = "\x1f".join(f"{type(part).__name__}:{part}" for part in key)
    digest = hashlib.blake2b(text.encode(), digest_size=16).digest()
    return np.random.Generator(np.random.Philox(key=int.from_bytes(digest, "little")))


def sample_gauss_markov(
    rng: np.random.Generator, first: int, last: int, *, correlation: float, axes: int
) -> Float64Array:
    """First-order Gauss-Markov process of variance 1 at steps `first` to `last`, both included.

    It has its variance from step 0 on, and is the sum of all steps up to each, so that any stretch
    of it can be asked for by itself.

    Args:
        rng: At its beginning; the same for every stretch.
        first: Step, from 0.
        last: Step.
        correlation: Correlation of neighbouring steps: exp(-dt / tau).
        axes: Independent processes.

    Returns:
        (last - first + 1, axes).
    """
    steps = rng.standard_normal((last + 1, axes))
    steps[1:] *= math.sqrt(1.0 - correlation**2)
    states = np.empty((last - first + 1, axes))
    states[0] = correlation ** np.arange(first, -1, -1) @ steps[: first + 1]
    for row in range(1, len(states)):
        states[row] = correlation * states[row - 1] + steps[first + row]
    return states
