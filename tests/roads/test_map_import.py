"""Import of OpenDRIVE, OpenStreetMap and SUMO files, and what it refuses."""

import hashlib
import re
import shutil
from pathlib import Path
from xml.etree.ElementTree import tostring

import pytest
import yaml
from advercity_dsl import MapFile, MapNetwork, Road
from advercity_dsl.units import Point2

from advercity.compiler import read_spec, write_specs
from advercity.errors import InputError
from advercity.foreign.xml_documents import parse_xml
from advercity.roads import sumo_network
from advercity.roads.lane_graph import read_lane_graph
from advercity.roads.map_import import import_map
from advercity.roads.network_file import parse_packed_network
from advercity.roads.road_network import build_road
from advercity.roads.sumo_network import write_sumo_network
from tests.command_line import Command
from tests.roads.imported_roads import CROSSROADS, DATA, compiled, declaration, vehicle


def test_a_spec_does_not_need_its_map(library: Path, tmp_path: Path) -> None:
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
    ("land_use", "tag", "sidewalks"),
    [("urban", "", 8), ("rural", "", 0), ("urban", '<tag k="sidewalk" v="no"/>', 0)],
)
def test_streets_of_a_town_have_sidewalks_if_its_map_does_not_say(
    land_use: str, tag: str, sidewalks: int, tmp_path: Path
) -> None:
    """Four streets meet, with one at each side, as maps of towns have them without saying so."""
    text = (DATA / "crossroads.osm").read_text(encoding="utf-8")
    text = text.replace('<tag k="sidewalk" v="both"/>', tag)
    (tmp_path / "crossroads.osm").write_text(text, encoding="utf-8")
    road = Road.model_validate(CROSSROADS | {"land_use": land_use})
    declared = MapFile(source="osm", file="crossroads.osm")
    network = import_map(declared, road, tmp_path)
    lanes = build_road(road.model_copy(update={"imported": network})).lanes
    assert sum(it.kind == "sidewalk" and not it.in_junction for it in lanes) == sidewalks


def test_elements_of_an_extract_may_be_in_any_order(tmp_path: Path) -> None:
    root = parse_xml((DATA / "crossroads.osm").read_bytes())
    root[:] = reversed(root)
    (tmp_path / "reversed.osm").write_bytes(tostring(root))
    road = Road.model_validate(CROSSROADS)

    networks = [
        import_map(MapFile(source="osm", file=file), road, folder)
        for file, folder in (("crossroads.osm", DATA), ("reversed.osm", tmp_path))
    ]

    lanes = [sorted(lane.id for lane in parse_packed_network(it.network).lanes) for it in networks]
    assert lanes[0] == lanes[1]
    assert [it.name for it in networks[0].left_out] == [it.name for it in networks[1].left_out]


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
def test_broken_and_hostile_maps_are_reported_with_file_and_line(
    source: str,
    text: str,
    complaint: str,
    tmp_path: Path,
    advercity: Command,
) -> None:
    (tmp_path / "bad.map").write_text(text, encoding="utf-8")
    (tmp_path / "road.yaml").write_text(yaml.safe_dump(declaration(source, "bad.map")))
    code, _, said = advercity("validate", tmp_path / "road.yaml")
    assert code == 2
    assert complaint in said
    assert "road.yaml:" in said
    assert "imported.file" in said
    assert "Traceback" not in said
    assert "root:" not in said


STREET = """<OpenDRIVE>
  <header revMajor="1" revMinor="6"/>
  <road name="Mill Road" length="200" id="1" junction="-1">
    <planView><geometry s="0" x="0" y="0" hdg="0" length="200"><line/></geometry></planView>
    <elevationProfile><elevation s="0" a="0" b="0" c="0" d="0"/></elevationProfile>
    <lanes><laneSection s="0">
      <center><lane id="0" type="none"/></center>
      <right><lane id="-1" type="driving">
        <width sOffset="0" a="3.5" b="0" c="0" d="0"/>
      </lane></right>
    </laneSection></lanes>
  </road>
</OpenDRIVE>"""


