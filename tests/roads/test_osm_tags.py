"""Tags of OpenStreetMap extracts: each is taken over or listed."""

from pathlib import Path

import pytest
from advercity_dsl import MapFile, MapNetwork, Road
from hypothesis import given
from hypothesis import strategies as st

from advercity.foreign.ledger import Ledger, describe_left_out
from advercity.foreign.standards import is_disposition, list_dispositions, load_standard
from advercity.foreign.xml_documents import parse_xml
from advercity.roads.map_import import import_map
from advercity.roads.network_file import parse_packed_network
from advercity.roads.osm_tags import KNOWN_ZONES, audit_extract
from tests.roads.imported_roads import declaration

ROAD_KEYS = """
highway lanes lanes:forward lanes:backward lanes:both_ways oneway oneway:bicycle junction
maxspeed maxspeed:forward maxspeed:lanes maxspeed:conditional maxspeed:hgv zone:maxspeed
cycleway cycleway:left cycleway:right cycleway:both busway busway:left bus:lanes psv:lanes
hov hov:lanes sidewalk sidewalk:left sidewalk:both parking:left parking:lane:both crossing
traffic_calming bridge tunnel layer level width width:lanes surface incline placement
turn:lanes turn:lanes:forward change:lanes overtaking access motor_vehicle hgv maxheight
maxweight smoothness lit embankment cutting ford covered shoulder lane_markings railway
driving_side divider placement:forward vehicle:lanes access:conditional
"""
"""Keys of roads on the pages of OpenStreetMap's wiki."""
EDITOR_KEYS = """
bicycle bicycle_road bridge:name bridge:ref bus charge check_date construction cyclestreet
destination destination:ref destination:symbol expressway flood_prone foot hazard horse
horse_scale junction:ref maxaxleload maxlength maxspeed:advisory maxweightrating maxwidth
minspeed mtb:scale mtb:scale:imba mtb:scale:uphill name not:name note opening_date operator
parking:both parking:both:orientation parking:left:orientation parking:right
parking:right:orientation ref service sidewalk:right stroller toll tracktype trolley_wire
tunnel:name wheelchair
"""
"""Other keys that the editor iD offers for streets: openstreetmap/id-tagging-schema at 44eff2b8."""


def audit(tags: dict[str, str]) -> str:
    lines = "".join(f'<tag k="{key}" v="{value}"/>' for key, value in tags.items())
    text = f'<osm><way id="1"><tag k="highway" v="tertiary"/>{lines}</way></osm>'
    ledger = Ledger()
    audit_extract(parse_xml(text.encode()), {"1"}, ledger)
    return describe_left_out(ledger.left_out)


def test_the_table_has_every_key_of_roads() -> None:
    table = load_standard("osm")
    assert all(is_disposition(text) for _, _, text in list_dispositions(table))
    assert not [
        key for key in (ROAD_KEYS + EDITOR_KEYS).split() if "unknown" in audit({key: "some"})
    ]


@pytest.mark.parametrize(
    ("tags", "listed"),
    [
        ({"maxspeed": "50", "surface": "asphalt", "oneway": "yes", "name": "A"}, ""),
        ({"maxspeed": "50", "surface": "sett"}, "1 surface (asphalt is made) (line 1)"),
        (
            {"maxspeed": "50", "bus:lanes:both_ways": "designated"},
            "1 bus lane (open to cars) (line 1)",
        ),
        ({"maxspeed": "50", "cycleway:left": "track"}, "1 cycle lane (line 1)"),
        ({"maxspeed": "50", "cycleway:left": "no"}, ""),
        ({"maxspeed": "fast"}, "1 speed limit fast (line 1)"),
        ({}, "1 street without a speed limit (that of its class is taken) (line 1)"),
        ({"maxspeed": "50", "parking:left": "lane"}, "1 tag of parking at the roadside (line 1)"),
        ({"maxspeed": "50", "tunnel": "yes"}, "1 roof of a tunnel (line 1)"),
        ({"maxspeed": "50", "tunnel": "no", "bridge": "yes"}, ""),
        ({"maxspeed": "50", "oneway": "reversible"}, "1 one-way rule that changes (line 1)"),
    ],
)
def test_what_is_not_taken_over_is_listed(tags: dict[str, str], listed: str) -> None:
    assert audit(tags) == listed


@given(st.from_regex(r"[a-z]{12,20}", fullmatch=True))
def test_any_unknown_key_of_a_street_is_listed(key: str) -> None:
    assert f"1 unknown tag {key}" in audit({"maxspeed": "50", key: "some"})


LIMITS_KM_H = {
    "motorway": (100, 142),
    "primary": (50, 100),
    "secondary": (50, 100),
    "secondary_link": (50, 80),
    "tertiary": (50, 80),
    "residential": (50, 50),
    "living_street": (10, 10),
}
"""Of streets without a limit, in towns and elsewhere."""


