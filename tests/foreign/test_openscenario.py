"""The table of OpenSCENARIO against ASAM's schema, and reports of parts that are unknown."""

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from advercity.diagnostics import DiagnosticsError
from advercity.foreign.ledger import describe_left_out
from advercity.foreign.standards import (
    ELEMENT,
    REFUSED,
    is_disposition,
    list_dispositions,
    load_standard,
)
from advercity.foreign.xml_documents import parse_xml
from advercity.recordings.openscenario.scenario import read_scenario
from tests.exports.readers import HINT, PYTHON
from tests.recordings.recorded_files import write_openscenario

TABLE = load_standard("openscenario")
LIST = Path(__file__).with_name("openscenario_1_3.txt")
XSD = "{http://www.w3.org/2001/XMLSchema}"
SCHEMA = next(
    PYTHON.parents[1].glob(
        "lib/python3*/site-packages/qc_openscenario/schema/1.3.0/OpenSCENARIO.xsd"
    ),
    None,
)
OLDER = {("TrafficeSignalGroupState", ELEMENT), ("TrafficeSignalGroupState", "state")}
"""The name of an element in version 1.2."""


def list_table() -> set[tuple[str, str]]:
    """List elements, without their parents, and attributes of the table."""
    return {(element.rpartition("/")[2], name) for element, name, _ in list_dispositions(TABLE)}


def list_schema(path: Path) -> Iterator[tuple[str, str]]:
    """List elements and attributes that a scenario can have by a schema."""
    root = ET.parse(path).getroot()
    types = {item.get("name"): item for item in root.iterfind(f"{XSD}complexType")}
    groups = {item.get("name"): item for item in root.iterfind(f"{XSD}group")}
    top = root.find(f"{XSD}element")
    assert top is not None
    queue, seen = [(top.attrib["name"], types[top.attrib["type"]])], set[tuple[str, ET.Element]]()
    while queue:
        name, kind = queue.pop()
        if (name, kind) in seen:
            continue
        seen.add((name, kind))
        yield name, ELEMENT
        for item in kind.iter():
            if item.tag == f"{XSD}attribute":
                yield name, item.attrib["name"]
            elif item.tag == f"{XSD}element":
                queue.append((item.attrib["name"], types[item.attrib["type"]]))
            elif item.tag == f"{XSD}group" and "ref" in item.attrib:
                queue.append((name, groups[item.attrib["ref"]]))


def test_the_table_has_every_name_of_the_standard_and_no_other() -> None:
    lines = [line.split() for line in LIST.read_text().splitlines()]
    names = {(line[0], name) for line in lines for name in (ELEMENT, *line[1:])}

    assert list_table() == names | OLDER
    assert all(is_disposition(text) for _, _, text in list_dispositions(TABLE))


@pytest.mark.skipif(SCHEMA is None, reason=HINT)
def test_the_table_has_every_part_of_the_schema_and_no_other() -> None:
    assert SCHEMA is not None
    assert list_table() == {*list_schema(SCHEMA)} | OLDER


def write_with_catalogue(folder: Path) -> tuple[Path, Path]:
    """Write a scenario whose car comes from a catalogue; return the paths of both."""
    path = write_openscenario(folder)
    text = path.read_text()
    found = re.search(r'<Vehicle name="bus".*?</Vehicle>', text, re.DOTALL)
    assert found is not None
    catalogue = folder / "cars.xosc"
    other = '<Vehicle name="other" colour="red"/>'
    catalogue.write_text(
        f'<OpenSCENARIO><FileHeader revMajor="1"/><Catalog name="Cars">{other}{found[0]}</Catalog>'
        "</OpenSCENARIO>"
    )
    place = '<VehicleCatalog><Directory path="."/></VehicleCatalog>'
    reference = '<CatalogReference catalogName="Cars" entryName="bus"/>'
    text = text.replace("<CatalogLocations/>", f"<CatalogLocations>{place}</CatalogLocations>")
    path.write_text(text.replace(found[0], reference))
    return path, catalogue


def test_nothing_of_a_plain_scenario_is_left_out(tmp_path: Path) -> None:
    path, _ = write_with_catalogue(tmp_path)

    assert describe_left_out(read_scenario(path).left_out) == ""


@settings(
    max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_an_unknown_part_is_reported_wherever_it_is(data: st.DataObject, tmp_path: Path) -> None:
    path = data.draw(st.sampled_from(write_with_catalogue(tmp_path)))
    root = parse_xml(path.read_bytes())
    items = [item for item in root.iter() if item.get("name") != "other"]
    item = data.draw(st.sampled_from(items))
    if data.draw(st.booleans()):
        item.set("novel", data.draw(st.text(st.characters(categories=["L", "N"]), max_size=5)))
        expected = f"1 unknown attribute {item.tag}@novel"
    else:
        item.append(ET.Element("Novel"))
        expected = "1 unknown element <Novel>"
    path.write_bytes(ET.tostring(root))

    try:
        told = describe_left_out(read_scenario(tmp_path / "crash.xosc").left_out)
    except DiagnosticsError as error:  # as an action that nobody knows
        told = str(error).replace("<Novel>: such an action is not read", expected)
    assert expected in told


REFUSED_ROWS = [
    (element, found["reason"])
    for element, name, text in list_dispositions(TABLE)
    if name == ELEMENT and (found := REFUSED.fullmatch(text))
]


@pytest.mark.parametrize(("element", "reason"), REFUSED_ROWS)
def test_all_that_the_table_refuses_is_refused(element: str, reason: str, tmp_path: Path) -> None:
    path = write_openscenario(tmp_path)
    text = path.read_text()
    path.write_text(text.replace("<CatalogLocations/>", f"<{element}/>"))

    with pytest.raises(DiagnosticsError) as caught:
        read_scenario(path)
    (diagnostic,) = caught.value.diagnostics
    assert diagnostic.headline.endswith(f"<{element}>: {reason}")
    assert "<CatalogLocations/>" in text.splitlines()[diagnostic.line - 1]
