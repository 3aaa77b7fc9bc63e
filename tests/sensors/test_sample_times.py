"""When sensors with clocks of their own sample."""

import numpy as np
import pytest
from advercity_dsl.sampling import Sampled

from advercity.sensors.sample_times import SampleTimes, list_sample_times


def list_frames(sensor: Sampled, *, tick_s: float = 0.1, frames: int = 40) -> list[SampleTimes]:
    return [list_sample_times(sensor, tick_s, frame, key=("clock",)) for frame in range(frames)]


def gather(found: list[SampleTimes], tick_s: float = 0.1) -> tuple[np.ndarray, np.ndarray]:
    """Numbers and times of all samples of successive frames."""
    numbers = [np.arange(one.first, one.first + len(one.fractions)) for one in found]
    times = [(frame - 1 + one.fractions) * tick_s for frame, one in enumerate(found)]
    return np.concatenate(numbers), np.concatenate(times)


def test_a_sensor_without_a_rate_samples_with_every_frame() -> None:
    numbers, times = gather(list_frames(Sampled()))
    np.testing.assert_array_equal(numbers, np.arange(40))
    np.testing.assert_allclose(times, np.arange(40) * 0.1)


@pytest.mark.parametrize("rate_hz", [100.0, 125.0, 10.0, 7.0, 4.0, 1.0, 33.3])
@pytest.mark.parametrize("jitter_ms", [0.0, 2.0])
def test_every_sample_belongs_to_one_frame(rate_hz: float, jitter_ms: float) -> None:
    sensor = Sampled(rate_hz=rate_hz, offset_ms=13, jitter_ms=jitter_ms)
    numbers, times = gather(list_frames(sensor))
    np.testing.assert_array_equal(np.diff(numbers), 1)
    assert numbers[0] >= 0
    assert (np.diff(times) > 0).all()
    periods = (times - 0.013) * rate_hz
    late_s = (periods - np.round(periods)) / rate_hz
    if jitter_ms:
        assert np.abs(late_s).max() <= 0.45 / rate_hz + 1e-9
        if rate_hz < 20:
            assert 0.0 < late_s.std() < 0.005
    else:
        np.testing.assert_allclose(late_s, 0, atol=1e-9)


def test_jitter_has_its_standard_deviation() -> None:
    sensor = Sampled(rate_hz=10, jitter_ms=4)
    _, times = gather(list_frames(sensor, frames=1500))
    late_s = times - np.round(times * 10) / 10
    assert late_s.std() == pytest.approx(0.004, rel=0.06)


def test_a_sample_at_the_instant_of_a_frame_belongs_to_it() -> None:
    found = list_frames(Sampled(rate_hz=10))
    assert {len(one.fractions) for one in found} == {1}
    assert {float(one.fractions[0]) for one in found} == {1.0}
