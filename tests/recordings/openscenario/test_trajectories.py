"""Trajectories without times are followed at the speed of the entity, forwards and backwards."""

from pathlib import Path

import pytest

from tests.recordings.openscenario.scenarios import (
    at,
    begin,
    change_speed,
    event,
    find_heading,
    find_rear_axle,
    follow,
    maneuver,
    play,
    world,
)

LINE = follow(world(30, 0), world(60, 40))


@pytest.mark.parametrize("speed_m_s", [5.0, 20.0])
def test_a_line_is_followed_at_the_speed_and_left_straight_on(
    speed_m_s: float, tmp_path: Path
) -> None:
    ego = play(tmp_path, init=begin("Ego", world(30, 0), speed_m_s, LINE), end_s=12)["Ego"]

    # The line is 50 m long and leads 3 m east for 4 m north.
    covered_m = speed_m_s * 12
    assert find_rear_axle(ego, 1.0)[0] == pytest.approx([30 + 0.6 * speed_m_s, 0.8 * speed_m_s])
    assert find_rear_axle(ego, 12.0)[0] == pytest.approx([30 + 0.6 * covered_m, 0.8 * covered_m])


def test_one_that_comes_back_to_the_begin_of_its_line_goes_on_backwards(tmp_path: Path) -> None:
    events = (event(change_speed(-5), at(4)),)
    init = begin("Ego", world(30, 0), 5, LINE)
    ego = play(tmp_path, maneuver("Ego", *events), init=init, end_s=9.5)["Ego"]

    places = find_rear_axle(ego, 4.0, 8.0, 9.5).ravel()
    assert places == pytest.approx([42, 16, 30, 0, 30 - 4.5, -6], abs=0.01)
    assert find_heading(ego, 9.0) == pytest.approx(find_heading(ego, 3.0))
