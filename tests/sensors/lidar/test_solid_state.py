"""LiDARs that scan a field of view ahead instead of turning."""

import math

import numpy as np
import pytest
from advercity_dsl import Lidar
from pydantic import ValidationError

from advercity.geometry.poses import pose_matrix
from advercity.sensors.lidar import ScanTime, beam_directions, cast_scan
from advercity.sensors.measurements import PointKind
from tests.sensors.lidar.builders import (
    STAND,
    VACUUM,
    WALL_AHEAD,
    frame_with,
    measure,
    raycaster_of,
    upright,
    vary,
)

AHEAD = Lidar(
    azimuth_deg=(-60, 60),
    azimuths=601,
    channels=16,
    lower_deg=1,
    upper_deg=16,
    sunlight_noise=False,
    detection="step",
)


@pytest.mark.parametrize(("first", "last"), [(-60, 60), (-5, 7), (150, 179), (-179, 180)])
def test_rows_and_columns_fill_the_field_of_view(first: float, last: float) -> None:
    lidar = vary(AHEAD, azimuth_deg=(first, last))
    ahead, left, up = beam_directions(lidar).reshape(601, 16, 3).astype(float).transpose(2, 0, 1)
    wide = np.degrees(np.unwrap(np.arctan2(left, ahead), axis=0))
    np.testing.assert_allclose(
        wide - wide[0], np.linspace(0, last - first, 601)[:, None] * np.ones(16), atol=1e-3
    )
    np.testing.assert_allclose(wide[0] % 360, first % 360, atol=1e-3)
    np.testing.assert_allclose(np.degrees(np.arcsin(up[7])), np.linspace(1, 16, 16), atol=1e-3)


def test_it_sees_what_is_ahead_alone() -> None:
    around = raycaster_of(WALL_AHEAD, upright(-20.0, 400.0, 60.0))
    found = measure(AHEAD, cast_scan(AHEAD, STAND, around), **VACUUM)
    assert len(found.points) == 601 * 16
    np.testing.assert_allclose(found.points[:, 0], 20.0, atol=1e-3)
    assert np.abs(found.points[:, 1]).max() == pytest.approx(20 * math.tan(math.pi / 3), rel=1e-3)


def test_columns_pass_from_the_right_to_the_left_in_a_period() -> None:
    lidar = vary(AHEAD, motion_distortion=True)
    before = pose_matrix((-2.0, 0, 1.9))
    scan = cast_scan(
        lidar,
        STAND,
        raycaster_of(WALL_AHEAD),
        previous_world_from_lidar=before,
        time=ScanTime(3, 0.05),
    )
    found = measure(lidar, scan, **VACUUM)
    right = found.points[:, 1] == found.points[:, 1].min()
    assert found.time_s[right] == pytest.approx(-0.05, abs=1e-6)
    assert found.raw[right, 0] == pytest.approx(22.0, abs=0.01)
    np.testing.assert_allclose(found.points[:, 0], 20.0, atol=0.01)
    assert (np.diff(found.time_s) >= 0).all()


def test_fog_spray_and_its_window_are_in_its_field_of_view() -> None:
    caster = raycaster_of(WALL_AHEAD)
    spraying = frame_with((12.0, 0.0), speed_m_s=25.0)
    caster.place(spraying)
    scan = cast_scan(AHEAD, STAND, caster)
    wet = {
        "fog": {"mor_m": 30},
        "surface": {"wetness": 1, "puddle_coverage": 0.2},
        "lens": {"enabled": True, "coverage": {"front": 0.3, "side": 0.2, "rear": 0.1}},
    }
    found = measure(AHEAD, scan, **wet)
    assert (found.kind == PointKind.FOG).sum() > 100
    bearing = np.degrees(np.arctan2(found.points[:, 1], found.points[:, 0]))
    assert np.abs(bearing).max() == pytest.approx(60, abs=1)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"azimuth_deg": (60, -60)}, "goes from 60 to -60 deg"),
        ({"azimuth_deg": (-180, 180)}, "less than a turn apart"),
        ({"azimuth_deg": (5, 5)}, "goes from 5 to 5 deg"),
        ({"azimuth_deg": (-190, 0)}, "greater than or equal to -180"),
    ],
)
def test_no_field_of_view_is_refused(fields: dict[str, object], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        Lidar.model_validate(fields)


def test_prisms_have_a_field_of_view_of_their_own() -> None:
    prisms = {"first_deg": 9, "second_deg": 9, "first_rpm": 7000, "second_rpm": -4000}
    with pytest.raises(ValidationError, match="so are prisms"):
        Lidar.model_validate({"prisms": prisms, "azimuth_deg": (-30, 30)})
