"""Actors move as speeds, lanes and ends of roads have it, step by step."""

import math
from pathlib import Path

import numpy as np
import pytest

from advercity.foreign.ledger import describe_left_out
from advercity.recordings.openscenario.scenario import read_scenario
from tests.recordings.openscenario.scenarios import (
    EGO_AT_20,
    at,
    begin,
    change_lane,
    change_speed,
    event,
    find_heading,
    find_rear_axle,
    maneuver,
    play,
)

AT_200 = EGO_AT_20.replace("20", "200")


@pytest.mark.parametrize("speed_m_s", [0.5, 10.0, -10.0])
def test_an_initial_speed_is_kept(speed_m_s: float, tmp_path: Path) -> None:
    ego = play(tmp_path, init=begin("Ego", AT_200, speed_m_s))["Ego"]

    x = find_rear_axle(ego, 0.0, 4.0, 10.0)[:, 0]
    assert x == pytest.approx([200, 200 + 4 * speed_m_s, 200 + 10 * speed_m_s])
    assert ego.headings_rad == pytest.approx(0.0)


def test_one_that_drives_back_looks_ahead(tmp_path: Path) -> None:
    events = (
        event(change_speed(-8, "sinusoidal", "time", 4), at(1)),
        event(change_lane(1, "cubic"), at(6)),
    )
    ego = play(tmp_path, maneuver("Ego", *events), init=begin("Ego", AT_200, 8), end_s=12)["Ego"]

    # It is as far ahead at 5 s as at 1 s, and then drives back 7 s.
    assert find_rear_axle(ego, 1.0, 5.0, 12.0)[:, 0] == pytest.approx([208, 208, 152], abs=0.5)
    # Its front points away from the lane into which its rear moves, with 3.5 m / 4 s * 1.5.
    slope = -math.asin(1.5 * 3.5 / 4 / 8)
    assert find_heading(ego, 8.0) == pytest.approx(slope, abs=0.01)
    assert find_heading(ego, 11.0) == pytest.approx(0.0)
    assert find_rear_axle(ego, 11.0)[0, 1] == pytest.approx(1.75)


def test_one_that_stands_does_not_turn(tmp_path: Path) -> None:
    events = event(change_lane(1, "linear", amount=10), at(1)), event(change_speed(0), at(4))
    ego = play(tmp_path, maneuver("Ego", *events), init=begin("Ego", AT_200, 2))["Ego"]

    assert find_heading(ego, 3.0) == pytest.approx(math.asin(0.35 / 2), abs=1e-3)
    assert find_heading(ego, 8.0) == pytest.approx(find_heading(ego, 3.9))


def test_an_actor_stops_where_the_road_ends_and_that_is_listed(tmp_path: Path) -> None:
    begins = begin("Ego", EGO_AT_20.replace("20", "350"), 10)
    ego = play(tmp_path, init=begins)["Ego"]

    assert find_rear_axle(ego, 4.0, 10.0)[:, 0] == pytest.approx([390, 400], abs=0.5)
    assert np.diff(ego.places[ego.times_s > 5.1], axis=0) == pytest.approx(0.0)
    left_out = describe_left_out(read_scenario(tmp_path / "crash.xosc").left_out)
    assert "1 end of a road at which an actor stops" in left_out
