"""Speeds change by time, distance and rate, in every shape, also relative to another entity."""

from pathlib import Path

import pytest

from tests.recordings.openscenario.scenarios import (
    EGO_AT_20,
    at,
    begin,
    change_speed,
    event,
    find_rear_axle,
    maneuver,
    play,
)

OTHER = '<LanePosition roadId="1" laneId="1" s="380"/>'


@pytest.mark.parametrize("shape", ["linear", "sinusoidal", "cubic"])
@pytest.mark.parametrize(("begin_m_s", "end_m_s"), [(10.0, 20.0), (10.0, 0.0), (0.0, 12.0)])
def test_a_change_by_time_covers_the_mean_speed(
    shape: str, begin_m_s: float, end_m_s: float, tmp_path: Path
) -> None:
    change = maneuver("Ego", event(change_speed(end_m_s, shape, "time", 4.0), at(1)))
    ego = play(tmp_path, change, init=begin("Ego", EGO_AT_20, begin_m_s), end_s=8)["Ego"]

    ends_m = 20 + begin_m_s + 4 * (begin_m_s + end_m_s) / 2
    x = find_rear_axle(ego, 1.0, 5.0, 8.0)[:, 0]
    assert x == pytest.approx([20 + begin_m_s, ends_m, ends_m + 3 * end_m_s], abs=0.02)


@pytest.mark.parametrize(("rate", "end_s"), [(2.0, 6.0), (10.0, 2.0)])
def test_a_linear_rate_is_an_acceleration(rate: float, end_s: float, tmp_path: Path) -> None:
    change = maneuver("Ego", event(change_speed(20, "linear", "rate", rate), at(1)))
    ego = play(tmp_path, change, init=begin("Ego", EGO_AT_20, 10), end_s=8)["Ego"]

    before, after = find_rear_axle(ego, end_s, 8.0)[:, 0]
    assert before == pytest.approx(30 + (20**2 - 10**2) / (2 * rate), abs=0.02)
    assert after == pytest.approx(before + 20 * (8 - end_s), abs=0.02)


def test_a_speed_by_distance_is_reached_there(tmp_path: Path) -> None:
    change = maneuver("Ego", event(change_speed(5, "linear", "distance", 50), at(1)))
    ego = play(tmp_path, change, init=begin("Ego", EGO_AT_20, 10), end_s=10)["Ego"]

    # The speed falls from 10 to 5 m/s over 50 m, which takes 10 s times ln 2.
    assert find_rear_axle(ego, 1 + 6.931)[0, 0] == pytest.approx(80, abs=0.4)
    last = find_rear_axle(ego, 9.0, 10.0)[:, 0]
    assert last[1] - last[0] == pytest.approx(5.0)


@pytest.mark.parametrize(
    ("kind", "number", "speed_m_s"), [("delta", -2.0, 6.0), ("factor", 1.5, 12.0)]
)
def test_a_speed_is_relative_to_that_of_another(
    kind: str, number: float, speed_m_s: float, tmp_path: Path
) -> None:
    target = f"""<RelativeTargetSpeed entityRef="Other" value="{number}"
      speedTargetValueType="{kind}" continuous="false"/>"""
    change = change_speed(0).replace('<AbsoluteTargetSpeed value="0"/>', target)
    init = begin("Ego", EGO_AT_20, 10) + begin("Other", OTHER, 8)
    ego = play(tmp_path, maneuver("Ego", event(change, at(2))), init=init, end_s=6)["Ego"]

    assert find_rear_axle(ego, 6.0)[0, 0] == pytest.approx(40 + 4 * speed_m_s, abs=0.02)


def test_a_profile_has_its_speeds_at_its_times(tmp_path: Path) -> None:
    entries = "".join(
        f'<SpeedProfileEntry time="{time_s}" speed="{speed}"/>'
        for time_s, speed in ((2, 14), (3, 8))
    )
    profile = f"""<LongitudinalAction><SpeedProfileAction followingMode="position">{entries}
      </SpeedProfileAction></LongitudinalAction>"""
    init = begin("Ego", EGO_AT_20, 10)
    ego = play(tmp_path, maneuver("Ego", event(profile, at(1))), init=init, end_s=8)["Ego"]

    x = find_rear_axle(ego, 1.0, 3.0, 6.0, 8.0)[:, 0]
    assert x == pytest.approx([30, 30 + 24, 54 + 33, 87 + 16], abs=0.02)
