"""Conditions hold when and where they say."""

from pathlib import Path

import numpy as np
import pytest

from tests.recordings.openscenario.scenarios import (
    at,
    begin,
    change_speed,
    event,
    find_rear_axle,
    maneuver,
    of_entity,
    play,
    value,
)

EGO = begin("Ego", '<LanePosition roadId="1" laneId="-1" s="20"/>', 10.0)
OTHER = begin("Other", '<LanePosition roadId="1" laneId="-1" s="60"/>', 5.0)


def find_stop_s(folder: Path, trigger: str, *groups: str) -> float:
    """Return when Ego stops, which does so at once when the condition is fulfilled."""
    stop = maneuver("Ego", event(change_speed(0.0), trigger))
    ego = play(folder, stop, *groups, init=EGO + OTHER, end_s=12)["Ego"]
    # It drives 10 m/s from x = 20.
    return float(find_rear_axle(ego, 12.0)[0, 0] - 20) / 10


def compare(tag: str, rule: str, limit: float, **attributes: str) -> str:
    rest = "".join(f' {key}="{item}"' for key, item in attributes.items())
    return of_entity(f'<{tag} rule="{rule}" value="{limit}"{rest}/>')


def measure(tag: str, rule: str, limit: float, *, free: str = "false") -> str:
    kind = {"freespace": free, "relativeDistanceType": "longitudinal", "entityRef": "Other"}
    return compare(tag, rule, limit, **kind)


@pytest.mark.parametrize(
    ("trigger", "stop_s"),
    [
        (at(3.0), 3.0),
        (at(3.33), 3.33),
        (of_entity('<TraveledDistanceCondition value="45"/>'), 4.5),
        # Ego comes nearer by 5 m/s, from 40 m; the boxes are 4.6 m long.
        (measure("RelativeDistanceCondition", "lessThan", 20), 4.0),
        (measure("RelativeDistanceCondition", "lessThan", 20, free="true"), 3.1),
        (measure("TimeHeadwayCondition", "lessThan", 1), 6.0),
        # One that is passed, at 8 s, has no headway.
        (measure("TimeHeadwayCondition", "greaterThan", 5), 12.0),
        (compare("RelativeSpeedCondition", "greaterThan", 4.9, entityRef="Other"), 0.0),
        (compare("RelativeSpeedCondition", "greaterThan", 5.1, entityRef="Other"), 12.0),
    ],
)
def test_a_condition_of_motion_holds_from_its_time(
    trigger: str, stop_s: float, tmp_path: Path
) -> None:
    assert find_stop_s(tmp_path, trigger) == pytest.approx(stop_s, abs=0.06)


def test_a_time_to_collision_is_that_of_both_speeds(tmp_path: Path) -> None:
    target = """<TimeToCollisionConditionTarget><EntityRef entityRef="Other"/>
      </TimeToCollisionConditionTarget>"""
    trigger = of_entity(
        f"""<TimeToCollisionCondition rule="lessThan" value="2" freespace="false"
          relativeDistanceType="longitudinal">{target}</TimeToCollisionCondition>"""
    )
    # 10 m are left of 40 m.
    assert find_stop_s(tmp_path, trigger) == pytest.approx(6.0, abs=0.06)


@pytest.mark.parametrize(("delay_s", "stop_s"), [(0.0, 3.0), (0.5, 3.5), (4.0, 7.0)])
def test_a_condition_counts_after_its_delay(delay_s: float, stop_s: float, tmp_path: Path) -> None:
    time = '<SimulationTimeCondition value="3" rule="greaterThan"/>'
    trigger = value(time, delay=f"{delay_s}", conditionEdge="rising")
    assert find_stop_s(tmp_path, trigger) == pytest.approx(stop_s, abs=0.06)


@pytest.mark.parametrize(
    ("name", "stop_s"), [("slow", 2.0), ("second::slow", 5.0), ("s::a::Other::Other::first", 2.0)]
)
def test_parts_of_a_storyboard_are_found_by_their_last_names(
    name: str, stop_s: float, tmp_path: Path
) -> None:
    names = [("first", 2.0), ("second", 5.0)]
    other = maneuver(
        "Other",
        *(
            event(change_speed(4), at(time_s), name=item).replace('"x"', '"slow"')
            for item, time_s in names
        ),
    )
    kind = "event" if name.endswith("first") else "action"
    state = f"""<StoryboardElementStateCondition storyboardElementType="{kind}"
      storyboardElementRef="{name}" state="completeState"/>"""
    assert find_stop_s(tmp_path, value(state), other) == pytest.approx(stop_s, abs=0.11)


@pytest.mark.parametrize(("rule", "stop_s"), [("any", 1.0), ("all", 3.0)])
def test_a_condition_is_of_any_or_of_all_entities(rule: str, stop_s: float, tmp_path: Path) -> None:
    trigger = of_entity('<TraveledDistanceCondition value="15"/>', "Ego", "Other", rule=rule)
    assert find_stop_s(tmp_path, trigger) == pytest.approx(stop_s + 0.5 * (rule == "any"), abs=0.06)


def test_one_group_of_conditions_suffices_and_all_in_it_are_needed(tmp_path: Path) -> None:
    both = at(2.0) + of_entity('<TraveledDistanceCondition value="40"/>')
    either = f"{at(9.0)}</ConditionGroup><ConditionGroup>{both}"
    assert find_stop_s(tmp_path, either) == pytest.approx(4.0, abs=0.06)
    assert np.isclose(find_stop_s(tmp_path, at(9.0)), 9.0, atol=0.06)
