"""Roads from maps: OpenDRIVE, OpenStreetMap and SUMO files become places like the authored ones."""

import base64
import hashlib
import os
import shutil
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import shapely
import yaml
from advercity_dsl import MapFile, MapNetwork, Road, Spec, Vehicle
from advercity_dsl.units import Point2
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from advercity.compiler import read_spec, write_specs
from advercity.compiler.crossing import compile_library
from advercity.errors import InputError
from advercity.frames import Trace
from advercity.geometry.mesh import Mesh
from advercity.roads.lane_graph import read_lane_graph
from advercity.roads.lane_segments import LaneSegment
from advercity.roads.map_import import import_map
from advercity.roads.network_file import read_signal_groups
from advercity.roads.plan_drawing import LANE_COLOURS, draw_plan
from advercity.roads.road_meshes import KERB_HEIGHT_M
from advercity.roads.road_network import RoadNetwork, build_road
from advercity.roads.sumo_network import write_sumo_network
from advercity.roads.sumo_xml import (
    MAX_XML_BYTES,
    pack_network,
    parse_xml,
    to_xml_bytes,
    unpack_network,
)
from advercity.scene.build import build_world
from advercity.semantics import Semantic
from advercity.traffic.simulation import simulate_in_subprocess

DATA = Path(__file__).parents[1] / "data/maps"
TOWN07 = os.environ.get("ADVERCITY_TOWN07")
ABOVE_M = 60.0

Floats = NDArray[np.float64]
Shot = tuple[Floats, NDArray[np.int64]]


def vehicle(
    spawn: Point2, heading: float, destination: Point2, role: str = "other"
) -> dict[str, object]:
    return {
        "kind": "vehicle",
        "role": role,
        "spawn_m": list(spawn),
        "heading_deg": heading,
        "destination_m": list(destination),
        "max_speed_km_h": 40,
    }


def declaration(source: str, file: str, **more: object) -> dict[str, object]:
    """A road from a map, with nobody on it."""
    return {
        "kind": "road",
        "id": "imported",
        "land_use": "rural",
        "junction": "intersection",
        "alignment": "straight",
        "profile": "level",
        "imported": {"source": source, "file": file},
        "agents": {},
        "traffic": {
            "vehicles_per_area": 1,
            "walkers": 8,
            "crossing_share": 0.5,
            "around_agent_m": 50,
            "around_path_m": 15,
            "classes": {"car": 0.8, "van": 0.2, "truck": 0, "bicycle": 0, "motorcycle": 0},
        },
        **more,
    }


SUITE = {
    "kind": "suite",
    "id": "imports",
    "roads": "all",
    "weathers": ["clear_day"],
    "densities": ["sparse"],
    "rig": "adver_city",
    "catalogue": "adver_city",
    "timing": {"warm_up_ticks": 10, "max_ticks": 900},
}
BEND = declaration(
    "opendrive",
    "bend.xodr",
    agents={
        "cav1": vehicle((20, -1.75), 0, (125, 3), "ego"),
        "cav2": vehicle((138.26, 16.08), -137, (2, 1.75)),
    },
)
CROSSROADS = declaration(
    "osm",
    "crossroads.osm",
    origin_lat_deg=48,
    origin_lon_deg=11,
    agents={
        "cav1": vehicle((1.6, -60), 90, (-60, 1.6), "ego"),
        "cav2": vehicle((-1.6, 70), -90, (-1.6, -185)),
        "cav3": vehicle((60, 1.6), 180, (1.6, 185)),
        "rsu": {"kind": "roadside_unit", "position_m": [12, -12, 6], "yaw_deg": 135},
    },
)


def compiled(library: Path, folder: Path, road: dict[str, object]) -> Spec:
    """The spec of an imported road, beside the library's own."""
    for kind, data in (("road", road), ("suite", SUITE)):
        (folder / f"{kind}.yaml").write_text(yaml.safe_dump(data), encoding="utf-8")
    for path in DATA.iterdir():
        shutil.copy(path, folder)
    specs = {spec.id: spec for spec in compile_library(library, folder, suite="imports")}
    return specs["imported_clear_day_sparse"]


