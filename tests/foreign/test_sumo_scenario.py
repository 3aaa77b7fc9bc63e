"""The table of SUMO scenarios against SUMO's own schemas."""

import xml.etree.ElementTree as ET
from fnmatch import fnmatchcase
from pathlib import Path

import pytest
import sumo
import yaml

import advercity.foreign

XSD = "{http://www.w3.org/2001/XMLSchema}"
SCHEMAS = Path(sumo.SUMO_HOME) / "data/xsd"
SYNONYMS = {"add"}
"""Elements that SUMO reads and its schemas lack."""


def list_names(*files: str) -> set[str]:
    """List the names of elements in schemas and what these include."""
    found: set[str] = set()
    pending, seen = [SCHEMAS / name for name in files], set[Path]()
    while pending:
        path = pending.pop().resolve()
        if path in seen:
            continue
        seen.add(path)
        root = ET.parse(path).getroot()
        pending += [path.parent / it.attrib["schemaLocation"] for it in root.iter(f"{XSD}include")]
        found |= {it.attrib["name"] for it in root.iter(f"{XSD}element") if "name" in it.attrib}
    return found


@pytest.mark.parametrize(
    ("section", "files"),
    [
        ("options", ["sumoConfiguration.xsd"]),
        ("elements", ["routes_file.xsd", "additional_file.xsd", "viewsettings_file.xsd"]),
    ],
)
def test_every_row_is_a_name_of_the_schema(section: str, files: list[str]) -> None:
    """Names without a row are reported, so that a misspelled row is the danger."""
    text = (Path(advercity.foreign.__path__[0]) / "tables" / "sumo_scenario.yaml").read_text(
        encoding="utf-8"
    )
    names = list_names(*files)

    rows = set(yaml.safe_load(text)[section]) - SYNONYMS

    assert [row for row in rows if not any(fnmatchcase(name, row) for name in names)] == []
