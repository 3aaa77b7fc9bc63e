"""Generators, draws and Gauss-Markov processes."""

import math

import numpy as np
import pytest
from advercity_dsl.distribution import Choice, Distribution, Normal, TruncatedNormal, Uniform

from advercity.randomness import create_generator, draw_number, sample_gauss_markov


def test_a_generator_depends_on_its_key_alone() -> None:
    first = create_generator(1, "lidar", 101).random(4)
    create_generator(2).random(100)
    np.testing.assert_array_equal(create_generator(1, "lidar", 101).random(4), first)


def test_keys_that_differ_in_a_value_or_its_type_are_independent() -> None:
    keys = [(1, "lidar"), (2, "lidar"), (1, "camera"), ("1", "lidar"), (1, "lid", "ar")]
    assert len({create_generator(*key).random() for key in keys}) == len(keys)


@pytest.mark.parametrize(
    "distribution",
    [
        Uniform(uniform=(2, 5)),
        Normal(normal=TruncatedNormal(mean=3, sd=10, within=(2, 5))),
        Choice(choice=(2, 3.5, 5)),
    ],
)
def test_numbers_are_drawn_within_the_bounds(distribution: Distribution) -> None:
    rng = create_generator(0, "test")
    numbers = [draw_number(distribution, rng) for _ in range(200)]
    assert min(numbers) >= 2
    assert max(numbers) <= 5
    assert len(set(numbers)) >= 3


@pytest.mark.parametrize(
    ("distribution", "expected"),
    [
        (Uniform(uniform=(30, 80)), (30, 35, 40)),
        (Normal(normal=TruncatedNormal(mean=55, sd=1000, within=(30, 80))), (30, 35, 40)),
        (Choice(choice=(30, 40, 45, 60)), (30, 35, 40)),
    ],
)
def test_numbers_below_a_limit_keep_their_distribution(
    distribution: Distribution, expected: tuple[float, float, float]
) -> None:
    """A normal distribution of a large deviation is nearly uniform."""
    rng = create_generator(0, "test")
    numbers = [draw_number(distribution, rng, at_most=40) for _ in range(2000)]
    low, mean, high = expected
    assert min(numbers) == pytest.approx(low, abs=0.1)
    assert np.mean(numbers) == pytest.approx(mean, abs=0.3)
    assert max(numbers) == pytest.approx(high, abs=0.1)
    assert max(numbers) <= 40


def test_numbers_keep_their_distribution_between_two_limits() -> None:
    rng = create_generator(0, "test")
    limits = {"at_least": 40, "at_most": 60}
    numbers = [draw_number(Uniform(uniform=(30, 80)), rng, **limits) for _ in range(2000)]
    assert (min(numbers), max(numbers)) == pytest.approx((40, 60), abs=0.1)
    assert np.mean(numbers) == pytest.approx(50, abs=0.5)
    assert draw_number(Choice(choice=(30, 45, 70)), rng, **limits) == 45


def test_a_limit_outside_a_distribution_leaves_its_nearest_number() -> None:
    rng = create_generator(0, "test")
    assert draw_number(Uniform(uniform=(30, 80)), rng, at_most=20) == 30
    assert draw_number(Choice(choice=(60, 45)), rng, at_most=20) == 45
    assert draw_number(Uniform(uniform=(30, 80)), rng, at_least=90) == 80
    assert draw_number(Choice(choice=(60, 45)), rng, at_least=90) == 60


def test_a_gauss_markov_process_keeps_its_variance_and_forgets() -> None:
    memory = math.exp(-0.1 / 120)
    paths = sample_gauss_markov(create_generator("drift"), 0, 12_000, correlation=memory, axes=400)
    np.testing.assert_allclose(paths[[0, 6000, 12_000]].std(axis=1), 1.0, rtol=0.12)
    correlation = (paths[0] * paths[1200]).mean()
    assert correlation == pytest.approx(math.exp(-1), abs=0.15)


def test_any_interval_of_a_process_is_the_same() -> None:
    whole = sample_gauss_markov(create_generator("drift"), 0, 50, correlation=0.9, axes=2)
    np.testing.assert_allclose(
        sample_gauss_markov(create_generator("drift"), 30, 40, correlation=0.9, axes=2),
        whole[30:41],
        atol=1e-12,
    )
