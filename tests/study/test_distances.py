"""Distances of feature vectors against numbers by hand and plain loops."""

import numpy as np
import pytest
from advercity_benchmark.study.distances import (
    FeatureSet,
    compare_features,
    compute_frechet_distance,
    compute_kernel_distance,
)


def test_the_frechet_distance_of_two_normal_distributions_is_as_by_hand() -> None:
    # Means 0 and 3, variances 1 and 4: 3² + 1 + 4 - 2 · 1 · 2.
    one, other = np.array([[-1.0], [0.0], [1.0]]), np.array([[1.0], [3.0], [5.0]])
    assert compute_frechet_distance(one, other) == pytest.approx(10.0)


def test_the_frechet_distance_does_not_depend_on_the_axes() -> None:
    generator = np.random.default_rng(1)
    one, other = generator.normal(size=(50, 3)), generator.normal(size=(40, 3)) * [1.0, 2.0, 5.0]
    turn, _ = np.linalg.qr(generator.normal(size=(3, 3)))
    assert compute_frechet_distance(one @ turn, other @ turn) == pytest.approx(
        compute_frechet_distance(one, other)
    )
    assert compute_frechet_distance(one, one) == pytest.approx(0.0, abs=1e-9)


def test_the_kernel_distance_is_that_of_plain_loops() -> None:
    generator = np.random.default_rng(2)
    one, other = generator.normal(size=(5, 4)), generator.normal(size=(3, 4)) + 0.5

    def mean(pairs: list[tuple[np.ndarray, np.ndarray]]) -> float:
        return float(np.mean([(a @ b / 4.0 + 1.0) ** 3 for a, b in pairs]))

    expected = (
        mean([(a, b) for i, a in enumerate(one) for j, b in enumerate(one) if i != j])
        + mean([(a, b) for i, a in enumerate(other) for j, b in enumerate(other) if i != j])
        - 2.0 * mean([(a, b) for a in one for b in other])
    )
    assert compute_kernel_distance(one, other) == pytest.approx(expected)


def draw_set(name: str, seed: int, shift: float = 0.0) -> FeatureSet:
    features = np.random.default_rng(seed).normal(size=(90, 8)) + shift
    return FeatureSet(name, features, np.repeat(np.arange(30), 3))


def test_sets_of_one_kind_are_as_near_as_halves_and_others_are_farther() -> None:
    found = compare_features([draw_set("a", 1), draw_set("b", 2), draw_set("c", 3, shift=1.0)])
    frechet = {(item.one, item.other): item.frechet for item in found}
    kernel = {(item.one, item.other): item.kernel for item in found}
    assert set(frechet) == {(a, b) for a in "abc" for b in "abc" if a <= b}
    assert frechet["a", "b"] < 2.0 * frechet["a", "a"]
    assert frechet["a", "c"] > 4.0 * frechet["a", "a"]
    # The same mean: 0 within what so few can tell. Another: (1 + 8 / 8)³ - 1 and more.
    assert abs(kernel["a", "b"]) < 300.0 < 1000.0 < kernel["a", "c"]


def test_halves_are_cut_between_pictures_and_not_between_crops() -> None:
    # Crops of a picture are equal, pictures are not: halves by crop would be all but equal.
    pictures = np.repeat(np.arange(6), 3)
    features = np.random.default_rng(4).normal(size=(6, 8))[pictures]
    other = np.random.default_rng(5).normal(size=(18, 8))
    within = compare_features([FeatureSet("a", features, pictures), draw_set("b", 6)])[0]
    by_crop = compare_features([FeatureSet("a", features, np.arange(18)), draw_set("b", 6)])[0]
    assert within.frechet > 1.5 * by_crop.frechet
    assert other.shape == features.shape
