"""OpenSCENARIO with OpenDRIVE: places by hand, ASAM's schemas, and the way back."""

import math
import shutil
from pathlib import Path
from xml.etree.ElementTree import Element, parse

import numpy as np
import pytest
import shapely
from advercity_dsl import MapFile, Spec
from advercity_exports.openscenario import format_scenario, load_dataset_traffic
from advercity_exports.site_opendrive import format_site

from advercity.compiler.recorded_roads import (
    ReplayChoice,
    load_recorded_scenario,
    write_recorded_road,
)
from advercity.dataset.reader import open_dataset
from advercity.errors import InputError
from advercity.exports.exporting import export_dataset
from advercity.pipeline.preparation import load_or_simulate_traffic
from advercity.recordings.openscenario.scenario import read_scenario
from advercity.roads.map_import import import_map
from advercity.roads.network_file import parse_packed_network, read_network
from advercity.roads.sumo_network import write_sumo_network
from tests.exports.readers import needs_readers, run_reader
from tests.exports.recorded_dataset import recorded_dataset as recorded_dataset  # a fixture

NAME = "hill_fog_day_sparse"


@pytest.fixture(scope="module")
def exported(recorded_dataset: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("scenariogeneration")
    output = tmp_path_factory.mktemp("openscenario") / "out"
    return export_dataset("openscenario", recorded_dataset, output).output / NAME


@pytest.fixture(scope="module")
def document(exported: Path) -> Element:
    return parse(exported / f"{NAME}.xosc").getroot()


def find_entity(document: Element, name: str) -> Element:
    (found,) = document.findall(f"Entities/ScenarioObject[@name='{name}']/*")
    return found


def test_positions_are_those_of_rear_axles(document: Element) -> None:
    ego, other = (find_entity(document, name) for name in ("ego", "car_1001"))
    box = ego.find("BoundingBox/Dimensions")
    centre = ego.find("BoundingBox/Center")
    assert box is not None and centre is not None
    length = float(box.attrib["length"])
    assert float(centre.attrib["x"]) == pytest.approx(0.3 * length)
    axle = ego.find("Axles/FrontAxle")
    assert axle is not None
    assert float(axle.attrib["positionX"]) == pytest.approx(0.6 * length)

    # After 2 s, the ego's middle is at x = 72 on a road that climbs by 3 %.
    place = find_vertex(document, "ego", 2.0)
    climb = math.atan(0.03)
    assert float(place["x"]) == pytest.approx(72 - 0.3 * length * math.cos(climb), abs=1e-4)
    assert float(place["z"]) == pytest.approx(0.03 * float(place["x"]), abs=2e-3)
    assert (float(place["y"]), float(place["h"])) == (-1.75, 0.0)
    assert float(place["p"]) == pytest.approx(-climb, abs=1e-3)  # nose up is negative
    # The other car drives to the west, and has its rear axle in the east.
    other_centre = other.find("BoundingBox/Center")
    assert other_centre is not None
    behind = float(other_centre.attrib["x"]) * math.cos(climb)
    place = find_vertex(document, "car_1001", 2.0)
    assert float(place["x"]) == pytest.approx(144 + behind, abs=1e-4)
    assert abs(float(place["h"])) == pytest.approx(math.pi, abs=1e-5)


def find_vertex(document: Element, name: str, time_s: float) -> dict[str, str]:
    (trajectory,) = (
        item for item in document.iter("Trajectory") if item.get("name") == f"{name}_trajectory"
    )
    (vertex,) = (item for item in trajectory.iter("Vertex") if float(item.attrib["time"]) == time_s)
    (place,) = vertex.iter("WorldPosition")
    return place.attrib


def test_weather_is_that_of_the_scenario(recorded_dataset: Path, document: Element) -> None:
    weather = open_dataset(recorded_dataset).scenarios[0].spec.weather
    found = {item.tag: item.attrib for item in document.find(".//Environment") or ()}
    inner = {item.tag: item.attrib for item in document.iterfind(".//Environment/Weather/*")}
    assert weather.fog.mor_m == 75
    assert float(inner["Fog"]["visualRange"]) == pytest.approx(75, rel=0.02)  # haze adds a little
    assert inner["Precipitation"]["precipitationType"] == "dry"
    # OpenSCENARIO has where the wind blows to, counter-clockwise from east: from 250 degrees, which
    # is west-south-west, it blows to 20 degrees north of east.
    assert weather.wind.from_deg == 250
    assert float(inner["Wind"]["direction"]) == pytest.approx(math.radians(20))
    assert found["RoadCondition"]["frictionScaleFactor"]


@needs_readers
def test_both_documents_are_valid_by_the_schemas_of_asam(exported: Path) -> None:
    found = run_reader("read_openscenario.py", *exported.iterdir())
    assert found == {f"{NAME}.xosc": [], "site.xodr": []}


def test_its_library_reads_what_it_wrote(exported: Path, document: Element) -> None:
    xosc = pytest.importorskip("scenariogeneration.xosc")
    read = xosc.ParseOpenScenario(str(exported / f"{NAME}.xosc"))
    assert len(read.entities.scenario_objects) == 4
    assert read.get_element().tag == "OpenSCENARIO"
    again = [item.attrib for item in read.get_element().iter("WorldPosition")]
    assert len(again) == len(list(document.iter("WorldPosition")))


def test_what_was_exported_is_imported_as_the_same_traffic(
    exported: Path, recorded_dataset: Path, tmp_path: Path
) -> None:
    traffic = load_dataset_traffic(open_dataset(recorded_dataset).scenarios[0]).trace
    recording = load_recorded_scenario(exported / f"{NAME}.xosc")
    choice = ReplayChoice(name="again", connected=["cav2"], looks="shaped")
    (spec,) = write_recorded_road(recording, None, choice, tmp_path / "again")

    again = load_or_simulate_traffic(spec).trace

    assert len(again) == len(traffic)
    for actor in traffic.actors:
        other, rows = again.get_track(actor.id)
        _, expected = traffic.get_track(actor.id)
        assert (other.actor_class, other.size) == (actor.actor_class, actor.size)
        apart = np.hypot(rows["x"] - expected["x"], rows["y"] - expected["y"])
        assert apart.max() < 1e-5
        assert np.abs(rows["z"] - expected["z"]).max() < 1e-3
        assert np.cos(rows["yaw"] - expected["yaw"]) == pytest.approx(1.0, abs=1e-6)
        assert rows["speed"] == pytest.approx(expected["speed"], abs=0.01)


@pytest.mark.parametrize("road", ["ui", "unj", "ri", "rsnj", "rcnj"])
def test_the_site_is_imported_again_with_lanes_where_they_were(
    road: str, specs: dict[str, Spec], tmp_path: Path
) -> None:
    declared = specs[f"{road}_clear_day_sparse"].road
    network = write_sumo_network(declared, tmp_path)
    (tmp_path / "site.xodr").write_bytes(format_site(declared, network))

    imported = import_map(MapFile(source="opendrive", file="site.xodr"), declared, tmp_path)

    lanes = [lane for lane in read_network(network).lanes if lane.is_driving_lane]
    found = list(parse_packed_network(imported.network).lanes)
    assert sum(lane.is_driving_lane for lane in found) == len(lanes)
    lines = shapely.MultiLineString(
        [lane.centre[:, :2] for lane in found if lane.permits("passenger")]
    )
    for lane in lanes:
        points = lane.line.points_at(np.linspace(0, lane.length_m, 50))[:, :2]
        assert shapely.distance(lines, shapely.points(points)).max() < 0.1, lane.id


@pytest.mark.sumo
def test_lights_change_when_they_did(specs: dict[str, Spec], tmp_path: Path) -> None:
    """See the traffic of a junction with lights: of every link, the states by time."""
    pytest.importorskip("scenariogeneration")
    spec = specs["ui_clear_day_sparse"]
    traffic = load_or_simulate_traffic(spec)
    path = tmp_path / "ui.xosc"
    path.write_bytes(format_scenario(spec, traffic))

    document = parse(path).getroot()
    states: dict[str, list[tuple[float, str]]] = {}
    for event in document.iter("Event"):
        action = event.find("Action/GlobalAction/InfrastructureAction//TrafficSignalStateAction")
        time = event.find(".//SimulationTimeCondition")
        if action is not None and time is not None:
            change = float(time.attrib["value"]), action.attrib["state"]
            states.setdefault(action.attrib["name"], []).append(change)
    column = traffic.trace.signal_ids.index("j_main/east_road")
    shown = traffic.trace.signals[:, column].tolist()
    lamps = ["on;off;off", "off;on;off", "off;off;on"]
    assert states["j_main_8"][0] == (0.0, lamps[shown[0]])
    for tick, signal in enumerate(shown):
        last = [state for time, state in states["j_main_8"] if time <= tick / 10 + 1e-6][-1]
        assert last == lamps[signal]
    # All actors that are seen twice come back, those that enter and leave the site among them.
    read = read_scenario(path)
    tracks = {track.id: track for track in read.tracks}
    seen = [len(traffic.trace.get_track(actor.id)[1]) for actor in traffic.trace.actors]
    assert len(tracks) == sum(count > 1 for count in seen)
    listed = sum(part.count for part in read.left_out if "nowhere" in part.name)
    assert listed == len(seen) - len(tracks)
    for actor in traffic.trace.actors:
        name = f"{actor.actor_class}_{actor.id}"
        if name in tracks:
            _, rows = traffic.trace.get_track(actor.id)
            assert tracks[name].times_s[[0, -1]] == pytest.approx(
                rows["tick"][[0, -1]] / 10, abs=1e-6
            )


def test_traffic_that_is_not_that_of_the_dataset_is_refused(
    recorded_dataset: Path, tmp_path: Path
) -> None:
    pytest.importorskip("scenariogeneration")
    changed = shutil.copytree(recorded_dataset / NAME, tmp_path / "dataset" / NAME)
    manifest = changed / "manifest.json"
    digest = open_dataset(changed).scenarios[0].manifest.identity.trace_sha256
    assert digest is not None
    manifest.write_text(manifest.read_text().replace(digest, "0" * 64))
    with pytest.raises(InputError, match="simulates other traffic than the version of the"):
        export_dataset("openscenario", changed, tmp_path / "out")
