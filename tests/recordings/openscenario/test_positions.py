"""Places of every kind are where hand-drawn ones are."""

import math
from pathlib import Path

import pytest

from tests.recordings.openscenario.scenarios import (
    begin,
    find_heading,
    find_rear_axle,
    play,
    write_opposite_roads,
)

EGO = begin("Ego", '<LanePosition roadId="1" laneId="-1" s="50" offset="0.25"/>', 10.0)
AHEAD = '<Orientation type="relative" h="0"/>'


@pytest.mark.parametrize(
    ("place", "expected"),
    {
        # Lanes lead east and west, 1.75 m beside y = 0; Ego is at (50, -1.5), and looks east. What
        # is relative to it has its left and its heading.
        '<WorldPosition x="7" y="3" h="1"/>': (7, 3, 1),
        '<LanePosition roadId="1" laneId="1" s="0"/>': (0, 1.75, math.pi),
        '<LanePosition roadId="1" laneId="-1" s="200" offset="-1"/>': (200, -2.75, 0),
        '<LanePosition roadId="2" laneId="1" s="150"/>': (250, -1.75, 0),
        '<RoadPosition roadId="1" s="30" t="5"/>': (30, 5, 0),
        '<RoadPosition roadId="2" s="30" t="5"/>': (370, -5, math.pi),
        '<RelativeWorldPosition entityRef="Ego" dx="4" dy="-2"/>': (54, -3.5, 0),
        '<RelativeObjectPosition entityRef="Ego" dx="-4" dy="2"/>': (46, 0.5, 0),
        '<RelativeRoadPosition entityRef="Ego" ds="100" dt="3"/>': (150, 1.5, 0),
        '<RelativeLanePosition entityRef="Ego" dLane="0" ds="-20"/>': (30, -1.75, 0),
        '<RelativeLanePosition entityRef="Ego" dLane="0" dsLane="200" offset="0.5"/>': (
            250,
            -1.25,
            0,
        ),
        f'<RelativeLanePosition entityRef="Ego" dLane="1" ds="5">{AHEAD}</RelativeLanePosition>': (
            55,
            1.75,
            0,
        ),
    }.items(),
)
def test_a_place_is_found(place: str, expected: tuple[float, float, float], tmp_path: Path) -> None:
    x, y, heading = expected
    init = EGO + begin("Other", place, 0.0)
    other = play(tmp_path, init=init, end_s=2, streets=write_opposite_roads())["Other"]

    assert find_rear_axle(other, 1.0)[0] == pytest.approx([x, y], abs=1e-6)
    turned = math.remainder(find_heading(other, 1.0) - heading, 2 * math.pi)
    assert turned == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(("turn", "follows"), [(0.0, True), (0.7, True), (0.9, False)])
def test_who_is_turned_across_a_lane_leaves_it(turn: float, follows: bool, tmp_path: Path) -> None:
    """Turned by more than an eighth of a circle it drives where it faces."""
    orientation = f'<Orientation type="relative" h="{turn}"/>'
    place = f'<LanePosition roadId="1" laneId="-1" s="50">{orientation}</LanePosition>'
    init = EGO + begin("Other", place, 5.0)
    other = play(tmp_path, init=init, end_s=2, streets=write_opposite_roads())["Other"]

    heading = 0.0 if follows else turn
    expected = [50 + 10 * math.cos(heading), -1.75 + 10 * math.sin(heading)]
    assert find_rear_axle(other, 2.0)[0] == pytest.approx(expected, abs=0.05)