@pytest.mark.parametrize(("land_use", "column"), [("urban", 0), ("rural", 1)])
def test_a_street_without_a_limit_has_that_of_its_class(
    land_use: str, column: int, tmp_path: Path
) -> None:
    nodes = ways = ""
    for number, highway in enumerate(LIMITS_KM_H):
        ends = [f'id="{10 * number + end}" lat="{number * 1e-3}" lon="{end}e-3"' for end in (1, 2)]
        refs = "".join(f'<nd ref="{10 * number + end}"/>' for end in (1, 2))
        tags = f'<tag k="highway" v="{highway}"/><tag k="name" v="{highway}"/>'
        nodes += "".join(f"<node {end}/>" for end in ends)
        ways += f'<way id="{number + 1}">{refs}{tags}</way>'
    (tmp_path / "town.osm").write_text(f"<osm>{nodes}{ways}</osm>", encoding="utf-8")
    declared = declaration("osm", "town.osm", origin_lat_deg=0, origin_lon_deg=0)
    road = Road.model_validate(declared | {"land_use": land_use})

    network = import_map(MapFile(source="osm", file="town.osm"), road, tmp_path)

    lanes = parse_packed_network(network.network).lanes
    found = {lane.edge[:-1]: lane.speed_limit_m_s * 3.6 for lane in lanes if lane.is_driving_lane}
    expected = {highway: limits[column] for highway, limits in LIMITS_KM_H.items()}
    assert found == pytest.approx(expected, abs=0.1)


def import_speeds(folder: Path, *limits: str) -> tuple[list[float], MapNetwork]:
    """Import living streets with speed limits; those that are not read have 2.78 m/s."""
    text = "<osm>"
    for number in range(len(limits)):
        for end in range(2):
            place = f'lat="{number * 1e-4}" lon="{end * 1e-3}"'
            text += f'<node id="{10 * number + end + 1}" {place}/>'
    for number, limit in enumerate(limits):
        ends = "".join(f'<nd ref="{10 * number + end + 1}"/>' for end in range(2))
        tags = f'<tag k="highway" v="living_street"/><tag k="maxspeed" v="{limit}"/>'
        text += f'\n<way id="{number + 1}">{ends}{tags}<tag k="name" v="s{number}"/></way>'
    (folder / "town.osm").write_text(text + "</osm>", encoding="utf-8")
    road = Road.model_validate(declaration("osm", "town.osm", origin_lat_deg=0, origin_lon_deg=0))
    network = import_map(MapFile(source="osm", file="town.osm"), road, folder)
    lanes = {lane.edge: lane for lane in parse_packed_network(network.network).lanes}
    return [lanes[f"s{number}+"].speed_limit_m_s for number in range(len(limits))], network


def test_speed_limits_are_right_or_listed(tmp_path: Path) -> None:
    limits = ("50", "30 mph", "70 km/h", "RO:urban", "walk", "DE:zone30", "XX:rural", "fast")

    speeds, network = import_speeds(tmp_path, *limits)

    expected = [50 / 3.6, 13.41, 70 / 3.6, 50 / 3.6, 5 / 3.6, 30 / 3.6, 2.78, 2.78]
    assert speeds == pytest.approx(expected, abs=0.01)
    assert [part.name for part in network.left_out] == [
        "speed limit XX:rural",
        "speed limit fast",
    ]


def test_zones_of_countries_are_those_that_netconvert_knows(tmp_path: Path) -> None:
    known = [f"{land}:{zone}" for zone, lands in KNOWN_ZONES.items() for land in lands.split()]

    speeds, network = import_speeds(tmp_path, *known)

    assert network.left_out == ()
    assert min(speeds) > 5


def test_widths_of_lanes_are_listed_where_sidewalks_keep_them_from_being_read(
    tmp_path: Path,
) -> None:
    nodes = '<node id="1" lat="0" lon="0"/><node id="2" lat="0.002" lon="0"/>'
    tags = {"maxspeed": "50", "oneway": "yes", "lanes": "2", "width:lanes": "3|4"}
    tags |= {"highway": "primary", "sidewalk": "right"}
    lines = "".join(f'<tag k="{key}" v="{value}"/>' for key, value in tags.items())
    way = f'<way id="1"><nd ref="1"/><nd ref="2"/>{lines}</way>'
    (tmp_path / "town.osm").write_text(f"<osm>{nodes}{way}</osm>", encoding="utf-8")
    road = Road.model_validate(declaration("osm", "town.osm", origin_lat_deg=0, origin_lon_deg=0))

    network = import_map(MapFile(source="osm", file="town.osm"), road, tmp_path)

    assert [part.name for part in network.left_out] == ["tag of lane widths beside sidewalks"]
