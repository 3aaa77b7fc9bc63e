"""Networks of others: traffic on the left, and what netconvert makes of their attributes."""

from pathlib import Path
from xml.etree.ElementTree import SubElement

import numpy as np
import pytest
import shapely
from advercity_dsl import MapFile, MapNetwork, Road
from advercity_dsl.units import Point2

from advercity.errors import InputError
from advercity.foreign.ledger import describe_left_out
from advercity.foreign.xml_documents import parse_xml, to_xml_bytes
from advercity.roads.map_import import import_map
from advercity.roads.network_file import SumoNetwork, parse_network, parse_packed_network
from tests.roads.imported_roads import declaration
from tests.roads.sumo_networks import build_crossing_network

LEFT_HAND = build_crossing_network(("lefthand", "true"))


def import_network(
    text: str, folder: Path, *, extent_m: tuple[Point2, Point2] | None = None
) -> MapNetwork:
    (folder / "town.net.xml").write_text(text, encoding="utf-8")
    road = Road.model_validate(declaration("sumo", "town.net.xml"))
    declared = MapFile(source="sumo", file="town.net.xml", extent_m=extent_m)
    return import_map(declared, road, folder)


def draw_lanes(network: SumoNetwork, sign: float) -> shapely.MultiLineString:
    """Draw the lanes for cars, with y times a sign."""
    lines = [lane.shape[:, :2] * (1, sign) for lane in network.lanes if lane.is_driving_lane]
    return shapely.MultiLineString(lines)


@pytest.mark.parametrize(
    ("text", "side"), [(LEFT_HAND, "left"), (build_crossing_network(), "right")]
)
def test_lanes_are_where_the_file_has_them_seen_in_the_mirror_if_traffic_is_on_the_left(
    text: str, side: str, tmp_path: Path
) -> None:
    found = import_network(text, tmp_path)

    plan = draw_lanes(parse_packed_network(found.network), -1 if side == "left" else 1)
    own = draw_lanes(parse_network(parse_xml(text.encode())), 1)
    assert found.driving_side == side
    assert len(plan.geoms) == len(own.geoms) == 16
    assert shapely.hausdorff_distance(plan, own) < 0.1


@pytest.mark.parametrize(("guessed", "count"), [("true", 4), ("false", 0)])
def test_a_town_has_the_crossings_of_the_file_and_no_others(
    guessed: str, count: int, tmp_path: Path
) -> None:
    text = build_crossing_network(("crossings.guess", guessed))

    network = parse_packed_network(import_network(text, tmp_path).network)

    assert sum(edge.function == "crossing" for edge in network.edges) == count


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("spread", ["center", "roadCenter"])
@pytest.mark.parametrize("said_of", ["net", "edge"])
def test_streets_that_are_spread_about_their_axis_stay_there(
    said_of: str, spread: str, side: str, tmp_path: Path
) -> None:
    """netconvert lays lanes out again, and spreads them to the right of the axis by default."""
    hand = ("lefthand", "true" if side == "left" else "false")
    text = build_crossing_network(hand, ("default.spreadtype", spread))
    said = f' spreadType="{spread}"'
    assert said in text
    if said_of == "edge":
        text = text.replace(said, "").replace('<edge id="in', f'<edge{said} id="in')
        text = text.replace('<edge id="out', f'<edge{said} id="out')

    network = parse_packed_network(import_network(text, tmp_path).network)

    plan = draw_lanes(network, -1 if side == "left" else 1)
    own = draw_lanes(parse_network(parse_xml(text.encode())), 1)
    assert shapely.hausdorff_distance(plan, own) < 0.1


@pytest.mark.parametrize("text", [LEFT_HAND, build_crossing_network()])
def test_the_plan_has_traffic_on_the_right(text: str, tmp_path: Path) -> None:
    network = parse_packed_network(import_network(text, tmp_path).network)

    for edge in network.edges:
        if edge.function == "normal":
            first, second = edge.driving_lanes
            way = first.shape[-1, :2] - first.shape[0, :2]
            across = second.shape[0, :2] - first.shape[0, :2]
            assert np.cross([*way, 0], [*across, 0])[2] > 0  # index 0 is at the right
            assert np.cross([*way, 0], [*first.shape[0, :2], 0])[2] < 0  # of the axis
            assert edge.lanes[0].is_sidewalk


def test_the_extent_is_in_the_frame_of_the_file(tmp_path: Path) -> None:
    found = import_network(LEFT_HAND, tmp_path, extent_m=((-20, 60), (20, 110)))

    lanes = draw_lanes(parse_packed_network(found.network), -1)
    assert lanes.bounds[1] > -1  # only the northern arm is left
    assert lanes.bounds[3] == pytest.approx(100)


