"""Random generators keyed by purpose instead of call order, and random processes."""

import hashlib
import math
from statistics import NormalDist

import numpy as np
from advercity_dsl.distribution import Choice, Distribution, Uniform, compute_bounds

from advercity.geometry.arrays import Float64Array


def draw_number(
    item: Distribution,
    rng: np.random.Generator,
    *,
    at_least: float = -math.inf,
    at_most: float = math.inf,
) -> float:
    """Draw a number from a distribution truncated at both limits, with one draw of `rng`.

    If `at_most` is below the distribution, the result is its lowest number; if `at_least` is above
    it, the highest number up to `at_most`.
    """
    low, high = compute_bounds(item)
    high = max(min(high, at_most), low)
    low = min(max(low, at_least), high)
    if isinstance(item, Choice):
        below = [value for value in item.choice if value <= high]
        choice = [value for value in below if value >= low] or [max(below)]
        return choice[int(rng.integers(len(choice)))]
    fraction = float(rng.random())
    if isinstance(item, Uniform):
        return low + (high - low) * fraction
    # Inverse transform sampling: one draw, which rejection sampling would not guarantee.
    normal = NormalDist(item.normal.mean, item.normal.sd)
    lowest, highest = normal.cdf(low), normal.cdf(high)
    level = min(max(lowest + (highest - lowest) * fraction, 1e-12), 1 - 1e-12)
    return min(max(normal.inv_cdf(level), low), high)


def create_generator(*key: int | str) -> np.random.Generator:
    """Create a Philox generator that is a pure function of `key`.

    Example: `create_generator(spec.seeds.sensors, "lidar", agent_id, frame)`. Different keys give
    independent streams, since the key is hashed to Philox's 128 bits.
    """
    # Names of types are part of the stream: 1 and "1" differ, and renaming an enum changes it.
    text = "\x1f".join(f"{type(part).__name__}:{part}" for part in key)
    digest = hashlib.blake2b(text.encode(), digest_size=16).digest()
    return np.random.Generator(np.random.Philox(key=int.from_bytes(digest, "little")))


def sample_gauss_markov(
    rng: np.random.Generator, first: int, last: int, *, correlation: float, axes: int
) -> Float64Array:
    """Sample a stationary first-order Gauss-Markov process of variance 1.

    Each state is computed from all steps before it: any segment can be sampled alone.

    Args:
        rng: Generator in its initial state, the same for every segment.
        first: First step of the segment, counted from 0.
        last: Last step, included.
        correlation: Correlation of successive steps: exp(-dt / tau).
        axes: Number of independent processes.

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


def sample_random_walk(
    rng: np.random.Generator, first: int, last: int, *, axes: int
) -> Float64Array:
    """Sample random walks (last - first + 1, axes) of unit steps from 0, from step `first` on.

    As in `sample_gauss_markov`, segments of generators in their initial state agree.
    """
    return np.cumsum(rng.standard_normal((last + 1, axes)), axis=0)[first:]
