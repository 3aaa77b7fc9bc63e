"""Ways through junctions of OpenDRIVE maps: which there are, and how wide they are."""

from pathlib import Path

import numpy as np
import pytest
from advercity_dsl import MapNetwork

from advercity.roads.network_file import SumoLane, parse_packed_network
from tests.roads.opendrive_maps import connection, import_text, lane, linked, road, section

ONE_WAY = section(0.0, lane(-1, "driving", 3.0))
WEST = road("1", 50.0, ONE_WAY, link=linked("successor", "junction", "9"))
EAST = road("2", 50.0, ONE_WAY, start=(70.0, 0.0, 0.0), link=linked("predecessor", "junction", "9"))


def build_connecting(sections: str, *links: str, at: float = 50.0, junction: str = "9") -> str:
    name, link = f"{at:.0f}", "".join(links)
    return road(name, 20.0, sections, start=(at, 0.0, 0.0), link=link, junction=junction)


BEFORE = linked("predecessor", "road", "1", "end")
AFTER = linked("successor", "road", "2", "start")


def build_junction(*connections: str, name: str = "9") -> str:
    return f'<junction id="{name}">{"".join(connections)}</junction>'


def list_ways(network: MapNetwork) -> set[tuple[str, str]]:
    links = parse_packed_network(network.network).connections
    return {(link.from_edge, link.to_edge) for link in links if link.via and link.origin[0] != ":"}


def find_internal_lane(network: MapNetwork) -> SumoLane:
    lanes = parse_packed_network(network.network).lanes
    return next(item for item in lanes if item.function == "internal")


@pytest.mark.parametrize(
    ("length_m", "at_end"),
    [
        *((length_m, at_end) for length_m in (0.0001, 0.007, 0.015) for at_end in (True, False)),
        # The last section begins where the geometry ends, or a rounded number behind it.
        *((0.0, True), (-0.0001, True)),
    ],
)
def test_sections_of_millimetres_link_the_lanes_around_them(
    length_m: float, at_end: bool, tmp_path: Path
) -> None:
    into = '<link><successor id="1"/></link>'
    kept, turned = lane(-1, "driving", 3.0), lane(-1, "driving", 3.0, inner=into)
    sections = section(0.0, kept) + section(20.0 - length_m if at_end else length_m, turned)
    middle = build_connecting(sections, BEFORE, linked("successor", "road", "2", "end"))
    # The street behind runs against the way, so that its lane has another number.
    back = road(
        "2",
        50.0,
        section(0.0, lane(1, "driving", 3.0)),
        start=(120.0, 0.0, np.pi),
        link=linked("successor", "junction", "9"),
    )
    junction = build_junction(connection("1", "50", "start", (-1, -1)))
    network = import_text(tmp_path, WEST, middle, back, junction)
    assert list_ways(network) == {("road_1+", "road_2+")}


def test_a_way_leads_through_two_junctions_that_touch(tmp_path: Path) -> None:
    far = road(
        "2", 50.0, ONE_WAY, start=(90.0, 0.0, 0.0), link=linked("predecessor", "junction", "8")
    )
    one = build_connecting(ONE_WAY, BEFORE, linked("successor", "junction", "8"))
    other = build_connecting(
        ONE_WAY, linked("predecessor", "junction", "9"), AFTER, at=70.0, junction="8"
    )
    network = import_text(
        tmp_path,
        *(WEST, one, other, far),
        build_junction(connection("1", "50", "start", (-1, -1))),
        build_junction(connection("50", "70", "start", (-1, -1)), name="8"),
    )
    assert list_ways(network) == {("road_1+", "road_2+")}
    x = find_internal_lane(network).shape[:, 0] + network.offset_m[0]
    assert (x[0], x[-1]) == pytest.approx((50.0, 90.0))


