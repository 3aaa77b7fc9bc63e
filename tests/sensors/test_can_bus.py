"""Signals of a vehicle's bus, against circles that a kinematic bicycle drives."""

import math
from dataclasses import replace

import numpy as np
import pytest
from advercity_dsl.can_bus import CanBus
from scipy import stats

from advercity.frames import ActorState, BodyMotion, Lamp
from advercity.geometry.poses import pose_matrix
from advercity.sensors.can_bus import sample_can_bus
from advercity.sensors.measurements import CanSample, Indicator
from advercity.testing import make_actor_state

EXACT = CanBus(
    wheel_speed_step_km_h=0,
    tyre_error=0,
    steering_step_deg=0,
    steering_offset_deg=0,
    yaw_rate_step_deg_s=0,
    yaw_rate_offset_deg_s=0,
)
LENGTH_M, WIDTH_M = 5.0, 1.8
WHEELBASE_M, TRACK_M = 3.0, 0.86 * WIDTH_M


def drive_circle(radius_m: float, speed_m_s: float, lamps: Lamp | None = None) -> ActorState:
    """On a left circle of the rear axle's radius, at the rear axle's speed; to the north-east."""
    rate = speed_m_s / radius_m
    pose = pose_matrix((1, 2, 0), yaw=math.pi / 4)
    # The body's origin is half a wheelbase ahead of the rear axle.
    velocity = pose[:3, :3] @ [speed_m_s, rate * WHEELBASE_M / 2, 0]
    state = make_actor_state(7, 0.0, size=(LENGTH_M, WIDTH_M, 1.5))
    return replace(
        state,
        world_from_body=pose,
        steering_rad=math.atan(WHEELBASE_M / radius_m),
        lamps=lamps or Lamp(0),
        motion=BodyMotion(velocity, np.zeros(3), np.array([0, 0, rate])),
    )


def sample(
    bus: CanBus, *states: ActorState, frame: int = 3, key: tuple[int | str, ...] = ("car",)
) -> CanSample:
    before, now = states if len(states) == 2 else states * 2
    found = sample_can_bus(bus, (before, now), 0.1, key=key, frame=frame)
    assert found is not None
    return found


def test_wheels_turn_as_fast_as_their_circles_are_long() -> None:
    radius_m, speed = 12.0, 6.0
    found = sample(EXACT, drive_circle(radius_m, speed))
    rear = np.array([radius_m - TRACK_M / 2, radius_m + TRACK_M / 2])
    expected = np.r_[np.hypot(rear, WHEELBASE_M), rear] * speed / radius_m
    np.testing.assert_allclose(found.wheel_speeds_m_s, expected)
    assert found.speed_m_s == pytest.approx(speed)
    assert found.yaw_rate_rad_s == pytest.approx(0.5)
    # Odometry of the rear wheels has the yaw rate, too.
    left, right = found.wheel_speeds_m_s[2:]
    assert (right - left) / TRACK_M == pytest.approx(found.yaw_rate_rad_s)


def test_the_steering_wheel_turns_by_the_ratio_of_the_bicycle_s_angle() -> None:
    found = sample(EXACT, drive_circle(12.0, 6.0))
    assert found.steering_wheel_rad == pytest.approx(15 * math.atan(3 / 12))
    right = sample(EXACT, drive_circle(-12.0, 6.0))
    assert right.steering_wheel_rad == pytest.approx(-found.steering_wheel_rad)


def test_signals_come_in_the_steps_of_their_messages() -> None:
    found = sample(CanBus(tyre_error=0), drive_circle(31.7, 7.123))
    steps = found.wheel_speeds_m_s * 3.6 / 0.01
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)
    angle = math.degrees(found.steering_wheel_rad) / 0.1
    assert angle == pytest.approx(round(angle), abs=1e-6)
    rate = math.degrees(found.yaw_rate_rad_s) / 0.1
    assert rate == pytest.approx(round(rate), abs=1e-6)
    exact = sample(EXACT, drive_circle(31.7, 7.123))
    assert np.abs(found.wheel_speeds_m_s - exact.wheel_speeds_m_s).max() <= 0.005 / 3.6 + 1e-9


def test_vehicles_differ_by_their_tyres_and_zeros() -> None:
    straight = replace(drive_circle(1e9, 10.0), steering_rad=0.0)
    found = [sample(CanBus(), straight, key=(unit,)) for unit in range(1500)]
    speeds = np.array([one.wheel_speeds_m_s for one in found])
    np.testing.assert_allclose(speeds.std(axis=0), 0.05, rtol=0.08)
    zeros = np.degrees([one.steering_wheel_rad for one in found])
    assert zeros.std() == pytest.approx(1.0, rel=0.08)
    again = sample(CanBus(), straight, key=(3,), frame=9)
    np.testing.assert_array_equal(again.wheel_speeds_m_s, speeds[3])


def test_errors_of_vehicles_are_normal_and_independent_of_each_other() -> None:
    """Four tyres, the steering wheel's zero and the yaw rate's: of 1500, 0.13 is five sigma."""
    straight = replace(drive_circle(1e9, 10.0), steering_rad=0.0)
    bus = CanBus(wheel_speed_step_km_h=0, steering_step_deg=0, yaw_rate_step_deg_s=0)
    found = [sample(bus, straight, key=("unit", unit)) for unit in range(1500)]
    errors = np.array(
        [[*one.wheel_speeds_m_s, one.steering_wheel_rad, one.yaw_rate_rad_s] for one in found]
    )
    np.testing.assert_allclose(np.corrcoef(errors.T), np.eye(6), atol=0.13)
    for values in errors.T:
        assert stats.kstest((values - values.mean()) / values.std(), "norm").pvalue > 1e-4


def test_lamps_are_those_of_the_vehicle() -> None:
    cases = {
        Lamp(0): (False, Indicator.OFF),
        Lamp.BRAKE | Lamp.LEFT | Lamp.LOW_BEAM: (True, Indicator.LEFT),
        Lamp.RIGHT: (False, Indicator.RIGHT),
        Lamp.LEFT | Lamp.RIGHT: (False, Indicator.HAZARD),
    }
    for lamps, expected in cases.items():
        found = sample(EXACT, drive_circle(100, 5, lamps))
        assert (found.is_braking, found.indicator) == expected


def test_a_fast_bus_interpolates_between_the_frames() -> None:
    bus = EXACT.model_copy(update={"rate_hz": 50.0})
    found = sample(bus, drive_circle(1e9, 5.0), drive_circle(1e9, 10.0))
    speeds = [one.speed_m_s for one in (*found.earlier, found)]
    np.testing.assert_allclose(speeds, [6, 7, 8, 9, 10])
    np.testing.assert_allclose([one.time_s for one in found.earlier], [-0.08, -0.06, -0.04, -0.02])
