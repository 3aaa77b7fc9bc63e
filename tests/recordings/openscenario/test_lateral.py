"""Changes of lane lead where they say, in both directions and over several roads."""

from pathlib import Path

import pytest

from advercity.diagnostics import DiagnosticsError
from tests.recordings.openscenario.scenarios import (
    at,
    begin,
    change_lane,
    event,
    find_rear_axle,
    maneuver,
    play,
    write_opposite_roads,
)


@pytest.mark.parametrize(
    ("shape", "dimension", "amount", "middle_s", "end_s"),
    [
        ("linear", "time", 4.0, 3.0, 5.0),
        ("sinusoidal", "time", 2.0, 2.0, 3.0),
        ("cubic", "distance", 40.0, 3.0, 5.0),
        # The rate of a sine is its largest, pi / 2 times the mean.
        ("sinusoidal", "rate", 3.5 * 1.5707963, 1.5, 2.0),
    ],
)
def test_a_lane_change_is_half_way_at_its_middle(
    shape: str, dimension: str, amount: float, middle_s: float, end_s: float, tmp_path: Path
) -> None:
    change = maneuver("Ego", event(change_lane(1, shape, dimension, amount), at(1)))
    begins = begin("Ego", '<LanePosition roadId="1" laneId="-1" s="20"/>', 10.0)
    ego = play(tmp_path, change, init=begins)["Ego"]

    y = find_rear_axle(ego, 1.0, middle_s, end_s)[:, 1]
    assert y == pytest.approx([-1.75, 0.0, 1.75], abs=0.05)


@pytest.mark.parametrize("speed_m_s", [5.0, 25.0])
def test_a_lane_change_goes_on_where_a_road_leads_the_other_way(
    speed_m_s: float, tmp_path: Path
) -> None:
    # The boundary is reached half-way, at 4 s; lane -1 of road 1 leads into lane 1 of road 2.
    station_m = 200 - 4 * speed_m_s
    begins = begin("Ego", f'<LanePosition roadId="1" laneId="-1" s="{station_m}"/>', speed_m_s)
    change = maneuver("Ego", event(change_lane(1, "linear"), at(2)))
    ego = play(tmp_path, change, init=begins, streets=write_opposite_roads())["Ego"]

    y = find_rear_axle(ego, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0)[:, 1]
    assert y == pytest.approx([-1.75, -0.875, 0.0, 0.875, 1.75, 1.75], abs=0.05)


def test_an_offset_is_to_the_left_along_the_road(tmp_path: Path) -> None:
    offset = """<LateralAction><LaneOffsetAction continuous="false">
      <LaneOffsetActionDynamics dynamicsShape="cubic" maxLateralAcc="2"/>
      <LaneOffsetTarget><AbsoluteTargetLaneOffset value="0.6"/></LaneOffsetTarget>
      </LaneOffsetAction></LateralAction>"""
    init = begin("Ego", '<LanePosition roadId="1" laneId="-1" s="20"/>', 10.0) + begin(
        "Other", '<LanePosition roadId="1" laneId="1" s="380"/>', 10.0
    )
    tracks = play(
        tmp_path, *(maneuver(name, event(offset, at(1))) for name in ("Ego", "Other")), init=init
    )

    assert find_rear_axle(tracks["Ego"], 6.0)[0] == pytest.approx([80, -1.15], abs=0.1)
    assert find_rear_axle(tracks["Other"], 6.0)[0] == pytest.approx([320, 2.35], abs=0.1)
    # The largest acceleration of a cubic is 6 times way by time², so that it takes 1.34 s.
    y = find_rear_axle(tracks["Ego"], 1.0 + (6 * 0.6 / 2) ** 0.5 / 2)[0, 1]
    assert y == pytest.approx(-1.75 + 0.3, abs=0.02)


@pytest.mark.parametrize(
    ("name", "of", "value_m", "y"),
    [
        # To the left of one that drives east is north, of one that drives west south.
        ("Ego", "Other", 2.5, -0.75),
        ("Ego", "Other", -0.25, 2.0),
        ("Other", "Ego", 3.25, 1.5),
    ],
)
def test_an_offset_is_relative_to_the_place_of_another(
    name: str, of: str, value_m: float, y: float, tmp_path: Path
) -> None:
    offset = f"""<LateralAction><LaneOffsetAction continuous="false">
      <LaneOffsetActionDynamics dynamicsShape="sinusoidal" maxLateralAcc="3"/>
      <LaneOffsetTarget><RelativeTargetLaneOffset entityRef="{of}" value="{value_m}"/>
      </LaneOffsetTarget></LaneOffsetAction></LateralAction>"""
    init = begin("Ego", '<LanePosition roadId="1" laneId="-1" s="20"/>', 10.0) + begin(
        "Other", '<LanePosition roadId="1" laneId="1" s="380"/>', 10.0
    )
    tracks = play(tmp_path, maneuver(name, event(offset, at(1))), init=init)

    assert find_rear_axle(tracks[name], 6.0)[0, 1] == pytest.approx(y)


def test_a_lane_change_at_once_is_made_before_the_begin_and_a_jump_after(tmp_path: Path) -> None:
    place = '<LanePosition roadId="1" laneId="-1" s="20"/>'
    at_once = change_lane(1, "step")
    ego = play(tmp_path, init=begin("Ego", place, 10.0, at_once))["Ego"]
    assert find_rear_axle(ego, 0.0, 5.0).ravel() == pytest.approx([20, 1.75, 70, 1.75])

    with pytest.raises(DiagnosticsError, match=r"jumps 3\.5 m at 2 s"):
        play(tmp_path, maneuver("Ego", event(at_once, at(2))), init=begin("Ego", place, 10.0))