@pytest.fixture(scope="module")
def bend(library: Path, tmp_path_factory: pytest.TempPathFactory) -> Spec:
    return compiled(library, tmp_path_factory.mktemp("bend"), BEND)


@pytest.fixture(scope="module")
def crossroads(library: Path, tmp_path_factory: pytest.TempPathFactory) -> Spec:
    return compiled(library, tmp_path_factory.mktemp("crossroads"), CROSSROADS)


@pytest.fixture(scope="module")
def authored(specs: dict[str, Spec]) -> Spec:
    return specs["ui_clear_day_sparse"]


@pytest.fixture(scope="module")
def reimported(library: Path, authored: Spec, tmp_path_factory: pytest.TempPathFactory) -> Spec:
    """The urban intersection, from the SUMO network that was built of its declaration."""
    folder = tmp_path_factory.mktemp("reimported")
    write_sumo_network(authored.road, folder).rename(folder / "ui.net.xml")
    agents = {
        name: agent.model_copy(update={"route": ()}) if isinstance(agent, Vehicle) else agent
        for name, agent in authored.road.agents.items()
    }
    dumped = {name: agent.model_dump(mode="json") for name, agent in agents.items()}
    return compiled(library, folder, declaration("sumo", "ui.net.xml", agents=dumped))


def lane_near(road: RoadNetwork, x: float, y: float, kind: str = "driving") -> LaneSegment:
    """The lane between junctions whose middle is nearest to a point."""

    def gap(lane: LaneSegment) -> float:
        middle = (lane.left + lane.right)[:, :2] / 2
        return float(shapely.LineString(middle).distance(shapely.Point(x, y)))

    return min((lane for lane in road.lanes if lane.kind == kind), key=gap)


def looking_down(meshes: list[Mesh] | tuple[Mesh, ...]) -> Callable[[Floats], Shot]:
    corners = np.concatenate([mesh.vertices[mesh.triangles] for mesh in meshes])
    classes = np.concatenate([np.full(len(m.triangles), m.semantic.value) for m in meshes])
    scene = EmbreeScene()
    TriangleMesh(scene, corners)

    def below(points: Floats) -> Shot:
        starts = np.column_stack([points[:, :2], np.full(len(points), ABOVE_M)]).astype(np.float32)
        down = np.tile(np.array([0, 0, -1], dtype=np.float32), (len(points), 1))
        hits = scene.run(starts, down, output=True)
        assert (hits["primID"] >= 0).all(), "a hole"
        return ABOVE_M - hits["tfar"], classes[hits["primID"]]

    return below


def on_lane(lane: LaneSegment, step_m: float = 0.7) -> Floats:
    """Points (n, 3) along and across a lane, clear of its borders."""
    along = shapely.LineString((lane.left + lane.right)[:, :2] / 2).length
    share = np.linspace(0.02, 0.98, max(3, int(along / step_m)))
    left, right = (
        np.array(
            [
                shapely.get_coordinates(
                    shapely.LineString(line).interpolate(at, normalized=True), include_z=True
                )[0]
                for at in share
            ]
        )
        for line in (lane.left, lane.right)
    )
    return np.concatenate([left + across * (right - left) for across in (0.15, 0.5, 0.85)])


def road_meshes(spec: Spec, tmp_path: Path) -> tuple[Mesh, ...]:
    world = build_world(spec, write_sumo_network(spec.road, tmp_path))
    return tuple(
        mesh for mesh in world.static if not mesh.name.startswith(("furniture", "surroundings"))
    )


