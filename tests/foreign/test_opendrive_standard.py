"""The table of OpenDRIVE names what ASAM's schema does."""

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import pytest

from advercity.foreign.standards import ELEMENT, list_dispositions, load_standard
from tests.exports.readers import HINT, PYTHON

XSD = "{http://www.w3.org/2001/XMLSchema}"
LIST = Path(__file__).with_name("opendrive_1_8.txt")
"""Elements and their attributes by the schema of version 1.8.0."""
SCHEMA = next(PYTHON.parents[1].glob("lib/python3*/site-packages/qc_opendrive/schema/1.8.0"), None)
OLDER = {("crossfall", name) for name in (ELEMENT, "s", "side", *"abcd")} | {
    ("visibility", name) for name in (ELEMENT, "sOffset", "forward", "back", "left", "right")
}
"""Elements up to version 1.5."""


def list_table() -> set[tuple[str, str]]:
    """List elements, without their parents, and attributes of the table."""
    parts = list_dispositions(load_standard("opendrive"))
    return {(element.rpartition("/")[2], name) for element, name, _ in parts}


def list_schema(folder: Path) -> Iterator[tuple[str, str]]:
    """List elements and attributes that a map can have by a schema."""
    parts = {
        (item.tag.removeprefix(XSD), item.get("name", "")): item
        for path in folder.glob("*.xsd")
        for item in ET.parse(path).getroot()
    }
    queue, seen = [("OpenDRIVE", parts["element", "OpenDRIVE"])], set[tuple[str, ET.Element]]()
    while queue:
        name, kind = queue.pop()
        if (name, kind) in seen:
            continue
        seen.add((name, kind))
        if not name.startswith("_"):
            yield name, ELEMENT
        own = [kind]
        while own:
            item = own.pop()
            named = [item.attrib[key].rpartition(":")[2] for key in item.attrib if key != "name"]
            if item.tag == f"{XSD}attribute":
                yield name, item.attrib["name"]
            elif item.tag == f"{XSD}element" and item is not kind:
                queue.append((item.get("name") or named[-1], item))
                continue
            # Types, what they extend, groups, and elements that are declared elsewhere.
            for tag in ("complexType", "group", "element"):
                queue += [(name, parts[tag, text]) for text in named if (tag, text) in parts]
            own += item


def test_the_table_has_every_name_of_the_standard_and_no_other() -> None:
    lines = [line.split() for line in LIST.read_text().splitlines()]
    names = {(line[0], name) for line in lines for name in (ELEMENT, *line[1:])}

    assert list_table() == names | OLDER


@pytest.mark.skipif(SCHEMA is None, reason=HINT)
def test_the_table_has_every_part_of_the_schema_and_no_other() -> None:
    assert SCHEMA is not None
    assert list_table() == {*list_schema(SCHEMA)} | OLDER
