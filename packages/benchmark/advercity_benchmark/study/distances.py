"""Distances between two sets of feature vectors.

Both are common for generated pictures: Fréchet distance of fitted normal distributions (Heusel et
al. 2017) and unbiased kernel distance (Bińkowski et al. 2018). The distance between two halves of
one set is the effect of sampling alone.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from advercity.geometry.arrays import Float64Array
from advercity.randomness import create_generator

MAX_DIRECTIONS = 32
"""Principal directions for Fréchet distances: hundreds of pictures fill no larger covariance."""
HALVINGS = 10


@dataclass(frozen=True, eq=False)
class FeatureSet:
    """Features of the pictures of one recording.

    Attributes:
        name: Name of the recording.
        features: (n, d), a row for each crop.
        pictures: (n,) number of each crop's picture.
    """

    name: str
    features: Float64Array
    pictures: NDArray[np.int64]


@dataclass(frozen=True)
class FeatureDistance:
    """How far two sets are apart; for one set twice, its halves.

    Attributes:
        one, other: Names of the sets.
        frechet: Squared distance in the units of the features, in principal directions.
        kernel: Kernel distance, times 1000 as it is usually given.
    """

    one: str
    other: str
    frechet: float
    kernel: float


def compare_features(sets: Sequence[FeatureSet]) -> list[FeatureDistance]:
    """Compare every two sets, and the halves of each, in one basis for all.

    Halves have half the crops, so their distances are somewhat larger than with all crops.
    """
    reduce = _find_principal_directions(sets)
    low = [reduce(item.features) for item in sets]
    found: list[FeatureDistance] = []
    for first, one in enumerate(sets):
        found.append(_compare_halves(one, low[first]))
        for second in range(first + 1, len(sets)):
            other = sets[second]
            found.append(
                FeatureDistance(
                    one.name,
                    other.name,
                    compute_frechet_distance(low[first], low[second]),
                    1000.0 * compute_kernel_distance(one.features, other.features),
                )
            )
    return found


def compute_frechet_distance(one: Float64Array, other: Float64Array) -> float:
    """Compute the squared Fréchet distance of normal distributions fitted to (n, d) and (m, d)."""
    covariances = [np.atleast_2d(np.cov(item, rowvar=False)) for item in (one, other)]
    values, vectors = np.linalg.eigh(covariances[0])
    root = (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
    shared = np.linalg.eigvalsh(root @ covariances[1] @ root)
    trace = float(np.trace(covariances[0]) + np.trace(covariances[1]))
    apart = float(((one.mean(axis=0) - other.mean(axis=0)) ** 2).sum())
    return apart + trace - 2.0 * float(np.sqrt(np.maximum(shared, 0.0)).sum())


def compute_kernel_distance(one: Float64Array, other: Float64Array) -> float:
    """Compute the unbiased squared maximum mean discrepancy of (n, d) and (m, d), n, m > 1.

    The kernel is the cubic one of Bińkowski et al., (x·y / d + 1)³. It may be below 0 for equal
    distributions.
    """

    def kernel(a: Float64Array, b: Float64Array) -> Float64Array:
        return (a @ b.T / a.shape[1] + 1.0) ** 3

    def mean_without_diagonal(square: Float64Array) -> float:
        count = len(square)
        return float((square.sum() - np.trace(square)) / (count * (count - 1)))

    within = mean_without_diagonal(kernel(one, one)) + mean_without_diagonal(kernel(other, other))
    return within - 2.0 * float(kernel(one, other).mean())


def _find_principal_directions(
    sets: Sequence[FeatureSet],
) -> Callable[[Float64Array], Float64Array]:
    """Find a projection on the directions of largest variance, every set weighing the same."""
    fewest = min(len(item.features) for item in sets)
    pool = np.concatenate([_take_rows(item.features, fewest) for item in sets])
    mean = pool.mean(axis=0)
    _, _, directions = np.linalg.svd(pool - mean, full_matrices=False)
    # Covariances need several vectors for each direction, also for halves.
    kept = directions[: min(MAX_DIRECTIONS, max(2, fewest // 4))]
    return lambda features: (features - mean) @ kept.T


def _take_rows(features: Float64Array, count: int) -> Float64Array:
    return features[np.linspace(0, len(features) - 1, count).round().astype(int)]


def _compare_halves(item: FeatureSet, low: Float64Array) -> FeatureDistance:
    """Compare random halves of a set, by picture: crops of one picture are alike."""
    pictures = np.unique(item.pictures)
    generator = create_generator("study", "halves", item.name)
    frechet, kernel = np.empty(HALVINGS), np.empty(HALVINGS)
    for number in range(HALVINGS):
        half = np.isin(item.pictures, generator.permutation(pictures)[: len(pictures) // 2])
        frechet[number] = compute_frechet_distance(low[half], low[~half])
        kernel[number] = compute_kernel_distance(item.features[half], item.features[~half])
    return FeatureDistance(
        item.name, item.name, float(frechet.mean()), 1000.0 * float(kernel.mean())
    )
