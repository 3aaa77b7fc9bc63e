"""Signal programs, and the links that show the light of each approach."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
import yaml
from advercity_dsl import Road

from advercity.roads.network_file import read_signal_groups
from advercity.roads.road_network import build_road
from advercity.roads.signals import TrafficLight

NAMES = ("ui", "unj", "ri", "rsnj", "rcnj")
pytestmark = pytest.mark.sumo


@pytest.mark.parametrize("name", NAMES)
def test_every_approach_of_a_signal_has_its_links(
    files: dict[str, Path], roads: dict[str, Road], name: str
) -> None:
    groups = read_signal_groups(files[name])
    governed = {key: item for key, item in roads[name].junctions.items() if item.signals}
    approaches = {
        f"{junction}/{head.street}"
        for junction, item in governed.items()
        if item.signals
        for head in item.signals.heads
    }
    crossings = {
        f"{junction}/{crossing.street}/crossing"
        for junction, item in governed.items()
        for crossing in item.crossings
    }
    assert set(groups) == approaches | crossings
    links = [link for group in groups.values() for link in group]
    assert len(links) == len(set(links))


@pytest.mark.parametrize("name", NAMES)
def test_a_light_is_for_all_movements_of_its_approach(
    files: dict[str, Path], networks: dict[str, Any], name: str
) -> None:
    place = yaml.safe_load((Path(__file__).parents[1] / "data/places.yaml").read_text("utf-8"))[
        name
    ]
    groups = read_signal_groups(files[name])
    for junction, program in place.get("programmes", {}).items():
        approaches = [
            movement.split(" > ")[0].split(".")[0] for movement in place["movements"][junction]
        ]
        links = {
            approach: [index for _, index in groups[f"{junction}/{approach}"]]
            for approach in set(approaches)
        }
        assert {approach: len(found) for approach, found in links.items()} == {
            approach: approaches.count(approach) for approach in links
        }
        (shown,) = networks[name].getTLS(junction).getPrograms().values()
        phases, slots = shown.getPhases(), program.get("slots", len(links))
        assert -float(shown.getOffset()) == program["elapsed_s"]
        durations = [program[key] for key in ("green_s", "yellow_s", "all_red_s")]
        assert [phase.duration for phase in phases] == durations * slots
        cars, served = [index for found in links.values() for index in found], list[str]()
        for green, yellow, red in zip(phases[::3], phases[1::3], phases[2::3], strict=True):
            approaches = [a for a, i in links.items() if green.state[i[0]] in "Gg"]
            own = [index for approach in approaches for index in links[approach]]
            others = [index for index in cars if index not in own]
            assert {green.state[index] for index in own} <= {"G", "g"}
            assert {yellow.state[index] for index in own} == {"y"}
            assert {phase.state[index] for phase in (green, yellow) for index in others} == {"r"}
            assert {red.state[index] for index in cars} == {"r"}
            served += approaches
        assert sorted(served) == sorted(links)


@pytest.mark.parametrize(
    ("name", "ego", "waits_s", "green_s"),
    [("ui", "north_road", 13, 10), ("ri", "south_road", 11, 16)],
)
def test_the_ego_waits_and_then_has_green(
    files: dict[str, Path],
    networks: dict[str, Any],
    name: str,
    ego: str,
    waits_s: float,
    green_s: float,
) -> None:
    shown = states(networks[name], "j_main")
    links = [index for _, index in read_signal_groups(files[name])[f"j_main/{ego}"]]
    for time in np.arange(0.5, 40, 1.0):
        is_green = waits_s < time < waits_s + green_s
        letters = {shown(time)[index] for index in links}
        assert letters <= ({"G", "g"} if is_green else {"r", "y"}), time


def test_crossings_are_green_only_with_the_approach_that_turns_right_into_them(
    roads: dict[str, Road], networks: dict[str, Any]
) -> None:
    (program,) = networks["ui"].getTLS("j_main").getPrograms().values()
    movements = roads["ui"].junctions["j_main"].movements
    crossings = [item.street for item in roads["ui"].junctions["j_main"].crossings]
    right_turn_into = {
        "north_road": "east_road",
        "south_road": "west_road",
        "east_road": "south_road",
        "west_road": "north_road",
    }
    for phase in program.getPhases():
        cars = phase.state[: len(movements)]
        green = {
            text.split(".")[0] for text, light in zip(movements, cars, strict=True) if light in "Gg"
        }
        for street, light in zip(crossings, phase.state[len(movements) :], strict=True):
            assert (light == "G") == (right_turn_into[street] in green)


@pytest.mark.parametrize("name", NAMES)
def test_crossings_with_signals_have_heads_at_both_kerbs_that_face_each_other(
    files: dict[str, Path], roads: dict[str, Road], name: str
) -> None:
    road = build_road(roads[name])
    heads: dict[str, list[TrafficLight]] = {}
    for head in road.traffic_lights:
        if head.governs == "pedestrians":
            heads.setdefault(head.id, []).append(head)
    lines = {
        f"{lane.id}/crossing": (lane.left + lane.right)[:, :2] / 2
        for lane in road.lanes
        if lane.kind == "crossing"
    }

    assert set(heads) == {key for key in read_signal_groups(files[name]) if "crossing" in key}
    for key, pair in heads.items():
        along = lines[key][1] - lines[key][0]
        width = np.linalg.norm(along)
        first, second = pair
        for head, other in ((first, second), (second, first)):
            towards = np.subtract(other.mast_foot_m, head.mast_foot_m)
            assert np.dot(head.facing, towards) == pytest.approx(width + 1.2)
            assert not road.roadway_level_area.contains(shapely.Point(head.mast_foot_m))


def test_left_turns_give_way_to_oncoming_traffic_that_has_green_together(
    networks: dict[str, Any], roads: dict[str, Road]
) -> None:
    (program,) = networks["ri"].getTLS("j_main").getPrograms().values()
    movements = roads["ri"].junctions["j_main"].movements
    left, straight = (
        movements.index(f"south_road.1 > {street}.1") for street in ("west_road", "north_road")
    )

    greens = [phase.state for phase in program.getPhases() if phase.state[left] in "Gg"]

    assert [(state[left], state[straight]) for state in greens] == [("g", "G")]


def states(network: Any, light: str) -> Any:
    """State of a light over time, from SUMO's definition of a static program and its offset."""
    (program,) = network.getTLS(light).getPrograms().values()
    ends = np.cumsum([phase.duration for phase in program.getPhases()])

    def shown(time: float) -> str:
        return program.getPhases()[
            int(np.searchsorted(ends, (time - float(program.getOffset())) % ends[-1], "right"))
        ].state

    return shown