@pytest.mark.parametrize(
    ("found", "damaged", "complaint"),
    [
        ('a="3.5"', 'a="nan"', "line 9: <width>: a is 'nan', which is no number to build with"),
        ('a="3.5"', 'a="1e30"', "line 9: <width>: a is '1e30'"),
        ('a="3.5"', 'a="70"', "line 8: <lane>: is 70 m wide; lanes are at most 60 m wide"),
        ("<line/>", '<spiral curvStart="0" curvEnd="1e9"/>', "line 4: <spiral>: its curvature"),
        ('length="200"', 'length="100000"', "its lanes are 100000 m from west to east"),
        ('length="200"', 'length="1000000"', "its roads are longer than 500 km together"),
        ('length="200"', 'length=""', "line 3: <road>: has no attribute 'length'"),
        ('<elevation s="0" a="0"', '<elevation s="0" a="1e7"', "a lane 1e+07 m above zero"),
    ],
)
def test_a_street_that_no_world_could_have_is_refused(
    found: str, damaged: str, complaint: str, tmp_path: Path
) -> None:
    road = Road.model_validate(declaration("opendrive", "street.xodr"))
    declared = MapFile(source="opendrive", file="street.xodr")
    (tmp_path / "street.xodr").write_text(STREET, encoding="utf-8")
    import_map(declared, road, tmp_path)

    (tmp_path / "street.xodr").write_text(STREET.replace(found, damaged), encoding="utf-8")
    with pytest.raises(InputError, match=re.escape(complaint)):
        import_map(declared, road, tmp_path)


@pytest.mark.parametrize("latitude", ["nan", "inf", "91"])
def test_a_node_that_is_not_on_the_globe_is_named(latitude: str, tmp_path: Path) -> None:
    road = Road.model_validate(CROSSROADS)
    text = (DATA / "crossroads.osm").read_text(encoding="utf-8")
    text = re.sub(r'lat="[^"]*"', f'lat="{latitude}"', text, count=1)
    (tmp_path / "crossroads.osm").write_text(text, encoding="utf-8")

    with pytest.raises(InputError, match=f"a node at latitude {latitude} and longitude 1"):
        import_map(MapFile(source="osm", file="crossroads.osm"), road, tmp_path)


def test_an_extract_of_service_roads_alone_says_what_it_lacks(tmp_path: Path) -> None:
    text = (DATA / "crossroads.osm").read_text().replace('v="secondary"', 'v="service"')
    (tmp_path / "yard.osm").write_text(text)
    place = {"origin_lat_deg": 48.0, "origin_lon_deg": 11.0}
    road = Road.model_validate(declaration("osm", "yard.osm", **place))

    with pytest.raises(InputError, match=r"yard\.osm: has no street for cars, of which service"):
        import_map(MapFile(source="osm", file="yard.osm"), road, tmp_path)


def test_a_map_that_takes_netconvert_too_long_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sumo_network, "NETCONVERT_TIMEOUT_S", 0.001)
    road = Road.model_validate(CROSSROADS)

    with pytest.raises(InputError, match="netconvert cannot use it: it takes longer than"):
        import_map(MapFile(source="osm", file="crossroads.osm"), road, DATA)


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


def test_a_road_is_authored_or_imported_but_not_both() -> None:
    streets = {"streets": {"a": {}}}

    with pytest.raises(ValueError, match="streets"):
        Road.model_validate(declaration("osm", "a.osm") | streets)
    with pytest.raises(ValueError, match="a road needs 'streets' or an 'imported' map"):
        Road.model_validate(declaration("osm", "a.osm") | {"imported": None})


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (
            {"route": ["road_12_1", "grosse_strase_1"]},
            r"cav1.route: unknown street 'grosse_strase_1'.*did you mean 'grosse_strasse_1'",
        ),
        (
            {"route": ["road_12_1", "road_12_1"]},
            "cav1.route: no movement leads from 'road_12_1' into 'road_12_1'.*grosse_strasse_1",
        ),
        (
            {"heading_deg": 90},
            r"cav1.heading_deg: no driving lane at -60, -1.6 leads 90 degrees.*"
            r"nearest: road_12_1.1 at \[-60.0, -1.6\] heading 0",
        ),
        (
            {"spawn_m": [-60, 1.6]},
            r"cav1.heading_deg: no driving lane at -60, 1.6 leads 0 degrees.*heading 180",
        ),
        (
            {"destination_m": [-110, -1.6]},
            r"cav1.destination_m: no route leads.*nearest to the destination: road_12_1.1",
        ),
    ],
)
def test_a_vehicle_on_a_map_is_checked_when_it_is_compiled(
    library: Path, tmp_path: Path, change: dict[str, object], complaint: str
) -> None:
    agent = vehicle((-60, -1.6), 0, (60, -1.6), "ego") | change
    # A street along x: east of the junction, in the middle, and the way back is not connected.
    road = {**CROSSROADS, "agents": {"cav1": agent}}

    with pytest.raises(InputError, match=f"(?s)road.yaml:.*{complaint}"):
        compiled(library, tmp_path, road)


def test_a_surrounding_along_an_unknown_street_of_a_map_is_reported(
    library: Path, tmp_path: Path
) -> None:
    trees = {"kind": "trees", "beside": {"street": "road_12", "side": "left"}}
    road = {**CROSSROADS, "surroundings": [trees]}

    with pytest.raises(InputError, match=r"road.yaml:.*unknown street 'road_12'"):
        compiled(library, tmp_path, road)
