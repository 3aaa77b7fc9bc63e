"""Gauss-Markov processes."""

import math

import numpy as np
import pytest

from advercity.randomness import create_generator, sample_gauss_markov


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
