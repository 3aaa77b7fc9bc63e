"""Bodies of vehicles follow their front bumpers."""

import numpy as np
import pytest

from advercity.frames import Lamp
from advercity.traffic.vehicle_motion import compute_vehicle_states
from tests.traffic.front_tracks import track


def test_a_body_on_a_slope_hangs_between_its_bumpers():
    slope, along = np.arctan(0.1), np.arange(0.0, 20.0)
    climbing = track(x=along, z=0.1 * along, slope=np.full(20, slope), speed=np.full(20, 10.0))

    states = compute_vehicle_states(climbing, 4.0, tick_s=0.1)

    np.testing.assert_allclose(states["x"], along - 2.0, atol=0.02)
    np.testing.assert_allclose(states["z"], 0.1 * (along - 2.0), atol=0.005)
    np.testing.assert_allclose(states["pitch"], -slope, rtol=0.01)


def test_a_body_noses_over_a_crest_when_its_front_does():
    along = 0.1 * np.arange(300.0)
    over = track(x=along, z=-np.maximum(along - 10.0, 0.0) * 0.1, speed=np.full(300, 1.0))

    states = compute_vehicle_states(over, 12.0, tick_s=0.1)

    # With axles 2.4 and 9.6 m behind the front, the front one is 3.6 m past the crest at tick 160.
    # Springs even out the crest over 3 m on both sides.
    np.testing.assert_allclose(states["pitch"][:94], 0.0, atol=1e-12)
    assert states["pitch"][160] == pytest.approx(np.arctan(0.36 / 7.2))
    assert states["z"][160] == pytest.approx(-0.18)
    assert states["pitch"][230] == pytest.approx(np.arctan(0.1))


def test_a_stationary_vehicle_neither_slides_nor_turns():
    sliding = track(y=0.05 * np.arange(20.0), yaw=0.1 * np.arange(20.0))

    states = compute_vehicle_states(sliding, 4.0, tick_s=0.1)

    np.testing.assert_allclose(states["x"], -2.0)
    np.testing.assert_allclose(states["y"], 0.0)
    np.testing.assert_allclose(states["yaw"], 0.0)


def drive(*parts: tuple[float, int]) -> np.ndarray:
    """A straight drive from 10 m/s with accelerations held for some ticks each."""
    speed = 10 + 0.1 * np.cumsum(np.repeat([part for part, _ in parts], [n for _, n in parts]))
    return track(x=0.1 * np.cumsum(speed), speed=speed, lamps=np.full(len(speed), Lamp.LEFT))


def test_brake_lamps_say_whether_the_brakes_are_on():
    braking = drive((0.0, 30), (-2.0, 50), (0.0, 30), (1.0, 30))

    lamps = compute_vehicle_states(braking, 4.0, tick_s=0.1)["lamps"]

    assert (lamps & Lamp.LEFT > 0).all()
    lit = np.flatnonzero(lamps & Lamp.BRAKE)
    # Changes are spread over 1.4 s, so that the brakes come on up to 0.7 s before full braking.
    assert 22 <= lit[0] <= 30
    assert 100 <= lit[-1] <= 110
    assert len(lit) == lit[-1] - lit[0] + 1


def test_a_change_of_acceleration_is_spread_so_that_jerk_stays_bearable():
    states = compute_vehicle_states(drive((2.5, 40), (-3.0, 40)), 4.0, tick_s=0.1)

    jerk = np.diff(states["acceleration"]) / 0.1
    # 5.5 m/s² over 1.4 s.
    assert np.abs(jerk[20:60]).max() == pytest.approx(5.5 / 1.4, rel=1e-6)
    assert states["acceleration"][20] == pytest.approx(2.5)
    assert states["acceleration"][60] == pytest.approx(-3.0)
    # Where acceleration is steady, the mean of positions around is ahead by half of it times the
    # variance of the weights: (14² + 4² - 2)/12 + 2/6 ticks².
    lag_m = 2.5 / 2 * ((14**2 + 4**2 - 2) / 12 + 2 / 6) * 0.01
    assert states["x"][20] - drive((2.5, 40))["x"][20] == pytest.approx(lag_m - 2.0, abs=1e-6)


def test_an_emergency_stop_is_sharp_and_changes_nothing_before_and_after_it():
    stop = drive((2.5, 40), (-7.0, 20), (0.0, 40))

    states = compute_vehicle_states(stop, 4.0, tick_s=0.1)

    # Down to -3.1 m/s² over 1.4 s, and by what an emergency adds over 0.6 s.
    jerk = np.diff(states["acceleration"]) / 0.1
    assert np.abs(jerk[20:50]).max() == pytest.approx(5.6 / 1.4 + 3.9 / 0.6, rel=1e-6)
    assert states["acceleration"][20:].max() == pytest.approx(2.5)
    assert states["acceleration"].min() == pytest.approx(-7.0)
    np.testing.assert_allclose(states["x"][75:], stop["x"][75:] - 2.0, atol=1e-9)
    gentle = compute_vehicle_states(drive((2.5, 40)), 4.0, tick_s=0.1)
    np.testing.assert_allclose(states["x"][:29], gentle["x"][:29], atol=1e-9)


def test_single_ticks_of_hard_braking_are_no_emergency():
    doubts = drive((-3.0, 20), (2.5, 2), (-6.0, 3), (2.5, 1), (-7.0, 1), (2.5, 30))

    states = compute_vehicle_states(doubts, 4.0, tick_s=0.1)

    jerk = np.diff(states["acceleration"]) / 0.1
    assert np.abs(jerk).max() < 5.0
    assert states["acceleration"].min() > -3.1


def test_a_body_turns_and_moves_as_its_derivatives_say():
    angle = 0.05 * np.arange(120.0)
    bend = track(
        x=10 * np.sin(angle), y=10 - 10 * np.cos(angle), speed=np.full(120, 5.0), z=0.02 * angle
    )

    states = compute_vehicle_states(bend, 4.0, tick_s=0.1)

    # A steady circle: the rear axle is on a smaller one than the front axle, the middle between.
    rate, speed = states["yaw_rate"][60:110], states["speed"][60:110]
    np.testing.assert_allclose(rate, 0.5, atol=1e-3)
    east, north = states["ax"][60:110], states["ay"][60:110]
    np.testing.assert_allclose(np.hypot(east, north), rate * speed, rtol=1e-3)
    radius = speed / rate
    np.testing.assert_allclose(
        np.tan(states["steering"][60:110]), 2.4 / np.sqrt(radius**2 - 1.2**2), rtol=1e-3
    )
