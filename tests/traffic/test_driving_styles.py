"""Drivers differ from each other and from moment to moment, and do the same in every run."""

from collections.abc import Callable

import numpy as np
import pytest
from advercity_dsl import Spec
from scipy.stats import lognorm

from advercity.frames import Trace
from advercity.traffic.driving_styles import MEDIAN_STYLE, draw_driving_style


def test_a_driver_is_the_same_in_every_run_and_unlike_others():
    styles = [draw_driving_style(7, number) for number in range(400)]

    assert styles == [draw_driving_style(7, number) for number in range(400)]
    medians = {"headway_ratio": 1.0, "gap_ratio": 1.0, "acceleration_ratio": 0.85}
    for name, median in (medians | {"braking_ratio": 1.0}).items():
        ratios = np.array([getattr(style, name) for style in styles])
        assert np.median(ratios) == pytest.approx(median, abs=0.06)
        assert 0.1 < np.log(ratios).std() < 0.4
        assert ratios.min() >= 0.5
    headways, gaps = (
        [getattr(one, name) for one in styles] for name in ("headway_ratio", "gap_ratio")
    )
    assert abs(np.corrcoef(headways, gaps)[0, 1]) < 0.15


@pytest.mark.parametrize(
    ("name", "median", "sigma", "least", "greatest"),
    [
        ("headway_ratio", 1.0, 0.35, 0.5, 2.2),
        ("gap_ratio", 1.0, 0.35, 0.5, 2.2),
        ("acceleration_ratio", 0.85, 0.2, 0.6, 1.0),
        ("braking_ratio", 1.0, 0.28, 0.5, 2.0),
    ],
)
def test_ratios_of_drivers_are_log_normal_within_their_limits(
    name: str, median: float, sigma: float, least: float, greatest: float
):
    ratios = np.sort([getattr(draw_driving_style(3, number), name) for number in range(2000)])
    assert (ratios[0], ratios[-1]) == (least, greatest)
    inside = (ratios > least) & (ratios < greatest)
    expected = lognorm(sigma, scale=median).cdf(ratios)
    found = np.arange(1, len(ratios) + 1) / len(ratios)
    # Kolmogorov and Smirnov's distance at a level of 0.1 %.
    assert np.abs(found - expected)[inside].max() < 1.95 / np.sqrt(len(ratios))


@pytest.mark.parametrize("seed", [1, 90210])
def test_the_speed_that_a_driver_wants_sways_slowly_around_its_mean(seed: int):
    """At 10 m/s an acceleration noise of a hundredth of g, as drivers have it on free roads."""
    times_s = np.arange(0, 600, 0.1)
    noises: list[float] = []
    for number in range(20):
        style = draw_driving_style(seed, number)
        sways = np.array([style.sway_at(time_s) for time_s in times_s.tolist()])
        assert sways.mean() == pytest.approx(1.0, abs=0.003)
        assert np.abs(sways - 1.0).max() < 0.061
        noises.append(float((10 * np.gradient(sways, times_s)).std()))

    assert 0.08 < np.mean(noises) < 0.2
    assert MEDIAN_STYLE.sway_at(12.3) == 1.0


@pytest.mark.sumo
def test_background_drivers_neither_glide_nor_brake_alike(
    specs: dict[str, Spec], simulate: Callable[[Spec], Trace]
):
    trace = simulate(specs["rsnj_clear_day_dense"])
    background = np.array([1000 < actor.id < 4000 for actor in trace.actors])
    rows = trace.states[background[trace.states["actor"]]]
    accelerations = rows["acceleration"][rows["speed"] > 0.5]

    assert np.mean(accelerations == 0.0) < 0.02
    assert np.mean(np.abs(accelerations) < 0.005) < 0.1
    assert accelerations.min() < -3.5
