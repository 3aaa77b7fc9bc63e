"""Names of streets and junctions of imported maps."""

import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from xml.etree.ElementTree import Element, fromstring

import pytest
from advercity_dsl import MapFile, Road, Spec
from advercity_dsl.base import ID_PATTERN
from hypothesis import given
from hypothesis import strategies as st

from advercity.roads.imported_network import ImportedNetwork
from advercity.roads.imported_streets import read_imported_streets
from advercity.roads.junction_arms import COMPASS_RAD, RELATIVE_RAD
from advercity.roads.map_import import import_map
from advercity.roads.map_names import rename_network
from advercity.roads.network_file import parse_network
from advercity.roads.routes import RoutePlanner
from advercity.roads.streets import parse_edge_id, sumo_edge_id
from advercity.roads.sumo_xml import pack_network, sanitize_network
from tests.roads.imported_roads import CROSSROADS, DATA, declaration
from tests.roads.sumo_networks import ARMS, build_crossing_network, parse_crossing_network


def test_streets_take_the_name_or_the_id_that_the_map_has_for_them(crossroads: Spec) -> None:
    planner = RoutePlanner(crossroads.road)

    assert set(planner.streets) == {
        "grosse_strasse_1",
        "grosse_strasse_2",
        "road_12_1",
        "road_12_2",
    }
    assert planner.controls["j1"] == "signals"
    # From each arm traffic goes straight on, left and right, in the only lane.
    assert len(planner.movements["j1"]) == 12


def test_a_network_with_names_keeps_them(authored: Spec, reimported: Spec) -> None:
    ours, theirs = RoutePlanner(authored.road), RoutePlanner(reimported.road)

    assert set(theirs.streets) == set(ours.streets)
    for name, street in ours.streets.items():
        found = theirs.streets[name]
        assert (found.begins, found.ends) == (street.begins, street.ends)
        assert [strip.lane_number for strip in found.right_strips if strip.lane_number] == [
            strip.lane_number for strip in street.right_strips if strip.lane_number
        ]
    assert {name: set(items) for name, items in theirs.movements.items()} == {
        name: set(items) for name, items in ours.movements.items()
    }


def test_a_foreign_network_is_renamed_although_its_ids_look_like_ours(tmp_path: Path) -> None:
    (tmp_path / "town.net.xml").write_text(build_crossing_network(), encoding="utf-8")
    road = Road.model_validate(declaration("sumo", "town.net.xml"))

    found = import_map(MapFile(source="sumo", file="town.net.xml"), road, tmp_path)

    streets = read_imported_streets(found.network)
    assert len(streets.streets) == 4
    assert streets.controls["mid"] == "signals"
    assert {street.begins for street in streets.streets.values()} | {"mid"} == {"mid", *ARMS}


IDS = st.text(
    st.characters(codec="utf-8", exclude_categories=("C", "Z"), exclude_characters=":;,|\\\"'<>&"),
    min_size=1,
    max_size=12,
) | st.from_regex(r"[a-c]_?[+-]?", fullmatch=True)
"""Ids as SUMO allows them; many look like those of our own edges."""


@given(st.lists(IDS, min_size=13, max_size=13, unique=True))
def test_whatever_the_ids_every_street_has_a_name_of_its_own(ids: list[str]) -> None:
    net = sanitize_network(parse_crossing_network())
    old = [*(f"{way}_{arm}" for arm in ARMS for way in ("in", "out")), *ARMS, "mid"]
    replace_ids(net, dict(zip(old, ids, strict=True)))

    rename_network(net, {})

    network = ImportedNetwork.from_network(parse_network(net))
    names = [parse_edge_id(edge)[0] for edge in network.edges]
    assert sorted(Counter(names).values()) == [2, 2, 2, 2]
    assert all(re.fullmatch(ID_PATTERN, name) for name in (*names, *network.junctions))
    assert len(network.junctions) == 5
    for edge in network.edges.values():
        assert {edge.from_junction, edge.to_junction} <= {*network.junctions}
        assert [lane.id for lane in edge.lanes] == [f"{edge.id}_{n}" for n in range(3)]
    streets = read_imported_streets(pack_network(net))
    assert {len(street.left_strips) for street in streets.streets.values()} == {3}
    (moves,) = streets.movements.values()
    assert {move.from_street for move in moves} == {*streets.streets} == {*names}
    assert len(streets.signals) == 12


