"""Statistics of LiDAR sweeps against numbers by hand."""

import numpy as np
import pytest
from advercity_benchmark.study.recordings import Recording, Sweep
from advercity_benchmark.study.sweep_statistics import (
    RANGE_EDGES_M,
    compute_jensen_shannon_distance,
    compute_sweep_statistics,
    find_lonely_points,
)

from advercity.errors import InputError

HINT = "lonely echoes are not searched; `scripts/setup_peers` installs scikit-learn"


def record(*sweeps: Sweep) -> Recording:
    return Recording("a", "kitti", [], [lambda sweep=sweep: sweep for sweep in sweeps])


def sweep_along_x(*range_m: float, intensity: float = 0.5) -> Sweep:
    points = np.zeros((len(range_m), 3), np.float32)
    points[:, 0] = range_m
    return Sweep(points, np.full(len(range_m), intensity, np.float32))


def test_sweeps_are_counted_as_by_hand() -> None:
    # No sweep has enough points to search neighbours among.
    near, far = sweep_along_x(1.0, 10.0, 20.0), sweep_along_x(30.0, 500.0, intensity=0.1)
    found = compute_sweep_statistics(record(near, far))
    assert (found.sweeps, found.echoes) == (2, 2.0)  # the echo at 1 m is of the vehicle itself
    assert found.median_range_m == 25.0
    assert found.mean_intensity == pytest.approx(0.3)
    fractions = dict(zip(RANGE_EDGES_M[:-1], found.ranges, strict=True))
    assert {edge: fraction for edge, fraction in fractions.items() if fraction} == {
        10.0: 0.25,
        20.0: 0.25,
        30.0: 0.25,
        115.0: 0.25,
    }
    assert found.ranges.sum() == found.intensities.sum() == found.elevations.sum() == 1.0


def test_a_recording_without_echoes_is_refused() -> None:
    with pytest.raises(InputError, match="'a' has no LiDAR echoes beyond"):
        compute_sweep_statistics(record(sweep_along_x(0.5)))


def test_flakes_before_a_wall_are_lonely_and_the_wall_is_not() -> None:
    pytest.importorskip("scipy", reason=HINT)
    angle = np.radians(np.arange(-8.0, 8.0, 0.4))
    across, up = np.meshgrid(10.0 * np.tan(angle), 10.0 * np.tan(angle))
    wall = np.stack([np.full_like(across, 10.0), across, up], axis=-1).reshape(-1, 3)
    flakes = np.array([[4.0, 0.0, 0.0], [5.0, 1.0, 0.5], [6.0, -1.0, 0.5]])
    lonely = find_lonely_points(np.concatenate([wall, flakes]).astype(np.float32))
    assert lonely[-3:].all()
    assert not lonely[:-3].any()


def test_the_distance_of_histograms_is_0_for_equal_and_1_for_disjoint_ones() -> None:
    one, other = np.array([1.0, 0.0]), np.array([0.0, 1.0])
    assert compute_jensen_shannon_distance(one, one) == 0.0
    assert compute_jensen_shannon_distance(one, other) == 1.0
    # Against (3/4, 1/4): log2(4/3) and (log2(2/3) + log2(2)) / 2, the mean of both 0.3113 bits.
    half = np.array([0.5, 0.5])
    assert compute_jensen_shannon_distance(one, half) == pytest.approx(0.3113**0.5, abs=1e-4)
