"""Files that were damaged at random are read or refused by name, never with a traceback."""

import random
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from advercity.errors import InputError
from advercity.recordings.openscenario.scenario import read_scenario
from tests.recordings.openscenario.scenarios import (
    EGO_AT_20,
    at,
    begin,
    change_lane,
    change_speed,
    event,
    follow,
    maneuver,
    of_entity,
    world,
)
from tests.recordings.openscenario.test_routes import ACQUIRE, ASSIGN, AT_80, write_fork
from tests.recordings.recorded_files import write_openscenario, write_street

OFFSET = """<LateralAction><LaneOffsetAction continuous="true">
  <LaneOffsetActionDynamics dynamicsShape="cubic" maxLateralAcc="2"/><LaneOffsetTarget>
  <RelativeTargetLaneOffset entityRef="Other" value="1"/></LaneOffsetTarget></LaneOffsetAction>
  </LateralAction>"""
OTHER = begin("Other", '<LanePosition roadId="1" laneId="1" s="90" offset="0.5"/>', 3.0)
NEAR = of_entity(
    """<RelativeDistanceCondition entityRef="Other" relativeDistanceType="longitudinal"
      coordinateSystem="road" freespace="true" rule="lessThan" value="20"/>"""
)
TURN = '<LanePosition roadId="1" laneId="-1" s="20"><Orientation h="${pi / 8}"/></LanePosition>'
SCENARIOS = (
    ("", ""),
    (begin("Ego", EGO_AT_20, 10.0), maneuver("Ego", event(change_lane(1), at(1)))),
    (begin("Ego", TURN, 10.0), maneuver("Ego", event(change_speed(2, "cubic", "rate", 3), at(1)))),
    (begin("Ego", EGO_AT_20, 10.0) + OTHER, maneuver("Ego", event(OFFSET, NEAR))),
    (begin("Ego", world(0, 0), 5.0, follow(world(9, 1), world(20, 5, 0.2))), ""),
    (begin("Ego", AT_80, 10.0, ASSIGN), ""),
    (begin("Ego", AT_80, 10.0, ACQUIRE), maneuver("Ego", event(change_lane(1), NEAR)) + OTHER),
)
VALUES = (
    "",
    "0",
    "-1",
    "1e308",
    "nan",
    "-inf",
    "x",
    "$length",
    "${1 / 0}",
    "true",
    "\u20ac",
    "9" * 400,
)
EXAMPLES = 15  # of each kind of damage and scenario: 525


def change_value(text: str, chance: random.Random) -> str:
    found = [*re.finditer(r'"[^"]*"', text)]
    place = chance.choice(found)
    return f'{text[: place.start()]}"{chance.choice(VALUES)}"{text[place.end() :]}'


def drop_attribute(text: str, chance: random.Random) -> str:
    place = chance.choice([*re.finditer(r' [a-zA-Z]+="[^"]*"', text)])
    return text[: place.start()] + text[place.end() :]


def drop_element(text: str, chance: random.Random) -> str:
    place = chance.choice([*re.finditer(r"<[A-Za-z]+[^<>]*/>", text)])
    return text[: place.start()] + text[place.end() :]


def rename_element(text: str, chance: random.Random) -> str:
    names = [*{*re.findall(r"<([A-Za-z]+)", text)}]
    one, other = chance.sample(sorted(names), 2)
    return re.sub(rf"(</?){one}\b", rf"\g<1>{other}", text)


def cut(text: str, chance: random.Random) -> str:
    begin_at = chance.randrange(len(text))
    return text[:begin_at] + text[begin_at + chance.randrange(1, 40) :]


@pytest.mark.parametrize(
    "mutate", [change_value, drop_attribute, drop_element, rename_element, cut]
)
@pytest.mark.parametrize("number", range(len(SCENARIOS)))
def test_a_damaged_scenario_is_read_or_refused(
    number: int, mutate: Callable[[str, random.Random], str], tmp_path: Path
) -> None:
    init, groups = SCENARIOS[number]
    map_file = write_street(tmp_path)
    if number >= 5:
        map_file.write_text(f"<OpenDRIVE><header/>{write_fork()}</OpenDRIVE>")
    stop = f"<StopTrigger><ConditionGroup>{at(3)}</ConditionGroup></StopTrigger>"
    body = f"""<Init><Actions>{init}</Actions></Init>
      <Story name="s"><Act name="a">{groups}</Act></Story>{stop}"""
    path = write_openscenario(tmp_path, body=body if init else None)
    text = path.read_text()
    chance = random.Random(f"{number} {mutate.__name__}")
    for _ in range(EXAMPLES):
        damaged = text
        for _ in range(chance.randrange(1, 3)):
            damaged = mutate(damaged, chance)
        path.write_text(damaged)
        try:
            read_scenario(path)
        except InputError as error:
            assert str(path.parent) in str(error)
