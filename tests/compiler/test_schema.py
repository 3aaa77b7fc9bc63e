import functools
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from advercity_dsl import DECLARATIONS

from advercity.compiler.authoring import format_starter
from advercity.compiler.schema import build_schema
from advercity.compiler.source import parse_document, read_document


@functools.cache
def build_validator(kind: str) -> jsonschema.Draft7Validator:
    jsonschema.Draft7Validator.check_schema(build_schema(kind))
    return jsonschema.Draft7Validator(build_schema(kind))


def find_violations(kind: str, data: Any) -> list[str]:
    return [error.message for error in build_validator(kind).iter_errors(data)]


@pytest.mark.parametrize("kind", DECLARATIONS)
def test_schemas_have_the_fields_of_every_declaration(kind: str) -> None:
    assert build_schema(kind)["properties"].keys() >= {"id", "kind", "extends", "source"}


def test_the_schema_has_units_and_ranges() -> None:
    rate = build_schema("weather")["$defs"]["Rain"]["properties"]["rate_mm_h"]
    assert rate["unit"] == "mm/h"
    assert rate["description"].startswith("Rate of rain: light below 2.5")
    assert {"type": "number", "minimum": 0, "maximum": 150} in rate["anyOf"]


@pytest.mark.parametrize("kind", DECLARATIONS)
def test_the_schema_describes_every_field(kind: str) -> None:
    schema = build_schema(kind)
    for definition in [schema, *schema.get("$defs", {}).values()]:
        fields: dict[str, Any] = definition.get("properties", {})
        assert [name for name, field in fields.items() if "description" not in field] == []


def test_every_shipped_file_meets_its_schema(library: Path) -> None:
    for path in library.rglob("*.yaml"):
        data = read_document(path).data
        assert find_violations(data["kind"], data) == [], path


@pytest.mark.parametrize("kind", DECLARATIONS)
def test_a_starter_meets_its_schema_until_an_unknown_key_is_added(kind: str) -> None:
    text = format_starter(kind, "mine")
    assert find_violations(kind, parse_document(Path("mine.yaml"), text).data) == []
    assert find_violations(kind, parse_document(Path("mine.yaml"), text + "\numbrella: 3\n").data)


@pytest.mark.parametrize(
    ("fog", "is_fine"),
    [
        ("75", True),
        ("0.1 km", True),
        ("null", True),
        ("{uniform: [50 m, 150]}", True),
        ("75 s", False),
        ("thick", False),
        ("5", False),
        ("{unifrom: [50, 150]}", False),
    ],
)
def test_a_number_may_be_a_quantity_or_distribution_in_the_schema(fog: str, is_fine: bool) -> None:
    text = f"kind: weather\nid: mine\ntime: day\nfog: {{mor_m: {fog}}}\n"
    assert (
        find_violations("weather", parse_document(Path("mine.yaml"), text).data) == []
    ) == is_fine
