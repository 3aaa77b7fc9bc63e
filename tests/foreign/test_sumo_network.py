"""The table of SUMO networks against SUMO's own schema."""

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import sumo
from hypothesis import given
from hypothesis import strategies as st

from advercity.foreign.ledger import Ledger, describe_left_out
from advercity.foreign.standards import is_disposition, list_dispositions, load_standard
from advercity.foreign.xml_documents import parse_xml
from tests.roads.sumo_networks import build_crossing_network, parse_crossing_network

XSD = "{http://www.w3.org/2001/XMLSchema}"
SCHEMAS = Path(sumo.SUMO_HOME) / "data/xsd"


def list_schema_parts() -> Iterator[tuple[tuple[str, ...], str]]:
    """List the tags and attributes of networks by SUMO's schema."""
    files = ("net_file.xsd", "types/taz.xsd", "types/base.xsd")
    roots = [ET.parse(SCHEMAS / name).getroot() for name in files]
    types = {item.get("name"): item for root in roots for item in root.iter(f"{XSD}complexType")}

    def walk(tags: tuple[str, ...], kind: str) -> Iterator[tuple[tuple[str, ...], str]]:
        yield tags, "."
        for item in types[kind].iter(f"{XSD}attribute"):
            yield tags, item.attrib["name"]
        for item in types[kind].iter(f"{XSD}element"):
            yield from walk((*tags, item.attrib["name"]), item.attrib["type"])

    yield from walk(("net",), "netType")


def test_the_table_has_every_part_of_the_schema_and_no_other() -> None:
    table = load_standard("sumo_network")
    parts = set(list_schema_parts())
    missing = [
        (tags, name)
        for tags, name in parts
        if (row := table.find_row(tags)) is None or name not in row
    ]
    assert missing == []
    known = {(tag, name) for tags, name in parts for tag in ("/".join(tags[-2:]), tags[-1])}
    listed = {(element, name) for element, name, _ in list_dispositions(table)}
    assert listed - known == {("net", "noNamespaceSchemaLocation")}
    assert all(is_disposition(text) for _, _, text in list_dispositions(table))


def audit(root: Any) -> str:
    ledger = Ledger()
    load_standard("sumo_network").audit(root, ledger)
    return describe_left_out(ledger.left_out)


def test_nothing_of_a_plain_network_is_left_out() -> None:
    assert audit(parse_crossing_network()) == ""


@given(st.data())
def test_an_unknown_attribute_is_reported_wherever_it_is(data: st.DataObject) -> None:
    root = parse_crossing_network()
    item = data.draw(st.sampled_from(list(root.iter())))
    item.set("novel", data.draw(st.text(max_size=5)))

    assert f"1 unknown attribute {item.tag}@novel" in audit(root)


def test_what_has_no_effect_is_named_with_its_line() -> None:
    text = build_crossing_network(("tls.default-type", "actuated"))
    root = parse_xml(text.replace("<lane ", '<lane changeLeft="bus" ', 1).encode())

    assert audit(root).startswith("1 ban on changing lanes (line ")
    assert "1 adaptation of a signal program (line " in audit(root)
