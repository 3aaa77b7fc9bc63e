"""Random parts of a channel over long times, within the bounds of their sampling errors.

Seeds are fixed, so a test that passes always does; bounds are four standard errors.
"""

import math
from typing import Any

import numpy as np
import pytest
from advercity_dsl import Channel, Spec

from advercity.channel.impairments import ChannelRandomness, draw_burst_switches
from advercity.randomness import create_generator

HOUR_S = 3600.0


def randomness_of(spec: Spec, duration_s: float = HOUR_S, **fields: Any) -> ChannelRandomness:
    channel = Channel.model_validate({"id": "tested", **fields})
    return ChannelRandomness(spec, channel, duration_s=duration_s)


def test_bursts_cover_the_declared_fraction_and_last_as_long_as_declared() -> None:
    """Of n cycles, the means of exponential intervals err by their mean over the root of n."""
    loss = Channel.model_validate({"id": "x", "loss": {"burst_fraction": 0.1, "burst_s": 0.5}}).loss
    starts, switches_s = draw_burst_switches(loss, 20_000.0, create_generator("bursts"))
    lengths_s = np.diff(switches_s)
    # The first interval after the first switch is a burst unless the link began in one.
    bursts, goods = (lengths_s[int(starts) :: 2], lengths_s[1 - int(starts) :: 2])
    count = len(bursts)
    assert count > 3500
    assert bursts.mean() == pytest.approx(0.5, abs=4 * 0.5 / math.sqrt(count))
    assert goods.mean() == pytest.approx(4.5, abs=4 * 4.5 / math.sqrt(count))
    # The spread of an exponential distribution is its mean.
    assert bursts.std() == pytest.approx(0.5, rel=0.1)


def test_a_burst_begins_at_the_same_time_however_long_the_scenario_is() -> None:
    loss = Channel.model_validate({"id": "x", "loss": {"burst_fraction": 0.3}}).loss
    short, long = (
        draw_burst_switches(loss, duration_s, create_generator("bursts"))
        for duration_s in (10.0, 5000.0)
    )
    assert short[0] == long[0]
    np.testing.assert_array_equal(short[1], long[1][: len(short[1])])


def test_links_are_in_bursts_for_the_declared_fraction_in_both_directions(spec: Spec) -> None:
    """The time in bursts has the variance 2 f (1 - f) tau / T; tau is 0.45 s.

    It is 1 / (1 / 0.5 s + 1 / 4.5 s), the correlation time of both intervals together.
    """
    loss = {"rate": 0.0, "burst_fraction": 0.1, "burst_s": 0.5}
    drawn = randomness_of(spec, loss=loss)
    times_s = np.arange(0.0, HOUR_S, 0.1).tolist()
    there, back = (
        np.array([drawn.find_loss_rate(*link, time_s) for time_s in times_s])
        for link in (("cav1", "rsu1"), ("rsu1", "cav1"))
    )
    error = math.sqrt(2 * 0.1 * 0.9 * 0.45 / HOUR_S)
    assert there.mean() == pytest.approx(0.1, abs=4 * error)
    assert back.mean() == pytest.approx(0.1, abs=4 * error)
    assert abs(np.corrcoef(there, back)[0, 1]) < 0.1
    # Any time alone gives what the whole hour gives.
    again = randomness_of(spec, loss=loss)
    assert [again.find_loss_rate("cav1", "rsu1", times_s[k]) for k in (30_000, 7)] == [
        there[30_000],
        there[7],
    ]


def test_poses_err_as_declared_and_wander_slowly(spec: Spec) -> None:
    """White noise of 0.3 m and a wander of 0.4 m are 0.5 m together."""
    error = {"white_noise_m": 0.3, "wander_m": 0.4, "wander_time_s": 1, "vertical_factor": 2}
    error |= {"heading_noise_deg": 0.3, "heading_wander_deg": 0.4}
    drawn = randomness_of(spec, pose_error=error)
    found = [drawn.draw_pose_error("cav1", frame) for frame in range(4000)]
    offsets = np.array([offset for offset, _ in found])
    headings_deg = np.degrees([heading for _, heading in found])
    # 4000 frames of a wander with a correlation time of 10 frames are 200 independent ones.
    tolerance = 4 / math.sqrt(2 * 200)
    assert offsets[:, :2].std(axis=0) == pytest.approx(0.5, rel=tolerance)
    assert offsets[:, 2].std() == pytest.approx(1.0, rel=tolerance)
    assert headings_deg.std() == pytest.approx(0.5, rel=tolerance)
    # After 10 frames: 0.16 exp(-1) of 0.25.
    correlation = np.corrcoef(offsets[:-10, 0], offsets[10:, 0])[0, 1]
    assert correlation == pytest.approx(0.16 * math.exp(-1) / 0.25, abs=0.15)
    assert abs(np.corrcoef(offsets[:, 0], offsets[:, 1])[0, 1]) < 0.2
    again = randomness_of(spec, pose_error=error).draw_pose_error("cav1", 1234)
    np.testing.assert_array_equal(again[0], offsets[1234])


def test_each_error_has_numbers_of_its_own(spec: Spec) -> None:
    level, also_turned = (
        randomness_of(spec, pose_error={"white_noise_m": 0.3, **more}).draw_pose_error("cav1", 5)
        for more in ({}, {"heading_noise_deg": 1})
    )
    np.testing.assert_array_equal(level[0], also_turned[0])
    assert level[1] == 0.0 != also_turned[1]


def test_clocks_of_many_stations_err_as_declared(spec: Spec) -> None:
    drawn = randomness_of(spec, clock={"offset_s": 0.01})
    offsets = np.array([drawn.draw_clock_offset_s(f"cav{number}") for number in range(2000)])
    assert offsets.std() == pytest.approx(0.01, rel=4 / math.sqrt(2 * 2000))
    assert offsets.mean() == pytest.approx(0.0, abs=4 * 0.01 / math.sqrt(2000))


def test_shadowing_has_variance_1_everywhere_and_forgets_over_its_distance(spec: Spec) -> None:
    """Of 400 links: at steps and between them, and 10 m apart, where 1/e is left."""
    drawn = randomness_of(spec, radio={"shadow_decorrelation_m": 10})
    places_m = (50.0, 51.3, 61.3)
    found = np.array(
        [[drawn.draw_shadowing(f"cav{k}", "rsu1", at_m) for at_m in places_m] for k in range(400)]
    )
    assert found.std(axis=0) == pytest.approx(1.0, rel=4 / math.sqrt(2 * 400))
    correlation = np.corrcoef(found[:, 1], found[:, 2])[0, 1]
    assert correlation == pytest.approx(math.exp(-1), abs=4 * (1 - math.exp(-2)) / math.sqrt(400))
    assert drawn.draw_shadowing("rsu1", "cav0", 50.0) == found[0, 0]
    # Half way between two steps of 2.5 m, interpolation alone would leave a deviation of 0.94.
    between = [drawn.draw_shadowing(f"cav{number}", "rsu1", 1.25) for number in range(6000)]
    assert np.std(between) == pytest.approx(1.0, abs=4 / math.sqrt(2 * 6000))


def test_weathers_of_a_road_share_all_draws(specs: dict[str, Spec]) -> None:
    fog, clear, other = (
        randomness_of(specs[name], pose_error={"white_noise_m": 1}).draw_pose_error("cav1", 3)
        for name in ("ui_fog_day_sparse", "ui_clear_night_sparse", "ri_fog_day_sparse")
    )
    np.testing.assert_array_equal(fog[0], clear[0])
    assert (fog[0][:2] != other[0][:2]).all()