def test_opendrive_lanes_lie_where_the_map_has_them(bend: Spec) -> None:
    road = build_road(bend.road)

    right = lane_near(road, 50, -1.75)
    left = lane_near(road, 50, 1.75)
    walk = lane_near(road, 50, -4.5, "sidewalk")

    np.testing.assert_allclose(right.left[:, 1], 0, atol=0.005)
    np.testing.assert_allclose(right.right[:, 1], -3.5, atol=0.005)
    np.testing.assert_allclose(left.right[:, 1], 3.5, atol=0.005)
    np.testing.assert_allclose(walk.right[:, 1], -5.5, atol=0.005)
    assert right.left[0, 0] < right.left[-1, 0]
    assert left.left[0, 0] > left.left[-1, 0]


def test_opendrive_bends_and_grades_are_kept(bend: Spec) -> None:
    outer = lane_near(build_road(bend.road), 125.5, 3.9)
    from_centre = np.linalg.norm(outer.left[:, :2] - (100, 60), axis=1)
    turned = np.arctan2(outer.left[:, 0] - 100, 60 - outer.left[:, 1])

    np.testing.assert_allclose(from_centre, 60, atol=0.02)
    np.testing.assert_allclose(outer.left[:, 2], 0.05 * 60 * turned, atol=0.02)


def test_osm_lanes_lie_around_the_declared_origin(crossroads: Spec) -> None:
    road = build_road(crossroads.road)

    east = lane_near(road, 100, -1.6)
    ends = (east.left + east.right)[:, :2] / 2

    # One degree of longitude on WGS84 at 48 degrees north is 74 625 m, of latitude 111 200 m.
    assert ends[:, 0].max() == pytest.approx(0.0027 * 74_625, abs=0.3)
    np.testing.assert_allclose(ends[:, 1], -1.6, atol=0.02)
    assert max(lane.left[:, 1].max() for lane in road.lanes) == pytest.approx(
        0.0018 * 111_200, abs=0.5
    )
    assert {lane.kind for lane in road.lanes} == {"driving", "sidewalk", "crossing"}


def test_a_sumo_network_comes_back_as_it_was(authored: Spec, reimported: Spec) -> None:
    def middles(road: Road) -> list[shapely.LineString]:
        return [
            shapely.LineString((lane.left + lane.right)[:, :2] / 2)
            for lane in build_road(road).lanes
            if lane.kind == "driving" and not lane.in_junction
        ]

    ours, theirs = middles(authored.road), middles(reimported.road)

    assert len(theirs) == len(ours)
    for line in ours:
        gaps = [line.hausdorff_distance(other) for other in theirs]
        assert min(gaps) < 0.05


