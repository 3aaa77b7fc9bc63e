"""SUMO scenarios of others: what is recorded of them, and what they may not do."""

import gzip
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from advercity_dsl import MapNetwork

from advercity.compiler.recorded_roads import ReplayChoice, write_recorded_road
from advercity.errors import InputError
from advercity.foreign.xml_documents import to_xml_bytes
from advercity.frames import Signal
from advercity.roads.plan_frame import to_plan_frame
from advercity.roads.sumo_network import write_sumo_network
from advercity.traffic.simulation import simulate_in_subprocess
from advercity.traffic.sumo_scenarios import load_sumo_scenario
from tests.roads.sumo_networks import build_crossing_network, parse_crossing_network
from tests.traffic.sumo_scenario_files import (
    CONFIGURATION,
    DEPART_M,
    LENGTH_M,
    ROUTES,
    SPEED_M_S,
    write_sumo_scenario,
)

ENDS_S = 12.0
MOVERS = ROUTES[ROUTES.index('<vehicle id="north/1"') : ROUTES.index("</routes>")]


def test_places_are_the_middles_of_boxes_at_the_times_of_the_simulation(tmp_path: Path) -> None:
    found = load_sumo_scenario(write_sumo_scenario(tmp_path / "s"), tmp_path, to_s=ENDS_S)

    tracks = {track.id: track for track in found.tracks}
    assert {name: track.actor_class for name, track in tracks.items()} == {
        "north_1": "car",
        "line_7": "truck",
        "walker": "pedestrian",
    }
    car = tracks["north_1"]
    assert car.size[0] == LENGTH_M
    # The edge begins 100 m south of the middle; the car drives at its top speed all the time.
    since_s = car.times_s - car.times_s[0]
    middle_m = -100 + DEPART_M + SPEED_M_S * since_s - LENGTH_M / 2
    assert car.places[:, 1] == pytest.approx(middle_m, abs=0.1)
    assert car.headings_rad == pytest.approx(np.full(len(since_s), np.pi / 2), abs=0.2)
    # It changes from the left lane to the right one, which SUMO alone would let it do at once.
    assert np.ptp(car.places[:, 0]) == pytest.approx(3.2, abs=0.3)
    assert np.abs(np.diff(car.places[:, 0])).max() < 0.25
    assert car.times_s[-1] == pytest.approx(ENDS_S + 1)
    assert np.diff(car.times_s) == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("from_s", "shown"), [(0.7, "G" * 3 + "y" * 3), (5.0, "y" * 2 + "r" * 4), (8.7, "r" * 4 + "GG")]
)
def test_lights_show_what_they_showed_in_the_simulation(
    from_s: float, shown: str, tmp_path: Path
) -> None:
    path = write_sumo_scenario(tmp_path / "s")
    found = load_sumo_scenario(path, tmp_path, from_s=from_s, to_s=from_s + 6)
    choice = ReplayChoice(
        ego="north_1", connected_count=0, from_s=from_s, to_s=from_s + 6, looks="shaped"
    )

    (spec,) = write_recorded_road(found, None, choice, tmp_path / "out")

    trace = simulate_in_subprocess(spec, write_sumo_network(spec.road, tmp_path / "net"))
    signals = {"G": Signal.GREEN, "y": Signal.YELLOW, "r": Signal.RED}
    # In the middle of every second, the first of which begins at `from_s`.
    expected = [signals[state] for state in shown]
    assert len(trace.signal_ids) == 8
    for column in trace.signals[5:60:10].T:
        assert column.tolist() == expected


def test_nothing_is_written_beside_the_scenario_and_what_is_missing_is_listed(
    tmp_path: Path,
) -> None:
    tram = '<vehicle id="tram" type="train" depart="0" route="north"/></routes>'
    folder = tmp_path / "s"
    path = write_sumo_scenario(folder, routes=ROUTES.replace("</routes>", tram))
    before = sorted(folder.iterdir())

    found = load_sumo_scenario(path, tmp_path / "s" / "..", to_s=3)

    assert sorted(folder.iterdir()) == before
    assert {path.name for path in tmp_path.iterdir()} == {"s", "town.net.xml"}
    assert {(item.name, item.count) for item in found.left_out} == {
        ("option novelty", 1),
        ("parameter has.ssm.device", 1),
        ("parameter device.ssm.file", 1),
        ("element <calibrator>", 1),
        ("vehicle not sorted by departure (SUMO ignores it)", 1),
    }


