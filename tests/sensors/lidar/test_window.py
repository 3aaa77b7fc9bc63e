"""Water and dirt on a LiDAR's window, seen from all headings and by all kinds of scanner."""

import math

import numpy as np
import pytest
from advercity_dsl import Lidar
from hypothesis import given, settings
from hypothesis import strategies as st

from advercity.sensors.lidar.beams import ScanTime, beam_directions
from advercity.sensors.lidar.conditions import NUM_WINDOW_SECTORS, LidarWindow
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
ANGLE_RAD = st.floats(-math.pi, math.pi)


@pytest.mark.parametrize("name", SCANNERS)
@given(front=FRACTION, side=FRACTION, rear=FRACTION, yaw_rad=ANGLE_RAD, time_s=st.floats(0, 100))
@settings(max_examples=25)
def test_a_beam_loses_light_by_its_direction_from_the_carriers_front(
    name: str, front: float, side: float, rear: float, yaw_rad: float, time_s: float
) -> None:
    lidar, time = SCANNERS[name], ScanTime(time_s)
    window = LidarWindow.from_lidar(lidar, time, (front, side, rear), yaw_rad)
    assert window is not None

    ahead, left, _ = beam_directions(lidar, time).T.astype(float)
    bearing = np.arctan2(left, ahead)
    off_front_deg = np.degrees(np.abs(np.angle(np.exp(1j * (bearing + yaw_rad)))))
    covered = np.where(off_front_deg < 45, front, np.where(off_front_deg < 135, side, rear))
    # A sector of one degree has one coverage.
    clear_of_limits = (np.abs(off_front_deg - 45) > 1) & (np.abs(off_front_deg - 135) > 1)
    # A window fully covered takes 30 % of the light on the way out, and again on the way back.
    np.testing.assert_allclose(
        window.gain[clear_of_limits], ((1 - 0.3 * covered) ** 2)[clear_of_limits], rtol=1e-5
    )
    # Beams of one sector are within its degree.
    middle = np.radians(window.sector + 0.5)
    assert np.abs(np.angle(np.exp(1j * (bearing - middle)))).max() < math.radians(0.5) + 1e-5


@given(share=st.floats(0.01, 0.6), seed=st.integers(0, 1000))
@settings(max_examples=10)
def test_drops_block_sectors_with_twice_the_covered_fraction(share: float, seed: int) -> None:
    window = LidarWindow.from_lidar(SPINNING, ScanTime(0.0), (share, share, share))
    assert window is not None
    uniform = np.random.default_rng(seed).random(NUM_WINDOW_SECTORS)
    blocked = ~window.find_clear_beams(uniform)
    assert (blocked == (uniform < 2 * share)[window.sector]).all()


def test_a_clean_window_is_none() -> None:
    assert LidarWindow.from_lidar(SPINNING, ScanTime(0.0), (0, 0, 0)) is None
    for coverage in ((0.1, 0, 0), (0, 0.1, 0), (0, 0, 0.1)):
        assert LidarWindow.from_lidar(SPINNING, ScanTime(0.0), coverage) is not None
