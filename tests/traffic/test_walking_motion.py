"""People walk as SUMO's do, but neither hop nor spin."""

import numpy as np
import pytest

from advercity.traffic.walking_motion import compute_walker_states
from tests.traffic.front_tracks import track


def test_people_neither_hop_nor_spin():
    hopping = np.where(np.arange(90) < 20, 0.0, 2.0)
    yaw = np.where(np.arange(90) < 40, 0.0, np.pi)
    along = 0.1 * (40 - np.abs(np.arange(90.0) - 40))

    states = compute_walker_states(
        track(x=along, y=hopping, yaw=yaw, speed=np.ones(90)),
        0.4,
        speed_m_s=1.0,
        tick_s=0.1,
        kerb_height=lambda places: np.where(places.real < 1.5, 0.15, 0.0),
    )

    steps = np.hypot(np.diff(states["x"]), np.diff(states["y"]))
    assert steps.max() <= 0.13 + 1e-9
    # A half turn within 14 ticks.
    assert np.abs(states["yaw_rate"]).max() <= np.pi / 1.4 + 0.3
    assert abs(states["yaw"][-1] % (2 * np.pi)) == pytest.approx(np.pi, abs=0.05)
    assert (states["z"][0], states["z"].min()) == (
        pytest.approx(0.15),
        pytest.approx(0.0, abs=0.01),
    )
    assert states["y"][60] == pytest.approx(2.0, abs=0.1)


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


def test_a_person_on_a_slope_is_as_high_as_the_ground_under_it():
    along = 0.1 * np.arange(60.0)
    for grade in (0.19, -0.19):
        states = compute_walker_states(
            track(x=along, z=grade * along, speed=np.ones(60)),
            0.5,
            speed_m_s=1.0,
            tick_s=0.1,
            kerb_height=lambda places: np.zeros(len(places)),
        )
        later = slice(20, 45)
        np.testing.assert_allclose(states["z"][later], grade * states["x"][later], atol=1e-9)


def test_who_walks_when_the_record_ends_or_begins_does_not_brake():
    states = compute_walker_states(
        track(x=0.13 * np.arange(60.0), speed=np.full(60, 1.3)),
        0.5,
        speed_m_s=1.3,
        tick_s=0.1,
        kerb_height=lambda places: np.zeros(len(places)),
    )

    np.testing.assert_allclose(states["speed"], 1.3, atol=1e-9)
    np.testing.assert_allclose(states["acceleration"], 0.0, atol=1e-9)
