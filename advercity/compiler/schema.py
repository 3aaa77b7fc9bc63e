"""JSON Schemas of what people write, for editors that complete and check YAML."""

import json
from pathlib import Path
from typing import Any, cast

from advercity_dsl import DECLARATIONS, LANGUAGE_VERSION, Model, Spec
from advercity_dsl.base import suggest_name
from advercity_dsl.distribution import DISTRIBUTIONS

from advercity.compiler.fields import collect_field_docs
from advercity.errors import InputError

SCHEMA_MODELS: dict[str, type[Model]] = {**DECLARATIONS, "spec": Spec}
_BOUNDS = {
    "ge": "minimum",
    "gt": "exclusiveMinimum",
    "le": "maximum",
    "lt": "exclusiveMaximum",
}
"""JSON Schema's words for pydantic's."""
_EXTENDS_SCHEMA = {
    "description": "What this builds on: an id of the same kind, or a list of ids. Mappings merge,"
    " all else replaces.",
    "anyOf": [{"type": "string"}, {"type": "array", "items": {"type": "string"}, "minItems": 1}],
}
_VERSION_SCHEMA = {
    "description": "Version of the language it is written in; the current one if left out.",
    "const": LANGUAGE_VERSION,
}


def format_schema(kind: str) -> str:
    """JSON Schema of a kind of declaration, or of the spec; InputError if there is no such kind."""
    return json.dumps(build_schema(kind), indent=2)


def build_schema(kind: str) -> dict[str, Any]:
    """The same as plain data."""
    if kind not in SCHEMA_MODELS:
        raise InputError(f"there is no kind '{kind}'; {suggest_name(kind, SCHEMA_MODELS)}")
    model = SCHEMA_MODELS[kind]
    schema = _build_model_schema(model)
    if kind in DECLARATIONS:
        schema["properties"]["kind"] |= {"description": "What this file declares."}
        schema["properties"] |= {"extends": _EXTENDS_SCHEMA, "version": _VERSION_SCHEMA}
        schema["required"] = ["kind", "id"]
    if kind == "weather":
        _allow_distributions(schema)
    return {"$schema": "http://json-schema.org/draft-07/schema#", **schema}


def write_schema(kind: str, folder: Path) -> None:
    """Write `<kind>.schema.json`."""
    text = format_schema(kind) + "\n"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / f"{kind}.schema.json").write_text(text, encoding="utf-8", newline="\n")
    except OSError as error:
        raise InputError(f"{error.filename}: cannot be written: {error.strerror}") from error


def write_schemas(folder: Path) -> None:
    """Write `<kind>.schema.json` for every kind."""
    for kind in SCHEMA_MODELS:
        write_schema(kind, folder)


def _build_model_schema(model: type[Model]) -> dict[str, Any]:
    """The schema of a model, with what the source says about its fields."""
    schema = _normalize_keywords(model.model_json_schema())
    for name, text in collect_field_docs(model).items():
        definition = schema if name == model.__name__ else schema["$defs"].get(name, {})
        for field, words in text.items():
            if field in definition.get("properties", {}):
                definition["properties"][field]["description"] = words
    return schema


def _normalize_keywords(data: Any) -> Any:
    """Bounds in JSON Schema's words, and no titles that only repeat names."""
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
    """Let a distribution stand wherever a weather has a number."""
    for name, model in DISTRIBUTIONS.items():
        found = _allow_quantities(_build_model_schema(model))
        schema["$defs"] |= found.pop("$defs", {})
        schema["$defs"][name] = found
    either = [{"$ref": f"#/$defs/{name}"} for name in DISTRIBUTIONS]
    for definition in [schema, *schema["$defs"].values()]:
        if definition in [schema["$defs"][name] for name in DISTRIBUTIONS]:
            continue
        for name, field in definition.get("properties", {}).items():
            if _is_number(field):
                definition["properties"][name] = _add_alternatives(field, either)


def _allow_quantities(data: Any) -> Any:
    """Text, `0.1 km`, wherever a number stands."""
    if isinstance(data, list):
        return [_allow_quantities(item) for item in cast(list[Any], data)]
    if not isinstance(data, dict):
        return data
    mapping = cast(dict[str, Any], data)
    result = {key: _allow_quantities(value) for key, value in mapping.items()}
    return result | ({"type": ["number", "string"]} if mapping.get("type") == "number" else {})


def _is_number(field: Any) -> bool:
    if field.get("type") in ("number", "integer"):
        return True
    return any(_is_number(item) for item in field.get("anyOf", []))


def _add_alternatives(field: dict[str, Any], more: list[Any]) -> dict[str, Any]:
    about = ("description", "default", "unit", "examples")
    kept = {key: field[key] for key in about if key in field}
    inner = {key: value for key, value in field.items() if key not in kept}
    own = inner["anyOf"] if set(inner) == {"anyOf"} else [inner]
    return {**kept, "anyOf": [*own, *more]}
