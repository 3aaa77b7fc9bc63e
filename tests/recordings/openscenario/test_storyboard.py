"""Events begin, end each other, and are repeated as often as they may; triggers stop acts."""

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
    of_entity,
    play,
)

BEGIN = begin("Ego", EGO_AT_20, 10.0)
SLOW_DOWN = change_speed(0, "linear", "time", 10)


def find_place(folder: Path, *groups: str, time_s: float = 8.0) -> float:
    """Return how far Ego has driven at a time."""
    ego = play(folder, *groups, init=BEGIN, end_s=time_s)["Ego"]
    return float(find_rear_axle(ego, time_s)[0, 0] - 20)


@pytest.mark.parametrize(
    ("priority", "driven_m"),
    [
        # It brakes from 1 to 4 s by 1 m/s², and drives at 7 m/s from there.
        ("overwrite", 10 + 25.5 + 28),
        ("override", 10 + 25.5 + 28),
        # It brakes on.
        ("skip", 10 + 45.5),
    ],
)
def test_an_event_ends_others_or_is_skipped_by_its_priority(
    priority: str, driven_m: float, tmp_path: Path
) -> None:
    # The second event has no effect on the speed of Ego, unless it ends the first one.
    other = '<VisibilityAction graphics="true" traffic="true" sensors="true"/>'
    events = event(SLOW_DOWN, at(1)), event(other, at(4), priority=priority)
    assert find_place(tmp_path, maneuver("Ego", *events)) == pytest.approx(driven_m, abs=0.1)


def test_a_later_action_of_one_domain_takes_over_from_the_first(tmp_path: Path) -> None:
    events = event(SLOW_DOWN, at(1)), event(change_speed(2), at(4))
    driven_m = find_place(tmp_path, maneuver("Ego", *events))
    assert driven_m == pytest.approx(10 + 25.5 + 8, abs=0.1)


def test_a_stop_trigger_of_an_act_ends_its_actions(tmp_path: Path) -> None:
    stop = f"<StopTrigger><ConditionGroup>{at(4)}</ConditionGroup></StopTrigger>"
    driven_m = find_place(tmp_path, maneuver("Ego", event(SLOW_DOWN, at(1))) + stop)
    assert driven_m == pytest.approx(10 + 25.5 + 28, abs=0.1)


@pytest.mark.parametrize(("count", "speed_m_s"), [(1, 9.0), (3, 7.0), (40, 6.0)])
def test_an_event_is_executed_as_often_as_it_may(
    count: int, speed_m_s: float, tmp_path: Path
) -> None:
    slower = """<LongitudinalAction><SpeedAction>
      <SpeedActionDynamics dynamicsShape="step" dynamicsDimension="time" value="0"/>
      <SpeedActionTarget><RelativeTargetSpeed entityRef="Ego" value="-1"
        speedTargetValueType="delta" continuous="false"/></SpeedActionTarget>
      </SpeedAction></LongitudinalAction>"""
    trigger = of_entity('<SpeedCondition rule="greaterThan" value="6.5"/>')
    group = maneuver("Ego", event(slower, trigger, maximumExecutionCount=f"{count}"))
    ego = play(tmp_path, group, init=BEGIN, end_s=8)["Ego"]

    before, after = find_rear_axle(ego, 7.0, 8.0)[:, 0]
    assert after - before == pytest.approx(speed_m_s, abs=0.01)


def test_an_act_begins_by_its_trigger(tmp_path: Path) -> None:
    start = f"<StartTrigger><ConditionGroup>{at(3)}</ConditionGroup></StartTrigger>"
    driven_m = find_place(tmp_path, maneuver("Ego", event(change_speed(0), at(1))) + start)
    assert driven_m == pytest.approx(30, abs=0.6)
