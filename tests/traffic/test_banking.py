"""Vehicles roll with the lane beneath them."""

from pathlib import Path

import numpy as np
import pytest

from advercity.traffic.banking import build_lean
from advercity.traffic.body_states import BodyCurves
from tests.roads.opendrive_maps import cubic, declare, import_text, lane, road, section

TICK_S, SPEED_M_S = 0.1, 20.0


def drive(x_m: np.ndarray, y_m: float, yaw: float, pitch: float = 0.0) -> BodyCurves:
    """Move upright along the x axis at the height of a reference line at 0 m."""
    still = np.zeros(len(x_m))
    moves = [x_m + 1j * y_m, still + SPEED_M_S * np.exp(1j * yaw), still]
    plan = np.array(moves, dtype=np.complex128)
    return BodyCurves(
        plan=plan,
        height=np.zeros((3, len(x_m))),
        yaw=np.stack([still + yaw, still]),
        pitch=np.stack([still + pitch, still]),
        roll=np.zeros((2, len(x_m))),
    )


def import_banked(folder: Path, *profile: str, rule: str = "RHT") -> object:
    lateral = f"<lateralProfile>{''.join(profile)}</lateralProfile>"
    lanes = section(0.0, lane(1, "driving", 4.0), lane(-1, "driving", 4.0))
    text = road("1", 400.0, lanes, before_lanes=lateral, attributes=f'rule="{rule}"')
    return declare(import_text(folder, text))


@pytest.mark.parametrize("angle", [0.08, -0.03, 0.12])
@pytest.mark.parametrize("yaw", [0.0, np.pi])
def test_a_vehicle_has_the_roll_of_its_road(angle: float, yaw: float, tmp_path: Path) -> None:
    described = import_banked(tmp_path, cubic("superelevation", 0.0, angle))
    lean = build_lean(described, TICK_S)  # type: ignore[arg-type]
    side = -2.0 if yaw == 0.0 else 2.0
    upright = drive(np.linspace(100.0, 200.0, 51), side * np.cos(angle), yaw)
    upright.height[0] += side * np.sin(angle)
    leaned = lean(upright)
    np.testing.assert_allclose(leaned.roll[0], angle * np.cos(yaw), atol=1e-3)
    np.testing.assert_allclose(leaned.height, upright.height, atol=2e-3)


def test_a_vehicle_beside_the_middle_of_its_lane_stands_on_it(tmp_path: Path) -> None:
    described = import_banked(tmp_path, cubic("superelevation", 0.0, 0.1))
    lean = build_lean(described, TICK_S)  # type: ignore[arg-type]
    upright = drive(np.linspace(100.0, 200.0, 51), -2.0 * np.cos(0.1) - 1.2, 0.0)
    upright.height[0] -= 2.0 * np.sin(0.1)
    np.testing.assert_allclose(
        lean(upright).height[0], upright.height[0] - 1.2 * np.tan(0.1), atol=3e-3
    )


def test_roll_changes_at_the_rate_of_the_transition(tmp_path: Path) -> None:
    grows = cubic("superelevation", 0.0), cubic("superelevation", 100.0, 0.0, 0.001)
    described = import_banked(tmp_path, *grows, cubic("superelevation", 180.0, 0.08))
    lean = build_lean(described, TICK_S)  # type: ignore[arg-type]
    x_m = np.arange(50.0, 250.0, SPEED_M_S * TICK_S)
    leaned = lean(drive(x_m, -2.0, 0.0))
    middle, rate = np.interp([60.0, 140.0, 230.0], x_m, leaned.roll[0]), leaned.roll[1]
    np.testing.assert_allclose(middle, [0.0, 0.04, 0.08], atol=2e-3)
    assert np.interp(140.0, x_m, rate) == pytest.approx(0.001 * SPEED_M_S, rel=0.05)
    assert np.interp([60.0, 230.0], x_m, rate) == pytest.approx([0.0, 0.0], abs=1e-3)


def test_a_pitched_vehicle_rolls_about_its_own_axis(tmp_path: Path) -> None:
    described = import_banked(tmp_path, cubic("superelevation", 0.0, 0.1))
    lean = build_lean(described, TICK_S)  # type: ignore[arg-type]
    leaned = lean(drive(np.linspace(100.0, 200.0, 51), -2.0, 0.0, pitch=0.3))
    np.testing.assert_allclose(np.tan(leaned.roll[0]), np.tan(0.1) * np.cos(0.3), atol=1e-3)


def test_vehicles_of_a_level_road_stay_upright(tmp_path: Path) -> None:
    described = import_banked(tmp_path, cubic("superelevation", 0.0, 0.0))
    upright = drive(np.linspace(100.0, 200.0, 51), -2.0, 0.0)
    lean = build_lean(described, TICK_S)  # type: ignore[arg-type]
    assert lean(upright) is upright
