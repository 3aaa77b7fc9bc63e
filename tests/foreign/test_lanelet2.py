"""Parts of Lanelet2 maps that are read, and those that are listed as left out."""

from typing import Any
from xml.etree.ElementTree import tostring

import pytest
from hypothesis import given
from hypothesis import strategies as st

from advercity.foreign.ledger import Ledger, describe_left_out
from advercity.foreign.standards import is_disposition, list_dispositions, load_standard
from advercity.foreign.xml_documents import parse_xml
from advercity.roads.lanelet2.omissions import record_omissions
from tests.roads.lanelet2_maps import LaneletMap, member

LINE_TYPES = (
    "line_thin line_thick curbstone virtual road_border guard_rail wall fence zebra_marking"
    " pedestrian_marking bike_marking keepout jersey_barrier gate door rail arrow stop_line"
    " yield_line zig-zag lift_gate bump traffic_sign traffic_light"
)
SUBTYPES = (
    "road highway play_street emergency_lane bus_lane bicycle_lane exit walkway shared_walkway"
    " crosswalk stairs"
)
AREA_SUBTYPES = "parking freespace vegetation keepout building traffic_island"
RULE_SUBTYPES = "traffic_sign traffic_light speed_limit right_of_way all_way_stop"
ROLES = "refers cancels ref_line cancel_line yield right_of_way"
"""Values that the format's documents name."""


def build_map() -> Any:
    lanelets = LaneletMap()
    rule = lanelets.rule("speed_limit", sign_type="30 km/h")
    ways = [lanelets.way([(0.0, y), (50.0, y)]) for y in (3.0, 0.0)]
    lanelets.lanelet(ways[0], ways[1], [rule], location="urban", one_way="yes")
    return parse_xml(lanelets.write().encode())


def describe(root: Any) -> str:
    ledger = Ledger()
    record_omissions(root, ledger)
    return describe_left_out(ledger.left_out)


def test_every_part_has_a_disposition() -> None:
    parts = list(list_dispositions(load_standard("lanelet2")))

    assert [item for item in parts if not is_disposition(item[2])] == []
    named = {(element, attribute) for element, attribute, _ in parts}
    for row, values in (
        ("way tags", [f"type={name}" for name in LINE_TYPES.split()]),
        ("lanelet tags", [f"subtype={name}" for name in SUBTYPES.split()]),
        ("area tags", [f"subtype={name}" for name in AREA_SUBTYPES.split()]),
        ("rule tags", [f"subtype={name}" for name in RULE_SUBTYPES.split()]),
        ("rule roles", ROLES.split()),
        ("lanelet roles", ["left", "right", "centerline", "regulatory_element"]),
    ):
        assert {(row, value) for value in values} <= named


def test_a_plain_map_has_no_part_that_is_left_out() -> None:
    assert describe(build_map()) == ""


@given(st.data())
def test_an_unknown_attribute_is_reported_wherever_it_is(data: st.DataObject) -> None:
    root = build_map()
    item = data.draw(st.sampled_from(list(root.iter())))
    item.set("novel", data.draw(st.text(max_size=5)))

    assert f"1 unknown attribute {item.tag}@novel" in describe(root)


@given(st.data())
def test_an_unknown_tag_is_reported_wherever_it_is(data: st.DataObject) -> None:
    root = build_map()
    tag = data.draw(st.sampled_from([it for it in root.iter("tag") if it.get("k") != "type"]))
    tag.set("k", "novel")

    assert "1 unknown tag novel" in describe(root)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('v="road"', 'v="stairs"', "1 stairs"),
        ('v="road"', 'v="canal"', "1 lanelet of another subtype"),
        ('role="left"', 'role="upper"', "1 member as 'upper'"),
        ('v="line_thin"', 'v="fence"', "2 fences"),
        ('v="speed_limit"', 'v="no_overtaking"', "1 rule of another kind"),
        ('v="regulatory_element"', 'v="route"', "1 relation of another type"),
    ],
)
def test_parts_that_have_no_effect_are_named(old: str, new: str, told: str) -> None:
    text = tostring(build_map(), encoding="unicode").replace(old, new)

    assert told in describe(parse_xml(text.encode()))


def test_members_are_counted_by_their_roles() -> None:
    lanelets = LaneletMap()
    ways = [lanelets.way([(0.0, y), (50.0, y)]) for y in (3.0, 0.0, -1.0)]
    lanelets.rule("traffic_sign", member("ref_line", ways[2]) + member("cancels", ways[1]))

    told = describe(parse_xml(lanelets.write().encode()))

    assert "1 line where a rule begins (streets' ends are taken)" in told
    assert "1 end of a rule" in told
