"""SUMO networks against the layouts that they are made from."""

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
from advercity_dsl import Road, Vehicle
from sumolib.geomhelper import distancePointToPolygon

from advercity.errors import InputError
from advercity.roads.layout import RoadLayout
from advercity.roads.routes import RoutePlanner
from advercity.roads.streets import StreetLayout, edge_strips, sumo_edge_id, sumo_lane_index
from advercity.roads.sumo_network import write_sumo_network

NAMES = ("ui", "unj", "ri", "rsnj", "rcnj")
pytestmark = pytest.mark.sumo


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
                _sumo_lane_id(source.street, movement.from_lane, along=source.is_street_end)
            )
            end = network.getLane(
                _sumo_lane_id(target.street, movement.to_lane, along=not target.is_street_end)
            )
            (connection,) = (c for c in start.getOutgoing() if c.getToLane() == end)
            shape = network.getLane(connection.getViaLaneID()).getShape3D()
            gaps = [distancePointToPolygon(p[:2], path.centre) for p in shape]
            assert max(gaps) < 0.1, path.id
            assert shape[0][2] == pytest.approx(path.centre[0, 2], abs=0.02)


@pytest.mark.parametrize("name", NAMES)
def test_routes_turn_where_the_lanes_of_their_movements_do(
    networks: dict[str, Any], roads: dict[str, Road], layouts: dict[str, RoadLayout], name: str
) -> None:
    network, planner = networks[name], RoutePlanner(roads[name])
    for junction in layouts[name].junctions.values():
        for path in junction.connecting_paths:
            movement = path.movement
            source = junction.find_arm(movement.from_street)
            lane = network.getLane(
                _sumo_lane_id(source.street, movement.from_lane, along=source.is_street_end)
            )
            route = planner.build_path(
                (movement.from_street, movement.to_street), movement.from_lane
            )
            entered = {sumo_edge_id(movement.to_street, along=along) for along in (True, False)}
            # A lane may lead into two lanes of a street; the route takes one of them.
            gaps = [
                max(distancePointToPolygon(p, route.points) for p in via.getShape())
                for link in lane.getOutgoing()
                if link.getTo().getID() in entered
                for via in (network.getLane(link.getViaLaneID()),)
            ]
            assert min(gaps) < 0.1, path.id


def _sumo_lane_id(street: StreetLayout, number: int, *, along: bool) -> str:
    return f"{sumo_edge_id(street.id, along=along)}_{sumo_lane_index(street, number, along=along)}"


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


@pytest.mark.parametrize(("name", "crossings"), [("ui", 4), ("unj", 4), ("ri", 4), ("rsnj", 0)])
def test_declared_crossings_are_built(networks: dict[str, Any], name: str, crossings: int) -> None:
    built = [edge for edge in networks[name].getEdges() if edge.getFunction() == "crossing"]
    assert len(built) == crossings


def test_walking_areas_connect_every_corner_of_the_crossing(networks: dict[str, Any]) -> None:
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


def test_a_locale_that_is_not_installed_stops_no_network(
    roads: dict[str, Road], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("LC_ALL", raising=False)
    monkeypatch.setenv("LANG", "xx_XX.UTF-8")
    assert write_sumo_network(roads["rcnj"], tmp_path).stat().st_size > 10_000


def test_a_crossing_without_sidewalks_is_refused_with_netconverts_words(
    roads: dict[str, Road], tmp_path: Path
) -> None:
    text = roads["rcnj"].model_dump(mode="json")
    text["junctions"]["j_north"]["crossings"] = [{"street": "hill_road"}]
    with pytest.raises(InputError, match=r"road 'rcnj' .* netconvert warns about.*crossing"):
        write_sumo_network(Road.model_validate(text), tmp_path)