def test_who_is_left_out_is_listed(tmp_path: Path) -> None:
    """SUMO ignores who departs before one above; a road user is at most 50 m long."""
    more = "".join(
        f'<vehicle id="v{index}" depart="{depart}"><route edges="in_east out_west"/></vehicle>'
        for index, depart in enumerate(("5", "0:00:02", "4.9", "6"))
    )
    more += '<flow id="f" begin="3" end="9" period="3"><route edges="in_west out_east"/></flow>'
    coach = '<vType id="coach" vClass="bus"'
    routes = ROUTES.replace(coach, f'{coach} length="50.5"').replace(
        "</routes>", more + "</routes>"
    )
    path = write_sumo_scenario(tmp_path / "s", routes=routes)

    found = load_sumo_scenario(path, tmp_path, to_s=ENDS_S)

    assert {track.id for track in found.tracks} == {"north_1", "walker", "v0", "v3"}
    listed = {item.name: item.count for item in found.left_out}
    assert listed["vehicles not sorted by departure (SUMO ignores them)"] == 2
    assert listed["flow not sorted by departure (SUMO ignores it)"] == 1
    assert listed["vehicle longer than 50 m"] == 1


def test_who_is_seen_at_a_single_step_is_listed(tmp_path: Path) -> None:
    late = '<vehicle id="late" depart="12.9"><route edges="in_east out_west"/></vehicle></routes>'
    path = write_sumo_scenario(tmp_path / "s", routes=ROUTES.replace("</routes>", late))

    found = load_sumo_scenario(path, tmp_path, to_s=ENDS_S)

    assert "late" not in {track.id for track in found.tracks}
    listed = {item.name: item.count for item in found.left_out}
    assert listed["motion of a single step in the recorded time"] == 1


@pytest.mark.parametrize(("is_closed", "listed"), [(False, 0), (True, 1)])
def test_vehicles_on_streets_that_are_not_taken_over_are_listed(
    is_closed: bool, listed: int, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """The coach drives from east to west, 100 m from the end of a street that is left."""
    more = '<vehicle id="back" depart="1"><route edges="in_north out_south"/></vehicle></routes>'
    path = write_sumo_scenario(tmp_path / "s", routes=ROUTES.replace("</routes>", more))
    network = parse_crossing_network()
    for edge in network.iter("edge"):
        if is_closed and edge.get("id") in ("in_east", "out_east", "in_west", "out_west"):
            for lane in edge.iter("lane"):
                if lane.get("allow") != "pedestrian":
                    lane.set("allow", "bus")
                    lane.attrib.pop("disallow", None)
    (tmp_path / "s/town.net.xml.gz").write_bytes(gzip.compress(to_xml_bytes(network)))
    found = load_sumo_scenario(path, tmp_path, from_s=2, to_s=8)

    write_recorded_road(
        found, None, ReplayChoice(ego="north_1", looks="shaped", to_s=8), tmp_path / "out"
    )

    messages = [record.getMessage() for record in caplog.records]
    assert len(messages) == listed
    assert all(re.search(r"next to the lanes of the map: 1: line_7 \(\d+ m\)", m) for m in messages)


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("<report>", '<remote-port value="8813"/><report>', "another program drives"),
        ("<report>", '<load-state value="x.xml"/><report>', "saved state"),
        ("<report>", '<seed value="/etc/passwd"/><report>', "line 6: <seed>: '/etc/passwd'"),
        ('value="town.rou.xml"', 'value="gone.rou.xml"', "gone.rou.xml: cannot be read"),
        ('value="town.rou.xml"', 'value="/etc/hostname"', "is an absolute path"),
        ('value="town.net.xml.gz"', 'value="town.add.xml"', "town.add.xml: is no network"),
        ('<net-file value="town.net.xml.gz"/>', "", "names no network"),
        ('"0:01:00"', '"later"', "'later' is no time"),
        ("configuration>", "routes>", "begins with <routes>"),
        ('length value="0.1"', 'length value="1.1"', "its steps are 1.1 s long"),
        ('"0:01:00"', '"5"', r"`from` 0, `to` 9"),
    ],
)
def test_what_cannot_be_run_is_an_error_of_the_file(
    old: str, new: str, complaint: str, tmp_path: Path
) -> None:
    path = write_sumo_scenario(tmp_path, configuration=CONFIGURATION.replace(old, new))

    with pytest.raises(InputError, match=complaint):
        load_sumo_scenario(path, tmp_path, to_s=9)


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ('edges="in_south out_north"', 'edges="in_south gone"', "gone"),
        ("</routes>", '<include href="/etc/hostname"/></routes>', "takes another file in"),
        ("</routes>", "", "town.rou.xml: is not XML"),
        ("<routes>", '<!DOCTYPE x SYSTEM "x"><routes>', "document type"),
        (MOVERS, "", "nobody moves in it"),
    ],
)
def test_routes_that_cannot_be_used_are_an_error_of_the_file(
    old: str, new: str, complaint: str, tmp_path: Path
) -> None:
    path = write_sumo_scenario(tmp_path, routes=ROUTES.replace(old, new))

    with pytest.raises(InputError, match=complaint):
        load_sumo_scenario(path, tmp_path, to_s=9)


