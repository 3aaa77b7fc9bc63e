"""Writes specs as JSON and reads them back; the same spec gives the same bytes anywhere."""

import json
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

from advercity_dsl import SPEC_VERSION, Spec
from pydantic import ValidationError

from advercity.compiler.diagnostics import DiagnosticsError
from advercity.compiler.source import (
    SourceDocument,
    SourcePosition,
    build_text_diagnostic,
    parse_document,
    read_source_text,
)
from advercity.compiler.validation import validate_model
from advercity.errors import InputError

MAX_LINE_LENGTH = 100


def to_json(spec: Spec) -> str:
    """Readable JSON: keys in the model's order, short lists and records on one line."""
    fields = spec.model_dump(mode="json")
    items = [
        f" {_format_flat(name)}: {_format_cached(_format_flat(value), ' ')}"
        for name, value in fields.items()
    ]
    return "{\n" + ",\n".join(items) + "\n}\n"


@lru_cache(maxsize=1024)
def _format_cached(flat: str, indent: str) -> str:
    """JSON text laid out; kept, since specs share roads, weathers and agents."""
    return _format_value(json.loads(flat), indent)


def _format_value(value: Any, indent: str) -> str:
    flat = _format_flat(value)
    if (
        len(indent) + len(flat) <= MAX_LINE_LENGTH
        or not isinstance(value, dict | list)
        or not value
    ):
        return flat
    inner = indent + " "
    if isinstance(value, dict):
        items = [
            f"{inner}{json.dumps(key)}: {_format_value(item, inner)}" for key, item in value.items()
        ]
        return "{\n" + ",\n".join(items) + f"\n{indent}}}"
    items = [inner + _format_value(item, inner) for item in value]
    return "[\n" + ",\n".join(items) + f"\n{indent}]"


def _format_flat(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False, allow_nan=False)


def write_specs(specs: Sequence[Spec], folder: Path) -> None:
    """Write every spec as `<id>.json`, and remove specs of the same suite that are no more.

    Raises:
        InputError: The folder cannot be written to.
    """
    texts = {f"{spec.id}.json": to_json(spec) for spec in specs}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in texts.items():
            _write_atomically(folder / name, text)
        for stale in _find_stale_files(folder, specs):
            stale.unlink()
    except OSError as error:
        raise InputError(f"{error.filename}: cannot be written: {error.strerror}") from error


def _write_atomically(path: Path, text: str) -> None:
    partial = path.with_suffix(".json.partial")
    partial.write_text(text, encoding="utf-8", newline="\n")
    partial.replace(path)


def _find_stale_files(folder: Path, specs: Sequence[Spec]) -> list[Path]:
    """Specs in `folder` that an earlier compilation of the same suites has left."""
    suites = {spec.provenance.suite for spec in specs}
    names = {f"{spec.id}.json" for spec in specs}
    others = [path for path in sorted(folder.glob("*.json")) if path.name not in names]
    return [path for path in others if _read_suite_id(path) in suites]


def _read_suite_id(path: Path) -> str | None:
    try:
        return str(json.loads(path.read_text(encoding="utf-8"))["provenance"]["suite"])
    except (OSError, ValueError, LookupError, TypeError):
        return None


def describe_spec_differences(specs: Sequence[Spec], folder: Path) -> list[str]:
    """What is missing, stale or different in `folder`, as sentences; empty if all is current."""
    texts = {f"{spec.id}.json": to_json(spec) for spec in specs}
    found = [f"{path}: no declaration makes this spec" for path in _find_stale_files(folder, specs)]
    for name, text in texts.items():
        path = folder / name
        if not path.is_file():
            found.append(f"{path}: is missing")
        elif path.read_text(encoding="utf-8") != text:
            found.append(f"{path}: differs from what the library compiles to")
    return found


def read_spec(path: Path) -> Spec:
    """A spec from its file; InputError with the place of what is wrong."""
    text = read_source_text(path)
    try:
        data = json.loads(text, parse_constant=_refuse_constant)
    except (ValueError, RecursionError) as error:
        at = SourcePosition(getattr(error, "lineno", 1), getattr(error, "colno", 1))
        reason = "it is nested too deep" if isinstance(error, RecursionError) else ""
        message = f"is no spec: {reason or getattr(error, 'msg', error)}"
        hint = "is it cut off? `advercity compile` writes it again"
        if path.suffix in (".yaml", ".yml"):
            hint = "`advercity compile` makes specs, which are JSON, of declarations"
        raise DiagnosticsError.from_diagnostic(
            build_text_diagnostic(path, text, at, message, hint=hint)
        ) from None
    try:
        return Spec.model_validate(data)
    except ValidationError:
        document = parse_document(path, text)
    _check_spec_version(document)
    return validate_model(Spec, document, known=document.diagnostics)


def _check_spec_version(document: SourceDocument) -> None:
    """Say what to do with a spec of another version before saying what is strange in it."""
    version = document.data.get("spec_version") if isinstance(document.data, dict) else None
    if not isinstance(version, int) or version == SPEC_VERSION:
        return
    message = f"the spec has version {version}; this advercity reads version {SPEC_VERSION}"
    newer = "upgrade advercity, or compile its library with this one"
    hint = newer if version > SPEC_VERSION else "compile its library again"
    raise DiagnosticsError.from_diagnostic(
        document.build_diagnostic(("spec_version",), message, hint=hint)
    )


def _refuse_constant(name: str) -> float:
    raise ValueError(f"{name} is no number of JSON")
