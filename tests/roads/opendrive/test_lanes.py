"""Lanes of OpenDRIVE maps lie where the standard's formulas put them."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from advercity.pipeline.descriptions import describe_road
from advercity.roads.imported_network import ImportedNetwork
from advercity.roads.imported_streets import read_imported_streets
from advercity.roads.network_file import SumoLane, parse_packed_network
from advercity.roads.road_network import build_road
from tests.roads.opendrive_maps import cubic, declare, import_text, lane, linked, road, section

OPENS_M, LENGTH_M, WIDTH_M = 40.0, 25.0, 3.25
"""Where a lane for turning left opens, over which length, and how wide it becomes."""
C, D = 3 * WIDTH_M / LENGTH_M**2, -2 * WIDTH_M / LENGTH_M**3


def opening_lane(s: np.ndarray) -> np.ndarray:
    u = np.clip(s - OPENS_M, 0, LENGTH_M)
    return C * u**2 + D * u**3


@pytest.fixture(scope="module")
def opening(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, ...]:
    """A street of which the middle moves to the left, where a lane opens at it."""
    offsets = (
        cubic("laneOffset", 0.0)
        + cubic("laneOffset", OPENS_M, 0.0, 0.0, C / 2, D / 2)
        + cubic("laneOffset", OPENS_M + LENGTH_M, WIDTH_M / 2)
    )
    before = section(
        0.0,
        lane(1, "driving", 3.25),
        lane(-1, "driving", 3.25, inner='<link><successor id="-2"/></link>'),
        lane(-2, "sidewalk", 1.5, inner='<link><successor id="-3"/></link>'),
    )
    after = section(
        OPENS_M,
        lane(1, "driving", 3.25),
        lane(-1, "driving", (0.0, 0.0, 0.0, C, D), (LENGTH_M, WIDTH_M)),
        lane(-2, "driving", 3.25, inner='<link><predecessor id="-1"/></link>'),
        lane(-3, "sidewalk", 1.5, inner='<link><predecessor id="-2"/></link>'),
    )
    return (road("7", 120.0, offsets + before + after),)


def read_lanes(network: object) -> list[SumoLane]:
    found = parse_packed_network(network.network)  # type: ignore[attr-defined]
    return [item for edge in found.edges for item in edge.lanes if item.function == "normal"]


def test_borders_of_a_lane_that_opens_follow_its_polynomials(
    opening: tuple[str, ...], tmp_path: Path
) -> None:
    lanes = read_lanes(import_text(tmp_path, *opening))
    east = [item for item in lanes if item.shape[-1, 0] > item.shape[0, 0]]

    def offset(s: np.ndarray) -> np.ndarray:
        return opening_lane(s) / 2

    # Borders to the right of the middle, from the innermost one outwards.
    lines: list[Callable[[np.ndarray], np.ndarray]] = [
        offset,
        lambda s: offset(s) - opening_lane(s),
        lambda s: offset(s) - opening_lane(s) - 3.25,
        lambda s: offset(s) - opening_lane(s) - 4.75,
    ]
    for item in east:
        at_end = item.index + 1
        count = 4 if item.shape[0, 0] > 20 else 3
        borders = lines if count == 4 else [lines[0], *lines[2:]]
        right, left = borders[count - at_end], borders[count - at_end - 1]
        dense = np.linspace(item.shape[0, 0], item.shape[-1, 0], 200)
        for border, formula in ((item.left_border, left), (item.right_border, right)):
            y = np.interp(dense, border[:, 0], border[:, 1])
            np.testing.assert_allclose(y, formula(dense), atol=0.03)


def test_a_lane_that_opens_makes_no_junction(opening: tuple[str, ...], tmp_path: Path) -> None:
    network = import_text(tmp_path, *opening, land_use="urban")
    described = declare(network, land_use="urban")
    built = build_road(described)
    net = ImportedNetwork.from_network(parse_packed_network(network.network))

    assert not [name for name in describe_road(described) if name.startswith("junction")]
    assert not built.traffic_signs
    assert not [item for item in built.lanes if item.kind == "crossing"]
    assert {link.state for link in net.lane_links} == {"M"}
    # Each lane goes on in one lane: there and back.
    assert len(net.lane_links) == 2
    # Vehicles would brake for longer ways between lanes that touch, which would not be straight.
    paths = [item for edge in parse_packed_network(network.network).edges for item in edge.lanes]
    assert all(item.length_m <= 0.2 for item in paths if item.function == "internal")


@pytest.mark.parametrize("ends", ["road", "junction"])
def test_a_road_that_leads_back_to_itself_is_two_streets(ends: str, tmp_path: Path) -> None:
    if ends == "road":
        linked = [
            f'<{name} elementType="road" elementId="1" contactPoint="{contact}"/>'
            for name, contact in (("predecessor", "end"), ("successor", "start"))
        ]
    else:
        linked = [
            f'<{name} elementType="junction" elementId="9"/>'
            for name in ("predecessor", "successor")
        ]
    circle = road(
        "1",
        2 * np.pi * 40,
        section(0.0, lane(1, "driving", 3.5), lane(-1, "driving", 3.5)),
        shape='<arc curvature="0.025"/>',
        link="".join(linked),
    )
    network = import_text(tmp_path, circle, '<junction id="9"/>')
    net = ImportedNetwork.from_network(parse_packed_network(network.network))

    assert len(net.edges) == 4
    for item in read_lanes(network):
        radii = np.linalg.norm(item.shape[:, :2] - (0.0, 40.0), axis=1)
        np.testing.assert_allclose(radii, radii[0], atol=0.01)


@pytest.mark.parametrize(
    ("limit", "speed_m_s"),
    [
        ('max="100" unit="km/h"', 100 / 3.6),
        ('max="30" unit="km/h"', 30 / 3.6),
        ('max="40" unit="mph"', 40 * 0.44704),
        ('max="12.5"', 12.5),
        ('max="12.5" unit="m/s"', 12.5),
        ('max="no limit"', 130 / 3.6),
        ('max="undefined"', 50 / 3.6),
        ('max="-1" unit="km/h"', 50 / 3.6),
    ],
)
def test_lanes_have_the_limit_of_their_road(limit: str, speed_m_s: float, tmp_path: Path) -> None:
    kind = f'<type s="0" type="rural"><speed {limit}/></type>'
    street = road("1", 60.0, section(0.0, lane(-1, "driving", 3.5)), before_lanes=kind)

    (found,) = read_lanes(import_text(tmp_path, street))

    assert found.speed_limit_m_s == pytest.approx(speed_m_s, abs=0.001)


def test_limits_change_where_the_map_has_it(tmp_path: Path) -> None:
    kinds = (
        '<type s="0" type="town"><speed max="50" unit="km/h"/></type>'
        '<type s="80" type="rural"><speed max="100" unit="km/h"/></type>'
    )
    slow = '<speed sOffset="150" max="60" unit="km/h"/>'
    lanes = section(0.0, lane(-1, "driving", 3.5), lane(-2, "driving", 3.5, inner=slow))
    street = road("1", 200.0, lanes, before_lanes=kinds)

    found = sorted(
        (round(item.shape[0, 0]), round(-item.shape[0, 1], 2), round(item.speed_limit_m_s * 3.6))
        for item in read_lanes(import_text(tmp_path, street))
    )

    assert found == [
        (0, 1.75, 50),
        (0, 5.25, 50),
        (80, 1.75, 100),
        (80, 5.25, 100),
        (150, 1.75, 100),
        (150, 5.25, 60),
    ]


def test_a_direct_junction_splits_a_carriageway(tmp_path: Path) -> None:
    def to_junction(name: str) -> str:
        return f'<{name} elementType="junction" elementId="9"/>'

    three = section(0.0, lane(-1, "driving", 3.5), lane(-2, "driving", 3.5), lane(-3, "exit", 3.5))
    two = section(0.0, lane(-1, "driving", 3.5), lane(-2, "driving", 3.5))
    bend = '<spiral curvStart="0" curvEnd="-0.01"/>'
    one = section(0.0, lane(-1, "exit", 3.5))
    junction = (
        '<junction id="9" type="direct">'
        '<connection id="0" incomingRoad="1" linkedRoad="2" contactPoint="start">'
        '<laneLink from="-1" to="-1"/><laneLink from="-2" to="-2"/></connection>'
        '<connection id="1" incomingRoad="1" linkedRoad="3" contactPoint="start">'
        '<laneLink from="-3" to="-1"/></connection></junction>'
    )
    network = import_text(
        tmp_path,
        road("1", 90.0, three, link=to_junction("successor")),
        road("2", 90.0, two, start=(90.0, 0.0, 0.0), link=to_junction("predecessor")),
        road("3", 90.0, one, start=(90.0, -7.0, 0.0), shape=bend, link=to_junction("predecessor")),
        junction,
    )
    net = ImportedNetwork.from_network(parse_packed_network(network.network))

    assert sorted((link.origin, link.target, link.state) for link in net.lane_links) == [
        ("road_1+_0", "road_3+_0", "M"),
        ("road_1+_1", "road_2+_0", "M"),
        ("road_1+_2", "road_2+_1", "M"),
    ]
    assert read_imported_streets(network.network).controls["j9"] == "none"


def direct_junction(name: str, incoming: str, linked: str, contact: str, *lanes: int) -> str:
    """Write a direct junction of one connection; lanes are pairs of ids in a row."""
    pairs = zip(lanes[::2], lanes[1::2], strict=True)
    links = "".join(f'<laneLink from="{one}" to="{other}"/>' for one, other in pairs)
    return (
        f'<junction id="{name}" type="direct"><connection id="0" incomingRoad="{incoming}"'
        f' linkedRoad="{linked}" contactPoint="{contact}">{links}</connection></junction>'
    )


def test_a_direct_junction_is_believed_where_a_road_is_linked_to_another_one(
    tmp_path: Path,
) -> None:
    """Road 2 begins at junction 8, where road 1 ends, but names junction 9, 300 m away."""
    one = section(0.0, lane(-1, "driving", 3.5))
    network = import_text(
        tmp_path,
        road("1", 90.0, one, link=linked("successor", "junction", "8")),
        road("2", 90.0, one, start=(90.0, 0.0, 0.0), link=linked("predecessor", "junction", "9")),
        road("3", 90.0, one, start=(0.0, 300.0, 0.0), link=linked("successor", "junction", "9")),
        road("4", 90.0, one, start=(90.0, 300.0, 0.0), link=linked("predecessor", "junction", "9")),
        direct_junction("8", "1", "2", "start", -1, -1),
        direct_junction("9", "3", "4", "start", -1, -1),
    )

    net = parse_packed_network(network.network)

    assert {
        (link.origin, link.target) for link in ImportedNetwork.from_network(net).lane_links
    } == {
        ("road_1+_0", "road_2+_0"),
        ("road_3+_0", "road_4+_0"),
    }
    ends = {edge.id: edge for edge in net.edges if edge.function == "normal"}
    assert ends["road_1+"].to_junction == ends["road_2+"].from_junction
    assert ends["road_2+"].from_junction != ends["road_4+"].from_junction


@pytest.mark.parametrize(("target", "links", "listed"), [(-1, 1, 0), (1, 0, 1)])
def test_a_lane_link_against_the_direction_of_traffic_is_listed(
    target: int, links: int, listed: int, tmp_path: Path
) -> None:
    both = section(0.0, lane(1, "driving", 3.5), lane(-1, "driving", 3.5))
    network = import_text(
        tmp_path,
        road("1", 90.0, both, link=linked("successor", "junction", "8")),
        road("2", 90.0, both, start=(90.0, 0.0, 0.0), link=linked("predecessor", "junction", "8")),
        direct_junction("8", "1", "2", "start", -1, target),
    )

    net = ImportedNetwork.from_network(parse_packed_network(network.network))

    assert len(list(net.lane_links)) == links
    assert [part.name for part in network.left_out] == [
        "lane link against the direction of traffic"
    ] * listed


def test_a_road_ends_where_its_geometry_ends(tmp_path: Path) -> None:
    street = road("1", 50.0, section(0.0, lane(-1, "driving", 3.5)))
    longer = street.replace('length="50.0" junction', 'length="2000.0" junction')

    network = import_text(tmp_path, longer)

    (found,) = read_lanes(network)
    assert found.shape[-1, 0] == pytest.approx(50.0, abs=0.01)
    assert [item.name for item in network.left_out] == ["part of a road beyond its geometry"]
