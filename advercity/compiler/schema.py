"""JSON Schemas of declarations, with which editors complete and check YAML."""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any, cast

from advercity_dsl import DECLARATIONS, LANGUAGE_VERSION, Model, Spec
from advercity_dsl.base import suggest_name
from advercity_dsl.distribution import DISTRIBUTIONS

from advercity.atomic_files import name_in_errors
from advercity.compiler.fields import collect_field_docs
from advercity.errors import InputError, report_write_errors
from advercity.output_files import open_output_folder

SCHEMA_MODELS: dict[str, type[Model]] = {**DECLARATIONS, "spec": Spec}
_BOUNDS = {
    "ge": "minimum",
    "gt": "exclusiveMinimum",
    "le": "maximum",
    "lt": "exclusiveMaximum",
}
"""Keywords of JSON Schema for the names of constraints in pydantic."""
_EXTENDS_SCHEMA = {
    "description": "Parents: an id of the same kind, or a list of ids. Mappings merge, other values"
    " replace.",
    "anyOf": [{"type": "string"}, {"type": "array", "items": {"type": "string"}, "minItems": 1}],
}
_VERSION_SCHEMA = {
    "description": "Version of the language it is written in; the current one if left out.",
    "const": LANGUAGE_VERSION,
}


def format_schema(kind: str) -> str:
    """Format the JSON Schema of a kind of declaration, or of the spec; InputError if unknown."""
    return json.dumps(build_schema(kind), indent=2)


def build_schema(kind: str) -> dict[str, Any]:
    """Build the same schema as plain data."""
    if kind not in SCHEMA_MODELS:
        raise InputError(f"unknown kind '{kind}'; {suggest_name(kind, SCHEMA_MODELS)}")
    model = SCHEMA_MODELS[kind]
    schema = _build_model_schema(model)
    if kind in DECLARATIONS:
        schema["properties"]["kind"] |= {"description": "Kind of declaration in this file."}
        schema["properties"] |= {"extends": _EXTENDS_SCHEMA, "version": _VERSION_SCHEMA}
        # Other required fields may be inherited by `extends`, which a schema cannot know.
        schema["required"] = ["kind", "id"]
        _let_mappings_extend(schema)
    if kind == "weather":
        _allow_distributions(schema)
    # The newest draft with complete support in the YAML language server.
    return {"$schema": "http://json-schema.org/draft-07/schema#", **schema}


def find_schema_file(kind: str, folder: Path) -> Path:
    """Return the file of a kind's schema in a folder: `<kind>.schema.json`."""
    return folder / f"{kind}.schema.json"


def write_schemas(folder: Path, kinds: Iterable[str] = SCHEMA_MODELS) -> None:
    """Write the schemas of kinds, all or none.

    Raises:
        InputError: A file cannot be written, or exists and may not be replaced.
    """
    with report_write_errors(), open_output_folder(folder) as made:
        for kind in kinds:
            with name_in_errors(find_schema_file(kind, folder)):
                find_schema_file(kind, made).write_bytes(format_schema(kind).encode() + b"\n")


def _build_model_schema(model: type[Model]) -> dict[str, Any]:
    """Build the schema of a model, with the docstrings of its fields as descriptions."""
    schema = _normalize_keywords(model.model_json_schema())
    for name, texts in collect_field_docs(model).items():
        definition = schema if name == model.__name__ else schema["$defs"].get(name, {})
        for field, text in texts.items():
            if field in definition.get("properties", {}):
                definition["properties"][field]["description"] = text
    return schema


def _let_mappings_extend(schema: dict[str, Any]) -> None:
    """Require the fields of mappings only at the top of files without `extends`.

    Mappings merge with the parents' mappings.
    """
    names = {
        field: references[0]
        for field, content in schema["properties"].items()
        if len(references := _list_references(content)) == 1
    }
    required = {
        field: {"required": schema["$defs"][name]["required"]}
        for field, name in names.items()
        if "required" in schema["$defs"][name]
    }
    for field in required:
        schema["$defs"][names[field]].pop("required", None)
    schema |= {"if": {"required": ["extends"]}, "else": {"properties": required}}


def _list_references(field: dict[str, Any]) -> list[str]:
    """List the names of the definitions to which a field refers, without those of its items."""
    options = [field, *field.get("anyOf", [])]
    return [option["$ref"].rpartition("/")[2] for option in options if "$ref" in option]


def _normalize_keywords(data: Any) -> Any:
    """Rename constraints to JSON Schema's keywords, and drop titles, which only repeat names."""
    if isinstance(data, list):
        return [_normalize_keywords(item) for item in cast(list[Any], data)]
    if not isinstance(data, dict):
        return data
    mapping = cast(dict[str, Any], data)
    return {
        _BOUNDS.get(key, key): _normalize_keywords(value)
        for key, value in mapping.items()
        if not (key == "title" and isinstance(value, str))
    }


def _allow_distributions(schema: dict[str, Any]) -> None:
    """Allow a distribution instead of every number of a weather."""
    for name, model in DISTRIBUTIONS.items():
        definition = _allow_quantities(_build_model_schema(model))
        schema["$defs"] |= definition.pop("$defs", {})
        schema["$defs"][name] = definition
    references = [{"$ref": f"#/$defs/{name}"} for name in DISTRIBUTIONS]
    for definition in [schema, *schema["$defs"].values()]:
        if definition in [schema["$defs"][name] for name in DISTRIBUTIONS]:
            continue
        for name, field in definition.get("properties", {}).items():
            if _allows_numbers(field):
                definition["properties"][name] = _add_alternatives(field, references)


def _allow_quantities(data: Any) -> Any:
    """Allow text such as `0.1 km` instead of every number."""
    if isinstance(data, list):
        return [_allow_quantities(item) for item in cast(list[Any], data)]
    if not isinstance(data, dict):
        return data
    mapping = cast(dict[str, Any], data)
    result = {key: _allow_quantities(value) for key, value in mapping.items()}
    return result | ({"type": ["number", "string"]} if mapping.get("type") == "number" else {})


def _allows_numbers(field: Any) -> bool:
    if field.get("type") in ("number", "integer"):
        return True
    return any(_allows_numbers(item) for item in field.get("anyOf", []))


def _add_alternatives(field: dict[str, Any], more: list[Any]) -> dict[str, Any]:
    # Editors look for these next to `anyOf`, not inside its alternatives.
    kept = {k: field[k] for k in ("description", "default", "unit", "examples") if k in field}
    inner = {key: value for key, value in field.items() if key not in kept}
    own = inner["anyOf"] if set(inner) == {"anyOf"} else [inner]
    return {**kept, "anyOf": [*own, *more]}