def test_traffic_on_the_left_stays_there(tmp_path: Path) -> None:
    path = write_sumo_scenario(tmp_path / "s")
    network = build_crossing_network(("lefthand", "true"))
    (tmp_path / "s/town.net.xml.gz").write_bytes(gzip.compress(network.encode()))
    found = load_sumo_scenario(path, tmp_path, from_s=2, to_s=8)
    choice = ReplayChoice(ego="north_1", connected_count=0, from_s=2, to_s=8, looks="shaped")

    (spec,) = write_recorded_road(found, None, choice, tmp_path / "out")

    assert spec.road.is_left_hand
    trace = simulate_in_subprocess(
        spec, write_sumo_network(to_plan_frame(spec.road), tmp_path / "net")
    )
    driven = trace.states[trace.states["actor"] == 0]
    assert (driven["x"] < -1).all()
    assert driven["y"][0] == pytest.approx(-100 + DEPART_M + SPEED_M_S * 2 - 2.5, abs=0.85)
    assert (np.diff(driven["y"]) > 0.5).all()


def test_a_network_that_knows_its_place_is_there(tmp_path: Path) -> None:
    """Its middle is 500 km east of false easting's zero: on the central meridian, at 48 N."""
    path = write_sumo_scenario(tmp_path / "s")
    packed = tmp_path / "s/town.net.xml.gz"
    network = gzip.decompress(packed.read_bytes()).decode()
    for name, value in {
        "netOffset": "-500000,-5316300",
        "projParameter": "+proj=utm +zone=32 +ellps=WGS84",
    }.items():
        network, count = re.subn(f'{name}="[^"]*"', f'{name}="{value}"', network)
        assert count == 1
    packed.write_bytes(gzip.compress(network.encode()))
    found = load_sumo_scenario(path, tmp_path, from_s=2, to_s=8)

    choice = ReplayChoice(ego="north_1", from_s=2, to_s=8, looks="shaped")
    (spec,) = write_recorded_road(found, None, choice, tmp_path / "out")

    assert spec.road.origin_lon_deg == pytest.approx(9, abs=1e-4)
    assert spec.road.origin_lat_deg == pytest.approx(48, abs=0.01)
    elsewhere = replace(choice, origin_deg=(48.0, 11.0))
    with pytest.raises(InputError, match="its geoReference puts the origin at 4"):
        write_recorded_road(found, None, elsewhere, tmp_path / "other")


def test_a_scenario_becomes_a_spec_that_has_its_network_and_its_window(tmp_path: Path) -> None:
    found = load_sumo_scenario(write_sumo_scenario(tmp_path / "s"), tmp_path, from_s=2, to_s=8)
    choice = ReplayChoice(ego="north_1", from_s=2, to_s=8, looks="shaped")

    (spec,) = write_recorded_road(found, None, choice, tmp_path / "out")

    assert isinstance(spec.road.imported, MapNetwork)
    trace = simulate_in_subprocess(spec, write_sumo_network(spec.road, tmp_path / "net"))
    assert len(trace) == 61
    first = trace.states[trace.states["actor"] == 0][0]
    assert first["y"] == pytest.approx(-100 + DEPART_M + SPEED_M_S * 2 - 2.5, abs=0.85)
