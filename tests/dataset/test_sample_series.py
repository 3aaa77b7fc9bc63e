"""Samples at times of one's own: the nearest, or between two."""

import math

import numpy as np
import pytest

from advercity.dataset.sample_series import SampleSeries, join_fixes, join_imu_samples
from advercity.errors import InputError
from advercity.sensors.measurements import GnssFix, ImuSample

SERIES = SampleSeries(
    np.array([1.0, 2.0, 4.0]),
    {
        "compass_rad": np.radians([350.0, 10.0, 30.0]),
        "angular_rate": np.array([[0.0, 0, 0], [1, 2, 3], [3, 2, 1]]),
        "indicator": np.array(["off", "left", "left"]),
    },
)


def test_the_nearest_sample_is_taken_as_it_is() -> None:
    found = SERIES.nearest([0.0, 1.4, 1.6, 3.1, 9.0])
    np.testing.assert_array_equal(found["angular_rate"][:, 0], [0, 0, 1, 3, 3])
    assert found["indicator"].tolist() == ["off", "off", "left", "left", "left"]


def test_between_samples_values_are_linear_and_headings_go_the_short_way() -> None:
    found = SERIES.interpolate([1.0, 1.75, 3.0])
    np.testing.assert_allclose(found["angular_rate"][1:], [[0.75, 1.5, 2.25], [2, 2, 2]])
    np.testing.assert_allclose(np.degrees(found["compass_rad"]), [350, 5, 20])
    assert found["indicator"].tolist() == ["off", "left", "left"]


def test_nothing_is_made_up_beyond_the_samples_or_in_gaps() -> None:
    outside = SERIES.interpolate([0.9, 4.1])["angular_rate"]
    assert np.isnan(outside).all()
    found = SERIES.interpolate([1.5, 2.0, 3.0, 4.0], max_gap_s=1.0)["compass_rad"]
    np.testing.assert_array_equal(np.isnan(found), [False, False, True, False])


def test_a_heading_that_is_missing_leaves_the_others() -> None:
    headings = np.array([0.1, np.nan, 0.3, 0.5])
    series = SampleSeries(np.arange(4.0), {"heading_rad": headings})
    found = series.interpolate([0.5, 2.5])["heading_rad"]
    assert math.isnan(found[0])
    assert found[1] == pytest.approx(0.4)


def test_a_single_sample_is_nearest_to_everything() -> None:
    one = SampleSeries(np.array([2.0]), {"speed_m_s": np.array([3.0])})
    np.testing.assert_array_equal(one.nearest([0.0, 2.0, 5.0])["speed_m_s"], [3, 3, 3])
    found = one.interpolate([1.0, 2.0])["speed_m_s"]
    assert math.isnan(found[0])
    assert found[1] == 3.0


def test_a_sensor_without_samples_says_so() -> None:
    nothing = join_imu_samples([(0.0, None), (0.1, None)])
    assert len(nothing) == 0
    with pytest.raises(InputError, match="no samples"):
        nothing.interpolate([0.0])


def test_samples_of_frames_follow_each_other_in_time() -> None:
    def make(time_s: float, *earlier: ImuSample) -> ImuSample:
        return ImuSample(np.full(3, time_s), np.zeros(3), 0.0, time_s, earlier)

    found = join_imu_samples(
        [(6.0, make(0.0)), (6.1, None), (6.2, make(-0.02, make(-0.12), make(-0.07)))]
    )
    np.testing.assert_allclose(found.times_s, [6.0, 6.08, 6.13, 6.18])
    np.testing.assert_allclose(found.values["specific_force"][:, 0], [0, -0.12, -0.07, -0.02])
    fixes = join_fixes([(6.0, GnssFix(49.0, 8.0, 100.0, 5.97)), (6.1, None)])
    assert fixes.times_s.tolist() == [5.97]
    assert np.isnan(fixes.values["heading_rad"]).all()
