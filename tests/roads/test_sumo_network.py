"""The SUMO networks against the layouts they are made from."""

import json
import os
import subprocess
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sumo
import sumolib
import yaml
from advercity_dsl import Road, Vehicle

from advercity.errors import InputError
from advercity.roads.lane_segments import build_lane_segments
from advercity.roads.layout import RoadLayout, lay_out_road
from advercity.roads.network_file import read_signal_groups
from advercity.roads.streets import edge_strips, parse_edge_id, sumo_edge_id, sumo_lane_id
from advercity.roads.sumo_network import write_sumo_network

NAMES = ("ui", "unj", "ri", "rsnj", "rcnj")
pytestmark = pytest.mark.sumo


def read(library: Path, name: str) -> Road:
    text = (library / f"nhtsa/roads/{name}.yaml").read_text(encoding="utf-8")
    return Road.model_validate(yaml.safe_load(text))


@pytest.fixture(scope="module")
def roads(library: Path) -> dict[str, Road]:
    return {name: read(library, name) for name in NAMES}


@pytest.fixture(scope="module")
def files(roads: dict[str, Road], tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    return {
        name: write_sumo_network(road, tmp_path_factory.mktemp(name))
        for name, road in roads.items()
    }


@pytest.fixture(scope="module")
def networks(files: dict[str, Path]) -> dict[str, Any]:
    return {
        name: sumolib.net.readNet(str(path), withInternal=True, withPrograms=True)
        for name, path in files.items()
    }


@pytest.fixture(scope="module")
def layouts(roads: dict[str, Road]) -> dict[str, RoadLayout]:
    return {name: lay_out_road(road) for name, road in roads.items()}


@pytest.mark.parametrize("name", NAMES)
def test_every_strip_lies_where_the_layout_has_it(
    networks: dict[str, Any], layouts: dict[str, RoadLayout], name: str
) -> None:
    for street in layouts[name].streets.values():
        for along in (True, False):
            bands = edge_strips(street, along=along)
            edge = networks[name].getEdge(sumo_edge_id(street.id, along=along))
            assert edge.getLaneNumber() == len(bands)
            for lane, band in zip(edge.getLanes(), reversed(bands), strict=True):
                wanted = street.directed_line(band.centre_t, along=along)
                shape = np.array(lane.getShape3D())
                assert lane.getWidth() == pytest.approx(band.width_m)
                assert lane.allows("passenger") == (band.kind == "lane")
                assert lane.allows("pedestrian") == (band.kind == "sidewalk")
                tolerance = 0.1 if band.lane_number else 0.25
                assert np.abs(shape - wanted)[:, :2].max() < tolerance, lane.getID()
                assert np.abs(shape - wanted)[:, 2].max() < 0.02, lane.getID()


@pytest.mark.parametrize("name", NAMES)
def test_movements_follow_their_paths(
    networks: dict[str, Any], layouts: dict[str, RoadLayout], name: str
) -> None:
    network, plan = networks[name], layouts[name]
    for junction in plan.junctions.values():
        for path in junction.connecting_paths:
            movement = path.movement
            source, target = (
                junction.find_arm(movement.from_street),
                junction.find_arm(movement.to_street),
            )
            start = network.getLane(
                sumo_lane_id(source.street, movement.from_lane, along=source.is_street_end)
            )
            end = network.getLane(
                sumo_lane_id(target.street, movement.to_lane, along=not target.is_street_end)
            )
            (connection,) = (c for c in start.getOutgoing() if c.getToLane() == end)
            shape = network.getLane(connection.getViaLaneID()).getShape3D()
            gaps = [sumolib.geomhelper.distancePointToPolygon(p[:2], path.centre) for p in shape]
            assert max(gaps) < 0.1, path.id
            assert shape[0][2] == pytest.approx(path.centre[0, 2], abs=0.02)


@pytest.mark.parametrize("name", NAMES)
def test_connected_vehicles_find_their_routes(
    networks: dict[str, Any], roads: dict[str, Road], name: str
) -> None:
    network = networks[name]
    for vehicle in roads[name].agents.values():
        if not isinstance(vehicle, Vehicle):
            continue
        edges = [
            {sumo_edge_id(street, along=along) for along in (True, False)}
            for street in vehicle.route
        ]
        found = [
            (here, there)
            for before, after in pairwise(edges)
            for here in before
            for there in network.getEdge(here).getOutgoing()
            if there.getID() in after
        ]
        assert len(found) == len(vehicle.route) - 1
        for (_, arriving), (leaving, _) in pairwise(found):
            assert arriving.getID() == leaving


def test_the_same_road_gives_the_same_bytes(
    roads: dict[str, Road], files: dict[str, Path], tmp_path: Path
) -> None:
    again = write_sumo_network(roads["ui"], tmp_path)
    assert again.read_bytes() == files["ui"].read_bytes()
    assert b"generated on" not in again.read_bytes()


@pytest.mark.parametrize("name", NAMES)
def test_every_approach_of_a_signal_has_its_links(
    files: dict[str, Path], roads: dict[str, Road], name: str
) -> None:
    groups = read_signal_groups(files[name])
    declared = {
        f"{junction}/{head.street}"
        for junction, item in roads[name].junctions.items()
        if item.signals
        for head in item.signals.heads
    }
    assert set(groups) == declared
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
        ways = [movement.split(" > ")[0].split(".")[0] for movement in place["movements"][junction]]
        links = {
            approach: [index for _, index in groups[f"{junction}/{approach}"]]
            for approach in set(ways)
        }
        assert {approach: len(found) for approach, found in links.items()} == {
            approach: ways.count(approach) for approach in links
        }
        (shown,) = networks[name].getTLS(junction).getPrograms().values()
        phases = shown.getPhases()
        assert -float(shown.getOffset()) == program["elapsed_s"]
        durations = [program[key] for key in ("green_s", "yellow_s", "all_red_s")]
        assert [phase.duration for phase in phases] == durations * len(links)
        cars = [index for found in links.values() for index in found]
        for green, yellow, red in zip(phases[::3], phases[1::3], phases[2::3], strict=True):
            (approach,) = (a for a, i in links.items() if green.state[i[0]] in "Gg")
            others = [index for index in cars if index not in links[approach]]
            assert {green.state[index] for index in links[approach]} <= {"G", "g"}
            assert {yellow.state[index] for index in links[approach]} == {"y"}
            assert {phase.state[index] for phase in (green, yellow) for index in others} == {"r"}
            assert {red.state[index] for index in cars} == {"r"}


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


def test_crossings_walk_only_beside_an_approach_that_turns_right_into_them(
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
            assert (light == "G") == (green == {right_turn_into[street]})


def states(network: Any, light: str) -> Any:
    """State of a light over time, from SUMO's definition of a static programme and its offset."""
    (program,) = network.getTLS(light).getPrograms().values()
    ends = np.cumsum([phase.duration for phase in program.getPhases()])

    def shown(time: float) -> str:
        return program.getPhases()[
            int(np.searchsorted(ends, (time - float(program.getOffset())) % ends[-1], "right"))
        ].state

    return shown


@pytest.mark.parametrize(("name", "crossings"), [("ui", 4), ("unj", 0), ("ri", 4), ("rsnj", 0)])
def test_declared_crossings_are_built(networks: dict[str, Any], name: str, crossings: int) -> None:
    built = [edge for edge in networks[name].getEdges() if edge.getFunction() == "crossing"]
    assert len(built) == crossings


def test_people_can_walk_around_every_corner_of_the_crossing(networks: dict[str, Any]) -> None:
    network = networks["ui"]
    corners = [e for e in network.getEdges() if e.getID().startswith(":j_main_w")]
    assert len(corners) == 4


def test_a_vehicle_and_a_walker_cross_the_site(files: dict[str, Path]) -> None:
    script = """
import json, sys
import libsumo as sumo
sumo.start(["sumo", "-n", sys.argv[1], "--step-length", "0.1", "--no-step-log"])
sumo.route.add("left", ["north_road+", "east_road+"])
sumo.vehicle.add("ego", "left", departLane="best")
walk = sumo.simulation.findIntermodalRoute("west_road+", "east_road+", modes="")
sumo.person.add("walker", "west_road+", 20)
sumo.person.appendWalkingStage("walker", walk[0].edges, 20)
heights, arrived = set(), []
for _ in range(2400):
    sumo.simulationStep()
    arrived += sumo.simulation.getArrivedIDList() + sumo.simulation.getArrivedPersonIDList()
    if "ego" in sumo.vehicle.getIDList():
        heights.add(round(sumo.vehicle.getPosition3D("ego")[2], 2))
sumo.close()
print(json.dumps({"arrived": sorted(arrived), "highest": max(heights)}))
"""
    result = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", script, str(files["ui"])],
        env={**os.environ, "SUMO_HOME": sumo.SUMO_HOME},
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    report = json.loads(result.stdout.strip().splitlines()[-1])
    assert report["arrived"] == ["ego", "walker"]
    assert report["highest"] == pytest.approx(0.45, abs=0.02)


@pytest.mark.parametrize("name", NAMES)
def test_lanes_for_maps_have_ids_and_borders_at_their_width(
    layouts: dict[str, RoadLayout], name: str
) -> None:
    found = build_lane_segments(layouts[name])
    assert len({lane.id for lane in found}) == len(found)
    declared = {
        f"{sumo_edge_id(street.id, along=along)}.{band.lane_number}": band.width_m
        for street in layouts[name].streets.values()
        for along in (True, False)
        for band in street.strips_in_direction(along=along)
        if band.lane_number
    }
    for lane in found:
        if lane.id in declared:
            width = np.linalg.norm(lane.left - lane.right, axis=1)
            np.testing.assert_allclose(width, declared.pop(lane.id), atol=1e-9)
            forward, across = lane.left[1] - lane.left[0], lane.right[0] - lane.left[0]
            assert forward[0] * across[1] < forward[1] * across[0]
    assert not declared


def test_edge_ids_are_read_back() -> None:
    assert parse_edge_id(sumo_edge_id("north_road", along=True)) == ("north_road", True)
    assert parse_edge_id(sumo_edge_id("north_road", along=False)) == ("north_road", False)
    with pytest.raises(KeyError):
        parse_edge_id(":j_main_0")


def test_a_crossing_without_sidewalks_is_refused_with_netconverts_words(
    roads: dict[str, Road], tmp_path: Path
) -> None:
    text = roads["rcnj"].model_dump(mode="json")
    text["junctions"]["j_north"]["crossings"] = [{"street": "hill_road"}]
    with pytest.raises(InputError, match=r"road 'rcnj' netconvert warns about.*crossing"):
        write_sumo_network(Road.model_validate(text), tmp_path)
