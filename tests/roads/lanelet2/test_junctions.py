"""Junctions of Lanelet2 maps: where lanelets diverge, merge or cross, and who goes first."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from advercity.foreign.ledger import describe_left_out
from advercity.roads.network_file import SumoNetwork
from tests.roads.lanelet2_maps import (
    LaneletMap,
    Point,
    find_streets,
    get_street,
    import_lanelets,
    import_text,
    member,
)

HALF_M = 1.75


def row(start: Point, end: Point) -> tuple[list[Point], list[Point]]:
    """Make bounds of a straight lane between two points of its middle."""
    step = np.subtract(end, start)
    aside = HALF_M * np.array([-step[1], step[0]]) / np.linalg.norm(step)
    sides = [[np.add(point, sign * aside) for point in (start, end)] for sign in (1, -1)]
    left, right = ([(float(x), float(y)) for x, y in side] for side in sides)
    return left, right


def write_crossroads(lanelets: LaneletMap, rule: int | None = None) -> list[int]:
    """Write two one-way roads, to the east and north, that cross between lanelets of 40 m."""
    names: list[int] = []
    for ends in ([(-60, 0), (-12, 0), (12, 0), (60, 0)], [(0, -60), (0, -12), (0, 12), (0, 60)]):
        for start, end in pairwise(ends):
            left, right = (lanelets.way(side) for side in row(start, end))
            names.append(lanelets.lanelet(left, right, [rule] if rule else []))
    return names


def get_node(network: SumoNetwork, street: int) -> tuple[str, str]:
    """Get id and type of the junction that a street leads to."""
    name = get_street(network, street).to_junction
    return name, next(it.type for it in network.junctions if it.id == name)


def list_movements(network: SumoNetwork) -> set[tuple[str, str]]:
    streets = find_streets(network)
    return {
        (link.from_edge.strip("+-"), link.to_edge.strip("+-"))
        for link in network.connections
        if link.from_edge in streets and link.to_edge in streets
    }


def test_lanelets_that_cross_are_a_junction_between_their_streets(tmp_path: Path) -> None:
    lanelets = LaneletMap()
    west, _, east, south, _, north = write_crossroads(lanelets)

    network = import_lanelets(tmp_path, lanelets)

    assert list_movements(network) == {
        (f"lanelet_{west}", f"lanelet_{east}"),
        (f"lanelet_{south}", f"lanelet_{north}"),
    }
    assert get_node(network, west) == get_node(network, south)
    # Streets end where the lanelets inside begin, as the map has it.
    assert get_street(network, west).lanes[0].centre[-1, :2].tolist() == [-12.0, 0.0]
    assert {item.kind for item in network.outlines} == {"roadway"}


def test_a_lanelet_that_leads_over_another_crosses_none(tmp_path: Path) -> None:
    lanelets = LaneletMap()
    level, above = (
        lanelets.lane(*([(x, y, z) for x, y in side] for side in row(*ends)))
        for z, ends in ((0.0, ((-50, 0), (50, 0))), (5.5, ((0, -50), (0, 50))))
    )

    network = import_lanelets(tmp_path, lanelets)

    assert {it.type for it in network.junctions} == {"dead_end"}
    assert get_street(network, level).lanes[0].centre[0, 2] == 0.0
    assert get_street(network, above).lanes[0].centre[0, 2] == 5.5


def test_long_lanelets_that_cross_are_streets_up_to_the_crossing(tmp_path: Path) -> None:
    lanelets = LaneletMap()
    for ends in (((-50, 0), (50, 0)), ((0, -50), (0, 50))):
        lanelets.lane(*row(*ends))

    streets = find_streets(import_lanelets(tmp_path, lanelets)).values()

    assert len(streets) == 4
    ends = {
        (round(x, 1) + 0.0, round(y, 1) + 0.0)
        for x, y, _ in (it.lanes[0].centre[-1] for it in streets)
    }
    # Touching is no overlap: 25 cm of each side are left out of both.
    assert ends == {(-1.5, 0.0), (50.0, 0.0), (0.0, -1.5), (0.0, 50.0)}


def test_a_lane_that_diverges_leads_into_both(tmp_path: Path) -> None:
    lanelets = LaneletMap()
    before = lanelets.lane([(-50, 2), (0, 2)], [(-50, -2), (0, -2)])
    lanelets.lane([(0, 2), (30, 2)], [(0, -2), (30, -2)])
    lanelets.lane([(0, 2), (16, -8), (18, -20)], [(0, -2), (12, -9), (14, -20)])
    straight = lanelets.lane([(30, 2), (90, 2)], [(30, -2), (90, -2)])
    right = lanelets.lane([(18, -20), (18, -70)], [(14, -20), (14, -70)])

    network = import_lanelets(tmp_path, lanelets)

    assert list_movements(network) == {
        (f"lanelet_{before}", f"lanelet_{straight}"),
        (f"lanelet_{before}", f"lanelet_{right}"),
    }
    assert get_street(network, before).lanes[0].centre[-1, 0] == 0.0


def test_lanelets_in_a_row_are_one_street_until_their_limit_changes(tmp_path: Path) -> None:
    lanelets = LaneletMap()
    stations = (0, 40, 80, 120)
    limits = ("50", "50", "30")
    names = [
        lanelets.lane(*row((a, 0), (b, 0)), speed_limit=limit)
        for a, b, limit in zip(stations, stations[1:], limits, strict=False)
    ]

    network = import_lanelets(tmp_path, lanelets)

    first, last = (get_street(network, names[index]).lanes[0] for index in (0, 2))
    assert len(find_streets(network)) == 2
    assert (first.length_m, last.length_m) == (80.0, 40.0)
    assert list_movements(network) == {(f"lanelet_{names[0]}", f"lanelet_{names[2]}")}


@pytest.mark.parametrize("is_first", [True, False])
def test_lanelets_with_right_of_way_go_first(is_first: bool, tmp_path: Path) -> None:
    lanelets = LaneletMap()
    # Ids count from 1001: the rule, then two ways and a lanelet each.
    west, south = 1004, 1013
    major, minor = (west, south) if is_first else (south, west)
    roles = member("right_of_way", major, "relation") + member("yield", minor, "relation")
    rule = lanelets.rule("right_of_way", roles)
    found = write_crossroads(lanelets, rule)
    assert (found[0], found[3]) == (west, south)

    network = import_lanelets(tmp_path, lanelets)

    states = {it.from_edge.strip("+-"): it.state for it in network.connections if it.via}
    assert states[f"lanelet_{major}"] == "M"
    assert states[f"lanelet_{minor}"] == "m"


@pytest.mark.parametrize(
    ("subtype", "sign", "node"),
    [
        ("traffic_light", "", "traffic_light"),
        ("traffic_sign", "usR1-1", "allway_stop"),
        ("traffic_sign", "de205", "priority"),
    ],
)
def test_lights_and_signs_govern_a_junction(
    subtype: str, sign: str, node: str, tmp_path: Path
) -> None:
    lanelets = LaneletMap()
    kind = "traffic_light" if subtype == "traffic_light" else "traffic_sign"
    seen = lanelets.way([(-14, -3), (-14, -3.6)], kind, subtype=sign)
    rule = lanelets.rule(subtype, member("refers", seen))
    west, *_ = write_crossroads(lanelets, rule)

    assert get_node(import_lanelets(tmp_path, lanelets), west)[1] == node


def test_a_stop_sign_on_one_road_stops_that_one(tmp_path: Path) -> None:
    lanelets = LaneletMap()
    sign = lanelets.way([(3, -14), (3.6, -14)], "traffic_sign", subtype="de206")
    roles = member("refers", sign) + member("yield", 1014, "relation")
    rule = lanelets.rule("right_of_way", roles)
    west, _, _, south, _, _ = write_crossroads(lanelets, rule)
    assert south == 1014

    network = import_lanelets(tmp_path, lanelets)

    assert get_node(network, west)[1] == "priority_stop"
    states = {it.from_edge.strip("+-"): it.state for it in network.connections if it.via}
    assert (states[f"lanelet_{west}"], states[f"lanelet_{south}"]) == ("M", "s")


@pytest.mark.parametrize(
    ("lengths_m", "node"),
    [
        ([24], "traffic_light"),
        ([26], "priority"),
        ([14, 10], "traffic_light"),
        ([16, 10], "priority"),
    ],
)
def test_rules_count_within_25_m_of_a_junction(
    lengths_m: list[float], node: str, tmp_path: Path
) -> None:
    """Behind a lanelet with a light come others without, up to one that another road crosses."""
    lanelets = LaneletMap()
    seen = lanelets.way([(-14, -3), (-14, -3.6)], "traffic_light")
    rule = lanelets.rule("traffic_light", member("refers", seen))
    begin_m = -52.0 - sum(lengths_m)
    names: list[int] = []
    for length_m in (40, *lengths_m, 24, 40):
        left, right = (lanelets.way(side) for side in row((begin_m, 0), (begin_m + length_m, 0)))
        names.append(lanelets.lanelet(left, right, [] if names else [rule]))
        begin_m += length_m
    lanelets.lane(*row((0, -60), (0, 60)))

    assert get_node(import_lanelets(tmp_path, lanelets), names[0])[1] == node


def describe(lanelets: LaneletMap, folder: Path) -> str:
    return describe_left_out(import_text(folder, lanelets.write()).left_out)


@pytest.mark.parametrize(
    ("tags", "is_told"),
    [
        ({"subtype": "dashed"}, False),
        ({"subtype": "solid"}, True),
        ({"subtype": "solid", "lane_change": "yes"}, False),
        ({"subtype": "dashed", "lane_change": "no"}, True),
    ],
)
def test_lines_that_lanes_are_changed_across_against_the_map_are_told(
    tags: dict[str, str], is_told: bool, tmp_path: Path
) -> None:
    lanelets = LaneletMap()
    ways = [
        lanelets.way([(0, y), (80, y)], "line_thin", **(tags if y == 3.5 else {}))
        for y in (7.0, 3.5, 0.0)
    ]
    for left, right in pairwise(ways):
        lanelets.lanelet(left, right)

    assert ("1 line that forbids to change lanes" in describe(lanelets, tmp_path)) is is_told


def test_unused_lanelets_are_told(tmp_path: Path) -> None:
    lanelets = LaneletMap()
    lanelets.lane(*row((5, -40), (5, 40)))
    for first, last, borders in ((-60, 0, 3), (0, 10, 3), (10, 60, 2)):
        # The left one of two lanes ends in the junction.
        ways = [lanelets.way([(first, y), (last, y)]) for y in (3.5, 0.0, -3.5)[3 - borders :]]
        for left, right in pairwise(ways):
            lanelets.lanelet(left, right)
    lanelets.lane([(70, 0), (70, 30)], [(72, 0), (72, 30)], subtype="walkway")

    told = describe(lanelets, tmp_path)

    assert "1 lanelet in a junction that leads nowhere (paved, not driven)" in told
    assert "1 lanelet apart from streets (paved, not used)" in told


def test_a_lanelet_for_both_directions_is_two_streets(tmp_path: Path) -> None:
    lanelets = LaneletMap()
    lanelets.lane(*row((0, 0), (80, 0)), one_way="no")

    lines = [
        it.lanes[0].centre for it in find_streets(import_lanelets(tmp_path, lanelets)).values()
    ]

    assert sorted(line[0, 0] for line in lines) == [0.0, 80.0]


@pytest.mark.parametrize(("lit", "assumed"), [(1, 1), (2, 0)])
def test_lights_that_other_approaches_lack_are_told(lit: int, assumed: int, tmp_path: Path) -> None:
    lanelets = LaneletMap()
    seen = lanelets.way([(-14, -3), (-14, -3.6)], "traffic_light")
    rule = lanelets.rule("traffic_light", member("refers", seen))
    west, *_ = write_crossroads(lanelets, rule)
    text = lanelets.write()
    if lit == 1:
        kept = f'<relation id="{west}">'
        first, rest = text.split(kept)
        own, *others = rest.split("</relation>")
        rules = member("regulatory_element", rule, "relation")
        text = kept.join(
            [first, "</relation>".join([own, *(it.replace(rules, "") for it in others)])]
        )

    told = describe_left_out(import_text(tmp_path, text).left_out)

    line = f"{assumed} light that the map lacks at an approach of a signalised junction (assumed)"
    assert (line in told) is (assumed == 1)


def test_a_stop_sign_where_no_ways_cross_is_told(tmp_path: Path) -> None:
    lanelets = LaneletMap()
    sign = lanelets.way([(48, -2), (48, -2.6)], "traffic_sign", subtype="de206")
    rule = lanelets.rule("traffic_sign", member("refers", sign))
    for start, end, rules in ((-60, 50, [rule]), (50, 90, [])):
        left, right = (lanelets.way(side) for side in row((start, 0), (end, 0)))
        lanelets.lanelet(left, right, rules, speed_limit=f"{50 + len(rules)} km/h")

    assert "1 street with a stop sign where no ways cross" in describe(lanelets, tmp_path)