@pytest.mark.parametrize("name", ["bend", "crossroads", "reimported"])
def test_every_lane_is_on_asphalt_at_its_height(
    name: str, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    spec: Spec = request.getfixturevalue(name)
    below = looking_down(road_meshes(spec, tmp_path))
    walkable = (Semantic.SIDEWALK.value, Semantic.ROAD_LINE.value, Semantic.ROAD.value)

    for lane in build_road(spec.road).lanes:
        points = on_lane(lane)
        z, found = below(points)
        if lane.kind == "sidewalk":
            np.testing.assert_allclose(z, points[:, 2] + KERB_HEIGHT_M, atol=0.03)
            assert (found == Semantic.SIDEWALK.value).all(), lane.id
        elif lane.in_junction:
            assert np.isin(found, walkable).all(), lane.id
            assert np.abs(z - points[:, 2]).max() < 0.2, lane.id
        elif lane.kind == "driving":
            assert np.isin(found, (Semantic.ROAD.value, Semantic.ROAD_LINE.value)).all(), lane.id
            np.testing.assert_allclose(z, points[:, 2], atol=0.02)


def test_the_ground_meets_the_edge_of_an_imported_road(bend: Spec, tmp_path: Path) -> None:
    below = looking_down(road_meshes(bend, tmp_path))

    north, south = np.array([[50.0, 4.0]]), np.array([[50.0, -6.0]])

    assert below(north)[1] == below(south)[1] == Semantic.TERRAIN.value
    assert below(north)[0] == pytest.approx(0.0, abs=0.03)
    assert below(south)[0] == pytest.approx(KERB_HEIGHT_M, abs=0.03)


def test_every_approach_to_imported_signals_has_a_head_that_faces_it(
    crossroads: Spec, tmp_path: Path
) -> None:
    road = build_road(crossroads.road)
    groups = read_signal_groups(write_sumo_network(crossroads.road, tmp_path))

    assert len(road.traffic_lights) == 4
    for head in road.traffic_lights:
        assert head.id in groups
        # Traffic comes from the side that the head looks to, and stops short of the crossing.
        assert np.dot(head.position_m[:2], head.facing) < -5
        assert not shapely.Point(head.mast_foot_m).within(road.roadway_level_area)
        assert 5 < head.position_m[2] < 7


def test_the_plan_of_an_imported_road_shows_it(crossroads: Spec) -> None:
    plan = draw_plan(build_road(crossroads.road))
    colours = {tuple(colour) for colour in np.unique(plan.reshape(-1, 3), axis=0).tolist()}

    assert {LANE_COLOURS["driving"], LANE_COLOURS["sidewalk"], LANE_COLOURS["crossing"]} <= colours
    assert (plan == LANE_COLOURS["driving"]).all(axis=2).mean() > 0.01


def positions(trace: Trace, number: int) -> Floats:
    index = next(at for at, actor in enumerate(trace.actors) if actor.id == number)
    rows = trace.states[trace.states["actor"] == index]
    return np.column_stack([rows["x"], rows["y"], rows["z"], rows["speed"], rows["tick"]])


@pytest.mark.sumo
@pytest.mark.parametrize("name", ["bend", "crossroads", "reimported"])
def test_connected_vehicles_drive_to_their_destinations(
    name: str, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    spec: Spec = request.getfixturevalue(name)
    trace = simulate_in_subprocess(spec, write_sumo_network(spec.road, tmp_path))
    gaps: list[float] = []
    for agent in spec.agents:
        if isinstance(agent.place, Vehicle):
            rows = positions(trace, agent.number)
            assert (np.diff(rows[:, 4]) == 1).all()
            steps = np.linalg.norm(np.diff(rows[:, :2], axis=0), axis=1)
            assert (steps <= 1.3 * rows[1:, 3] * trace.tick_s + 0.12).all()
            gaps.append(float(np.abs(rows[-1, :2] - agent.place.destination_m).max()))
    assert len(trace) < 800
    assert min(gaps) < 12


@pytest.mark.sumo
def test_the_shortest_way_is_that_of_the_declared_route(
    authored: Spec, reimported: Spec, tmp_path: Path
) -> None:
    """The ego's way over the re-imported network leads along the streets of the authored one."""
    first, second = (
        simulate_in_subprocess(spec, write_sumo_network(spec.road, tmp_path / name))
        for name, spec in (("authored", authored), ("imported", reimported))
    )

    declared, found = (
        shapely.LineString(positions(trace, 101)[:, :2]) for trace in (first, second)
    )
    longer, shorter = sorted((declared, found), key=lambda line: -line.length)
    assert shorter.length > 60
    assert max(longer.distance(shapely.Point(place)) for place in shorter.coords) < 2


def test_a_spec_needs_its_map_no_more(library: Path, tmp_path: Path) -> None:
    maps, specs = tmp_path / "maps", tmp_path / "specs"
    maps.mkdir()
    spec = compiled(library, maps, CROSSROADS)
    again = compiled(library, maps, CROSSROADS)
    write_specs([spec], specs)
    shutil.rmtree(maps)

    read = read_spec(specs / "imported_clear_day_sparse.json")

    assert read == spec == again
    assert isinstance(read.road.imported, MapNetwork)
    networks = [write_sumo_network(read.road, tmp_path / name).read_bytes() for name in ("a", "b")]
    assert networks[0] == networks[1]
    assert len(read_lane_graph(tmp_path / "a" / "imported.net.xml").driving_lanes) == 8
    assert str(tmp_path) not in (specs / "imported_clear_day_sparse.json").read_text()


def test_the_extent_leaves_out_what_lies_beyond_it(tmp_path: Path) -> None:
    road = Road.model_validate(CROSSROADS)

    def lanes(extent: tuple[Point2, Point2] | None) -> int:
        declared = MapFile(source="osm", file="crossroads.osm", extent_m=extent)
        network = import_map(declared, road, DATA)
        return len(build_road(road.model_copy(update={"imported": network})).lanes)

    assert lanes(((-10, 10), (10, 190))) < lanes(None)
    with pytest.raises(InputError, match="within `extent_m`"):
        lanes(((500, 500), (600, 600)))


@pytest.mark.parametrize(
    ("source", "text", "complaint"),
    [
        ("opendrive", "<OpenDRIVE><road", "is not XML"),
        ("opendrive", "", "is not XML"),
        ("opendrive", "no map at all", "is not XML"),
        ("opendrive", "<OpenDRIVE/>", "bad.map: "),
        ("opendrive", "<osm/>", "begins with <osm>, not <OpenDRIVE>; say `source: osm`"),
        ("osm", "<html/>", "begins with <html>, not <osm>"),
        ("osm", "<osm/>", "has no nodes"),
        ("osm", "<osm><node id='1'/></osm>", "without latitude and longitude"),
        ("osm", "<osm><node id='1' lat='-33' lon='151'/></osm>", "`origin_lat_deg: -33.00000`"),
        ("sumo", "<net/>", "bad.map: "),
        ("sumo", "<net>" + "<a>" * 100 + "</a>" * 100 + "</net>", "deeper than"),
        (
            "opendrive",
            "<!DOCTYPE a [<!ENTITY b 'c'><!ENTITY d '&b;&b;&b;'>]><OpenDRIVE>&d;</OpenDRIVE>",
            "document type",
        ),
        ("osm", "<!DOCTYPE osm SYSTEM 'http://localhost/a.dtd'><osm/>", "document type"),
        (
            "sumo",
            "<!DOCTYPE net [<!ENTITY a SYSTEM 'file:///etc/passwd'>]><net>&a;</net>",
            "document type",
        ),
    ],
)
def test_broken_and_hostile_maps_are_told_with_their_place(
    source: str,
    text: str,
    complaint: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from advercity.cli import main

    (tmp_path / "bad.map").write_text(text, encoding="utf-8")
    (tmp_path / "road.yaml").write_text(yaml.safe_dump(declaration(source, "bad.map")))
    monkeypatch.setattr("sys.argv", ["advercity", "validate", str(tmp_path / "road.yaml")])

    with pytest.raises(SystemExit) as left:
        main()

    said = capsys.readouterr().err
    assert left.value.code == 2
    assert complaint in said
    assert "road.yaml:" in said
    assert "imported.file" in said
    assert "Traceback" not in said
    assert "root:" not in said


@pytest.mark.parametrize(
    ("file", "complaint"),
    [
        ("nowhere.xodr", "there is no such file"),
        ("/etc/passwd", "is an absolute path"),
        (".", "there is no such file"),
    ],
)
def test_a_path_that_is_no_map_is_refused(file: str, complaint: str, tmp_path: Path) -> None:
    road = Road.model_validate(declaration("opendrive", file))

    with pytest.raises(InputError, match=complaint):
        import_map(MapFile(source="opendrive", file=file), road, tmp_path)


def test_another_map_under_the_same_name_is_refused() -> None:
    """Validator V11."""
    origin = {"origin_lat_deg": 48.0, "origin_lon_deg": 11.0}
    road = Road.model_validate(declaration("osm", "crossroads.osm", **origin))
    right = hashlib.sha256((DATA / "crossroads.osm").read_bytes()).hexdigest()

    network = import_map(MapFile(source="osm", file="crossroads.osm", sha256=right), road, DATA)
    with pytest.raises(InputError, match=f"made for: its sha256 is {right}; fetch the right one"):
        import_map(MapFile(source="osm", file="crossroads.osm", sha256="0" * 64), road, DATA)

    assert network.sha256 == right


def test_a_huge_file_is_refused_unparsed() -> None:
    with pytest.raises(InputError, match="at most"):
        parse_xml(b" " * (MAX_XML_BYTES + 1))


def test_a_network_that_inflates_without_end_is_refused() -> None:
    bomb = base64.b64encode(zlib.compress(b" " * (MAX_XML_BYTES + 1), 9)).decode()

    with pytest.raises(InputError, match="inflates to more than"):
        unpack_network(bomb)


def test_a_network_brings_nothing_that_writes_files() -> None:
    hostile = b"""<net version="1.20">
      <location netOffset="0,0" projParameter="+proj=tmerc +nadgrids=/etc/passwd"/>
      <e1Detector id="d" lane="a_0" freq="1" file="out.xml"/>
      <edge id="a" from="x" to="y"><param key="k" value="v"/>
        <lane id="a_0" index="0" speed="1" length="9" shape="0,0 9,0"/></edge>
      <tlLogic id="t" type="actuated" programID="0" offset="0">
        <param key="file" value="out.xml"/><phase duration="9" state="G"/></tlLogic>
    </net>"""

    kept = to_xml_bytes(unpack_network(pack_network(parse_xml(hostile)))).decode()

    assert 'id="a_0"' in kept
    assert 'type="static"' in kept
    for word in ("Detector", "out.xml", "param key", "passwd", "actuated"):
        assert word not in kept


def test_a_road_is_authored_or_imported_but_not_both() -> None:
    streets = {"streets": {"a": {}}}

    with pytest.raises(ValueError, match="streets"):
        Road.model_validate(declaration("osm", "a.osm") | streets)
    with pytest.raises(ValueError, match="a road has 'streets', or a map"):
        Road.model_validate(declaration("osm", "a.osm") | {"imported": None})


def test_a_route_of_street_names_is_refused_on_an_imported_road() -> None:
    agent = {**vehicle((0, 0), 0, (9, 0)), "route": ["main_road"]}

    with pytest.raises(ValueError, match="leave the route out"):
        Road.model_validate(declaration("osm", "a.osm", agents={"cav1": agent}))


@pytest.mark.sumo
def test_a_destination_that_no_way_leads_to_is_bad_input(bend: Spec, tmp_path: Path) -> None:
    agents = tuple(
        agent.model_copy(
            update={"place": agent.place.model_copy(update={"destination_m": (500.0, 500.0)})}
        )
        for agent in bend.agents
    )

    with pytest.raises(InputError, match="no route leads from lane"):
        simulate_in_subprocess(
            bend.model_copy(update={"agents": agents}), write_sumo_network(bend.road, tmp_path)
        )


@pytest.mark.sumo
@pytest.mark.skipif(TOWN07 is None, reason="ADVERCITY_TOWN07 does not name the map's file")
def test_town07_builds_and_is_driven(library: Path, tmp_path: Path) -> None:
    example = library.parent / "examples" / "town07"
    shutil.copytree(example, tmp_path / "town07")
    shutil.copy(str(TOWN07), tmp_path / "town07" / "Town07.xodr")
    specs = compile_library(library, tmp_path / "town07", suite="town07")
    spec = next(spec for spec in specs if spec.id == "town07_clear_day_sparse")
    below = looking_down(road_meshes(spec, tmp_path))

    for lane in build_road(spec.road).lanes:
        if lane.kind == "driving" and not lane.in_junction:
            points = on_lane(lane)
            z, found = below(points)
            assert np.isin(found, (Semantic.ROAD.value, Semantic.ROAD_LINE.value)).mean() > 0.97
            assert np.quantile(np.abs(z - points[:, 2]), 0.97) < 0.02, lane.id
    trace = simulate_in_subprocess(spec, write_sumo_network(spec.road, tmp_path))
    assert len(trace) > 100
