"""Water and dirt on a LiDAR's window, seen from all headings and by all kinds of scanner."""

import math

import numpy as np
import pytest
from advercity_dsl import Lidar
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from advercity.sensors.lidar.beams import ScanTime, beam_directions
from advercity.sensors.lidar.conditions import LidarWindow
from tests.sensors.lidar.builders import vary

SPINNING = Lidar(channels=4, azimuths=720)
SCANNERS = {
    "spinning": SPINNING,
    "field of view": vary(SPINNING, azimuth_deg=(-60, 60)),
    "prisms": Lidar.model_validate(
        {
            "channels": 2,
            "azimuths": 3000,
            "prisms": {"first_deg": 30, "second_deg": 20, "first_rpm": 7294, "second_rpm": -4664},
        }
    ),
}
FRACTION = st.floats(0.02, 0.98)
ANGLE_DEG = st.floats(-180, 180)


@pytest.mark.parametrize("name", SCANNERS)
@given(front=FRACTION, side=FRACTION, rear=FRACTION, yaw_deg=ANGLE_DEG, time_s=st.floats(0, 100))
@settings(max_examples=25)
def test_a_beam_loses_light_by_its_direction_from_the_carriers_front(
    name: str, front: float, side: float, rear: float, yaw_deg: float, time_s: float
) -> None:
    lidar, time = SCANNERS[name], ScanTime(time_s)
    window = LidarWindow.from_lidar(lidar, time, (front, side, rear), ("drops",), yaw_deg)
    assert window is not None

    bearing = find_bearings(lidar, time)
    off_front_deg = np.degrees(np.abs(np.angle(np.exp(1j * (bearing + np.radians(yaw_deg))))))
    covered = np.where(off_front_deg < 45, front, np.where(off_front_deg < 135, side, rear))
    # A sector of one degree has one coverage.
    clear_of_limits = (np.abs(off_front_deg - 45) > 1) & (np.abs(off_front_deg - 135) > 1)
    # A window fully covered takes 30 % of the light on the way out, and again on the way back.
    np.testing.assert_allclose(
        window.gain[clear_of_limits], ((1 - 0.3 * covered) ** 2)[clear_of_limits], rtol=1e-5
    )


@pytest.mark.parametrize("name", SCANNERS)
@given(share=st.floats(0.01, 0.45), more=st.floats(0, 0.05), seed=st.integers(0, 1000))
@settings(max_examples=10)
def test_drops_block_whole_degrees_of_the_window_and_stay(
    name: str, share: float, more: float, seed: int
) -> None:
    lidar, time = SCANNERS[name], ScanTime(1.0)
    windows = [
        LidarWindow.from_lidar(lidar, time, (cover, cover, cover), (seed,))
        for cover in (share, share, share + more)
    ]
    first, again, dirtier = (one.is_clear for one in windows if one is not None)
    np.testing.assert_array_equal(first, again)
    assert not (dirtier & ~first).any()
    degree = np.degrees(find_bearings(lidar, time)) % 360.0
    is_inside = np.abs(degree % 1.0 - 0.5) < 0.49  # rounding may move a beam on a limit
    for sector in np.unique(degree[is_inside].astype(int)):
        assert len(set(first[is_inside & (degree.astype(int) == sector)])) == 1


@given(share=st.floats(0.01, 0.5))
@settings(max_examples=10)
def test_twice_the_covered_fraction_of_sectors_is_blocked(share: float) -> None:
    blocked: list[float] = []
    for seed in range(20):
        window = LidarWindow.from_lidar(SPINNING, ScanTime(0.0), (share, share, share), (seed,))
        assert window is not None
        blocked.append(1.0 - window.is_clear.mean())
    # 20 windows of 360 sectors: four standard deviations.
    spread = math.sqrt(2 * share * (1 - 2 * share) / (20 * 360))
    assert np.mean(blocked) == pytest.approx(2 * share, abs=4 * spread + 1e-9)


def find_bearings(lidar: Lidar, time: ScanTime) -> NDArray[np.float64]:
    ahead, left, _ = beam_directions(lidar, time).T.astype(float)
    return np.arctan2(left, ahead)


def test_a_clean_window_is_none() -> None:
    assert LidarWindow.from_lidar(SPINNING, ScanTime(0.0), (0, 0, 0), ()) is None
    for coverage in ((0.1, 0, 0), (0, 0.1, 0), (0, 0, 0.1)):
        assert LidarWindow.from_lidar(SPINNING, ScanTime(0.0), coverage, ()) is not None
