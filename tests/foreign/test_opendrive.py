"""What of OpenDRIVE maps is read, and what is listed as left out."""

from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from advercity.foreign.ledger import Ledger, describe_left_out
from advercity.foreign.standards import is_disposition, list_dispositions, load_standard
from advercity.foreign.xml_documents import parse_xml
from advercity.roads.opendrive.omissions import record_omissions
from tests.roads.imported_roads import DATA
from tests.roads.opendrive_maps import import_text, lane, road, section

JUNCTION = (DATA / "junction.xodr").read_bytes()


def describe(root: Any) -> str:
    ledger = Ledger()
    record_omissions(root, ledger)
    return describe_left_out(ledger.left_out)


def test_every_part_has_a_disposition() -> None:
    parts = list(list_dispositions(load_standard("opendrive")))

    assert [item for item in parts if not is_disposition(item[2])] == []
    # Those of all lanes, of every geometry, and of both kinds of junctions.
    assert {("right/lane", "type"), ("paramPoly3", "pRange"), ("connection", "linkedRoad")} <= {
        (element, attribute) for element, attribute, _ in parts
    }


def test_nothing_of_a_plain_map_is_left_out() -> None:
    assert describe(parse_xml(JUNCTION)) == ""


@given(st.data())
def test_an_unknown_attribute_is_reported_wherever_it_is(data: st.DataObject) -> None:
    root = parse_xml(JUNCTION)
    item = data.draw(st.sampled_from(list(root.iter())))
    item.set("novel", data.draw(st.text(max_size=5)))

    assert f"1 unknown attribute {item.tag}@novel" in describe(root)


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        ("median", "1 median lane (line 1)"),
        ("rail", "1 rail lane (line 1)"),
        ("cable", "1 lane of unknown type 'cable' (line 1)"),
        ("bidirectional", "1 second direction of a bidirectional lane (line 1)"),
        ("bus", ""),
        ("none", ""),
    ],
)
def test_lanes_that_are_not_made_are_listed(kind: str, name: str, tmp_path: Path) -> None:
    lanes = section(0.0, lane(-1, "driving", 3.5), lane(-2, kind, 3.0))

    network = import_text(tmp_path, road("1", 50.0, lanes))

    assert describe_left_out(network.left_out) == name


@pytest.mark.parametrize(
    ("part", "name"),
    [
        ('<junction id="5" type="virtual"/>', "1 virtual junction"),
        (
            '<road><signals><signal id="1" type="206"/></signals></road>',
            "1 signal that is no light",
        ),
        ('<road><objects><object type="tree"/></objects></road>', "1 object that is no crosswalk"),
        ("<header><geoReference>+proj=lcc</geoReference></header>", "1 projection that is not"),
        ('<header><include file="a"/></header>', "1 included file"),
    ],
)
def test_parts_that_have_no_effect_are_named(part: str, name: str) -> None:
    assert name in describe(parse_xml(f"<OpenDRIVE>{part}</OpenDRIVE>".encode()))
