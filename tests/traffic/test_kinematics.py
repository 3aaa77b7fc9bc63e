"""Bodies follow their front bumpers; people neither hop nor spin."""

import numpy as np
import pytest

from advercity.frames import FRONT_DTYPE, Lamp
from advercity.traffic.kinematics import compute_vehicle_states, compute_walker_states


def track(**columns: np.ndarray) -> np.ndarray:
    fronts = np.zeros(len(next(iter(columns.values()))), dtype=FRONT_DTYPE)
    fronts["tick"] = np.arange(len(fronts))
    for name, column in columns.items():
        fronts[name] = column
    return fronts


def test_a_body_on_a_slope_hangs_between_its_bumpers():
    slope, along = np.arctan(0.1), np.arange(0.0, 20.0)
    climbing = track(x=along, z=0.1 * along, slope=np.full(20, slope), speed=np.full(20, 10.0))

    states = compute_vehicle_states(climbing, 4.0, tick_s=0.1)

    np.testing.assert_allclose(states["x"], along - 2.0, atol=0.02)
    np.testing.assert_allclose(states["z"], 0.1 * (along - 2.0), atol=0.005)
    np.testing.assert_allclose(states["pitch"], -slope, rtol=0.01)


def test_a_body_noses_over_a_crest_when_its_front_does():
    along = np.arange(0.0, 20.0)
    over = track(x=along, z=-np.maximum(along - 10.0, 0.0) * 0.1, speed=np.full(20, 10.0))

    states = compute_vehicle_states(over, 4.0, tick_s=0.1)

    # With axles 0.8 and 3.2 m behind the front, the front one is 1.2 m past the crest at tick 12.
    np.testing.assert_allclose(states["pitch"][:11], 0.0, atol=1e-12)
    assert states["pitch"][12] == pytest.approx(np.arcsin(0.12 / 2.4))
    assert states["z"][12] == pytest.approx(-0.06)


def test_a_stationary_vehicle_neither_slides_nor_turns():
    sliding = track(y=0.05 * np.arange(20.0), yaw=0.1 * np.arange(20.0))

    states = compute_vehicle_states(sliding, 4.0, tick_s=0.1)

    np.testing.assert_allclose(states["x"], -2.0)
    np.testing.assert_allclose(states["y"], 0.0)
    np.testing.assert_allclose(states["yaw"], 0.0)


def test_brake_lamps_say_whether_the_brakes_are_on():
    acceleration = np.array([0.0] * 5 + [-2.0] * 10 + [0.0] * 5 + [1.0] * 5)
    speed = np.array([10.0] * 5 + [5.0] * 10 + [0.0] * 5 + [0.1, 0.2, 0.3, 0.4, 0.5])
    moving = track(acceleration=acceleration, speed=speed, lamps=np.full(25, Lamp.LEFT))

    lamps = compute_vehicle_states(moving, 4.0, tick_s=0.1)["lamps"]

    assert (lamps & Lamp.LEFT > 0).all()
    # The mean over five ticks passes -0.3 m/s² two ticks before it brakes, and 0.3 one tick before
    # it moves off.
    assert (lamps & Lamp.BRAKE > 0).tolist() == [False] * 3 + [True] * 16 + [False] * 6


def test_people_neither_hop_nor_spin():
    hopping = np.where(np.arange(60) < 20, 0.0, 2.0)
    yaw = np.where(np.arange(60) < 40, 0.0, np.pi)

    states = compute_walker_states(
        track(x=0.1 * np.arange(60.0), y=hopping, yaw=yaw),
        0.4,
        speed_m_s=1.0,
        tick_s=0.1,
        kerb_height=lambda places: np.where(places.real < 3.0, 0.15, 0.0),
    )

    steps = np.hypot(np.diff(states["x"]), np.diff(states["y"]))
    assert steps.max() <= 0.13 + 1e-9
    np.testing.assert_allclose(states["speed"][1:], steps / 0.1)
    assert np.abs(np.diff(states["yaw"])).max() <= np.pi * 0.1 + 1e-9
    assert (states["z"][0], states["z"][-1]) == (pytest.approx(0.15), 0.0)
    assert states["y"][50] == pytest.approx(2.0, abs=0.05)


def test_a_stationary_pedestrian_keeps_its_heading():
    states = compute_walker_states(
        track(x=np.zeros(10), yaw=np.full(10, 1.0)),
        0.4,
        speed_m_s=1.0,
        tick_s=0.1,
        kerb_height=lambda places: np.zeros(len(places)),
    )

    np.testing.assert_allclose(states["yaw"], 1.0)
    np.testing.assert_allclose(states["speed"], 0.0)