@pytest.mark.parametrize("contact", ["start", "end"])
@pytest.mark.parametrize("arm", ["start", "end"])
def test_links_and_places_say_what_a_contact_point_contradicts(
    contact: str, arm: str, tmp_path: Path
) -> None:
    middle = build_connecting(ONE_WAY, linked("predecessor", "road", "1", arm), AFTER)
    junction = build_junction(connection("1", "50", contact, (-1, -1)))
    network = import_text(tmp_path, WEST, middle, EAST, junction)
    assert list_ways(network) == {("road_1+", "road_2+")}


@pytest.mark.parametrize("contact", ["start", "end"])
def test_a_road_that_does_not_name_its_junction_is_entered_at_its_nearer_end(
    contact: str, tmp_path: Path
) -> None:
    nameless = road("1", 50.0, ONE_WAY)
    middle = build_connecting(ONE_WAY, linked("predecessor", "road", "1", contact), AFTER)
    junction = build_junction(connection("1", "50", "start", (-1, -1)))
    network = import_text(tmp_path, nameless, middle, EAST, junction)
    assert list_ways(network) == {("road_1+", "road_2+")}


@pytest.mark.parametrize("length_m", [0.0002, 0.0015, 0.009])
def test_a_road_of_less_than_a_centimetre_links_those_around_it(
    length_m: float, tmp_path: Path
) -> None:
    lanes = section(0.0, lane(-1, "driving", 3.0))
    links = linked("successor", "road", "9", "start"), linked("predecessor", "road", "9", "end")
    one = road("1", 50.0, lanes, link=links[0])
    other = road("2", 50.0, lanes, start=(50.0, 0.0, 0.0), link=links[1])
    tiny = road("9", length_m, lanes, start=(50.0, 0.0, 0.0), link=BEFORE + AFTER)
    assert list_ways(import_text(tmp_path, one, tiny, other)) == {("road_1+", "road_2+")}


def test_a_junction_is_entered_over_a_road_of_less_than_a_centimetre(tmp_path: Path) -> None:
    lanes = section(0.0, lane(-1, "driving", 3.0))
    first = road("1", 50.0, lanes, link=linked("successor", "road", "8", "start"))
    links = linked("predecessor", "road", "1", "end") + linked("successor", "junction", "9")
    tiny = road("8", 0.0003, lanes, start=(50.0, 0.0, 0.0), link=links)
    middle = build_connecting(ONE_WAY, linked("predecessor", "road", "8", "end"), AFTER)
    junction = build_junction(connection("8", "50", "start", (-1, -1)))
    network = import_text(tmp_path, first, tiny, middle, EAST, junction)
    assert list_ways(network) == {("road_1+", "road_2+")}


def test_a_road_that_ends_in_a_junction_is_a_street(tmp_path: Path) -> None:
    junction = build_junction(connection("1", "50", "start", (-1, -1)))
    network = import_text(tmp_path, WEST, build_connecting(ONE_WAY, BEFORE), junction)
    lanes = [item for item in parse_packed_network(network.network).lanes if item.is_driving_lane]
    ends = [item.shape[[0, -1], 0] + network.offset_m[0] for item in lanes]
    np.testing.assert_allclose(sorted(map(tuple, ends)), [(0.0, 50.0), (50.0, 70.0)], atol=0.05)


@pytest.mark.parametrize(("width_m", "growth"), [(3.0, 0.1), (5.0, -0.08), (3.5, 0.0)])
def test_lanes_in_junctions_are_as_wide_as_in_the_map(
    width_m: float, growth: float, tmp_path: Path
) -> None:
    links = '<link><predecessor id="-1"/><successor id="-1"/></link>'
    widths = section(0.0, lane(-1, "driving", (0.0, width_m, growth), inner=links))
    junction = build_junction(connection("1", "50", "start", (-1, -1)))
    middle = build_connecting(widths, BEFORE, AFTER)
    found = find_internal_lane(import_text(tmp_path, WEST, middle, EAST, junction))
    gaps = np.linalg.norm(found.left_border - found.right_border, axis=1)
    x = found.left_border[:, 0] - found.left_border[0, 0]
    at = np.array([0.0, 5.0, 10.0, 20.0])
    np.testing.assert_allclose(np.interp(at, x, gaps), width_m + growth * at, atol=0.01)