def replace_ids(net: Element, names: dict[str, str]) -> None:
    """Give edges and junctions other ids, wherever the network refers to them."""
    pattern = re.compile(rf"(?<![^ :])({'|'.join(names)})(?=$|[ _])")
    kept = {"type", "state", "shape", "function", "allow", "disallow", "programID"}
    for item in net.iter():
        for attribute in item.attrib.keys() - kept:
            item.set(attribute, pattern.sub(lambda m: names[m[1]], item.attrib[attribute]))


@pytest.mark.parametrize(
    ("name", "street"),
    [
        ("7th Avenue", "street_7th_avenue"),
        ("1", "street_1"),
        ("North", "street_north"),
        ("Opposite", "street_opposite"),
        ("Große Straße", "grosse_strasse"),
        ("明治通り", "road_11"),
        ("---", "road_11"),
        ("Long Street " * 25, "long_street_long_street_long_street_long"),
    ],
)
def test_any_name_of_a_street_becomes_an_id(name: str, street: str, tmp_path: Path) -> None:
    text = (DATA / "crossroads.osm").read_text(encoding="utf-8").replace("Große Straße", name)
    (tmp_path / "town.osm").write_text(text, encoding="utf-8")
    road = Road.model_validate(CROSSROADS)
    network = import_map(MapFile(source="osm", file="town.osm"), road, tmp_path)

    streets = RoutePlanner(road.model_copy(update={"imported": network})).streets

    assert {f"{street}_1", f"{street}_2"} < set(streets)


@given(
    st.lists(st.from_regex(ID_PATTERN, fullmatch=True), min_size=1, max_size=4, unique=True),
    st.data(),
)
def test_streets_of_our_own_networks_keep_their_ids(names: list[str], data: st.DataObject) -> None:
    """Streets lead along their axis, or both ways; edges come in any order."""
    own = [
        (name, along)
        for name in names
        for along in (True, False)[: 1 + data.draw(st.booleans(), label="both ways")]
    ]
    edges = data.draw(st.permutations(own))

    assert rename_streets(edges) == [sumo_edge_id(name, along=along) for name, along in edges]


@given(st.from_regex(ID_PATTERN, fullmatch=True), st.booleans())
def test_a_street_that_only_leads_against_its_axis_is_not_of_ours(name: str, twice: bool) -> None:
    edges = [(name, False), *([(f"{name}2", True)] if twice else [])]

    assert sumo_edge_id(name, along=False) not in rename_streets(edges)


def rename_streets(edges: Sequence[tuple[str, bool]]) -> list[str]:
    """Rename a network of edges along the axes of streets, or against them; return their ids."""
    net = fromstring("<net><junction id='1'/><junction id='2'/></net>")
    for name, along in edges:
        y = 20 * [name for name, _ in edges].index(name)
        _add_edge(net, sumo_edge_id(name, along=along), y if along else y + 4, along=along)
    rename_network(net, {})
    return [item.attrib["id"] for item in net.iter("edge")]


WORDS = st.one_of(
    st.text(max_size=20),
    st.sampled_from(["7th Avenue", "A", "a_1", "A 1", "North", "left", "main", "!", "x" * 300]),
)


@given(st.lists(WORDS, min_size=1, max_size=8))
def test_ids_of_streets_are_valid_and_differ_whatever_their_names(names: list[str]) -> None:
    net = _build_streets(len(names))

    rename_network(net, {str(number): name for number, name in enumerate(names)})

    streets = [parse_edge_id(item.attrib["id"])[0] for item in net.iter("edge")]
    assert len(set(streets)) == len(names)
    assert all(re.fullmatch(ID_PATTERN, name) for name in streets)
    assert not set(streets) & {*COMPASS_RAD, *RELATIVE_RAD}


def _build_streets(count: int) -> Element:
    """Build one-way streets from one junction to another."""
    net = fromstring("<net><junction id='1'/><junction id='2'/></net>")
    for number in range(count):
        _add_edge(net, str(number), 20 * number)
    return net


def _add_edge(net: Element, name: str, y: int, *, along: bool = True) -> None:
    """Add an edge of one lane between the junctions 1 and 2, or back."""
    first, last = ("1", "2") if along else ("2", "1")
    shape = f"0,{y} 100,{y}" if along else f"100,{y} 0,{y}"
    edge = Element("edge", {"id": name, "from": first, "to": last})
    lane = {"id": f"{name}_0", "index": "0", "shape": shape, "length": "100", "speed": "10"}
    edge.append(Element("lane", lane))
    net.append(edge)