@pytest.mark.parametrize("shape", ["0,north 1,1", "7 1,1"])
def test_a_place_that_is_no_number_is_an_error_of_the_file(shape: str, tmp_path: Path) -> None:
    start = LEFT_HAND.index('shape="') + len('shape="')
    text = LEFT_HAND[:start] + shape + LEFT_HAND[LEFT_HAND.index('"', start) :]

    with pytest.raises(InputError, match=r"town\.net\.xml: "):
        import_network(text, tmp_path)


def test_rights_of_way_and_limits_of_connections_are_those_of_the_file(tmp_path: Path) -> None:
    text = build_crossing_network().replace("<connection ", '<connection speed="2.5" ')

    network = parse_packed_network(import_network(text, tmp_path).network)

    inside = [lane for lane in network.lanes if lane.function == "internal"]
    assert {lane.speed_limit_m_s for lane in inside} == {2.5}


def test_lanes_and_streets_that_cars_may_not_use_are_listed(tmp_path: Path) -> None:
    text = build_crossing_network()
    start = text.index('<lane id="in_north_1"')
    text = text[:start] + text[start:].replace('disallow="pedestrian"', 'allow="bus"', 1)
    start = text.index('<edge id="out_east"')
    end = text.index("</edge>", start)
    text = (
        text[:start] + text[start:end].replace('disallow="pedestrian"', 'allow="rail"') + text[end:]
    )

    found = import_network(text, tmp_path)

    assert describe_names(found) == {"traffic on a lane for bus": 1, "street without cars": 1}


def describe_names(found: MapNetwork) -> dict[str, int]:
    assert describe_left_out(found.left_out)
    return {item.name: item.count for item in found.left_out}


def test_of_several_programs_of_a_light_the_last_is_read(tmp_path: Path) -> None:
    text = build_crossing_network()
    start, end = text.index("<tlLogic"), text.index("</tlLogic>") + len("</tlLogic>")
    program = text[start:end]
    again = program.replace('programID="0" offset="0"', 'programID="night" offset="begin"')
    again = again.replace('duration="', 'duration="1')
    text = text[:end] + again + text[end:]

    found = import_network(text, tmp_path)

    (light,) = parse_packed_network(found.network).programs
    (before,) = parse_network(parse_xml(build_crossing_network().encode())).programs
    assert light.phases[0][0] == float(f"1{before.phases[0][0]:g}")
    assert describe_names(found) == {"further program of a light": 1}


def move_and_project(text: str, east_m: float, north_m: float) -> str:
    """Move a network by a SUMO offset, and say that it is in UTM zone 32."""
    net = parse_xml(text.encode())
    for item in net.iter():
        if item.get("shape"):
            points = (point.split(",") for point in item.attrib["shape"].split())
            moved = [f"{float(x) + east_m},{float(y) + north_m}" for x, y, *_ in points]
            item.set("shape", " ".join(moved))
        if item.tag == "junction":
            item.set("x", str(float(item.attrib["x"]) + east_m))
            item.set("y", str(float(item.attrib["y"]) + north_m))
    location = next(net.iter("location"), None)
    location = SubElement(net, "location") if location is None else location
    offset = f"{east_m - 691600},{north_m - 5335000}"
    location.attrib |= {"netOffset": offset, "projParameter": "+proj=utm +zone=32 +ellps=WGS84"}
    return to_xml_bytes(net).decode()


@pytest.mark.parametrize("moved_m", [(0.0, 0.0), (691600.0, 5335000.0), (-30000.0, 12300.0)])
@pytest.mark.parametrize("text", [LEFT_HAND, build_crossing_network()])
def test_a_projected_network_is_around_a_local_origin_and_on_the_globe(
    text: str, moved_m: Point2, tmp_path: Path
) -> None:
    plain = import_network(text, tmp_path)
    found = import_network(move_and_project(text, *moved_m), tmp_path)

    own, plan = (draw_lanes(parse_packed_network(item.network), 1) for item in (plain, found))
    shift = np.subtract(moved_m, found.offset_m)
    if plain.driving_side == "left":
        shift[1] *= -1
    assert np.abs(shift).max() < 200
    assert shapely.hausdorff_distance(shapely.transform(own, lambda at: at + shift), plan) < 0.01
    # What was at (0, 0) is at 691600 m east and 5335000 m north in UTM.
    assert found.place is not None
    north_m = np.radians(found.place.latitude_deg - 48.13937796639) * 6_371_000
    assert north_m == pytest.approx(-shift[1] if plain.driving_side == "right" else shift[1], abs=9)


def test_a_projection_that_is_not_read_is_listed(tmp_path: Path) -> None:
    text = move_and_project(build_crossing_network(), 0, 0).replace("+proj=utm", "+proj=lcc")

    found = import_network(text, tmp_path)

    assert found.place is None
    assert "1 projection of the map" in describe_left_out(found.left_out)
