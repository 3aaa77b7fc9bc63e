"""Specs as JSON files; the same spec has the same bytes on every machine."""

import json
import math
import os
from collections import Counter
from collections.abc import Iterable, Sequence
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Any

from advercity_dsl import SPEC_VERSION, Spec
from pydantic import ValidationError

from advercity.atomic_files import remove_abandoned_partials, write_atomically
from advercity.compiler.assembly import dump_spec, has_own_digest
from advercity.compiler.source import SourceDocument, parse_document
from advercity.compiler.validation import validate_model
from advercity.diagnostics import DiagnosticsError
from advercity.documents import MAX_JSON_BYTES, parse_json, read_bytes, read_text
from advercity.errors import InputError, report_write_errors
from advercity.output_files import check_is_outside_scenarios

MAX_LINE_LENGTH = 100


def to_json(spec: Spec) -> str:
    """Format a spec as JSON with keys in model order, short lists and records on one line."""
    fields = dump_spec(spec)
    items = [
        f" {_format_flat(name)}: {_lay_out_cached(_format_flat(value), ' ')}"
        for name, value in fields.items()
    ]
    return "{\n" + ",\n".join(items) + "\n}\n"


# By text, since nested data is not hashable.
@lru_cache(maxsize=1024)
def _lay_out_cached(flat: str, indent: str) -> str:
    """Lay out JSON text; cached, since specs have roads, weathers and agents in common."""
    return _lay_out_value(parse_json(flat, Path("spec")), indent)


def _lay_out_value(value: Any, indent: str) -> str:
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
            f"{inner}{json.dumps(key)}: {_lay_out_value(item, inner)}"
            for key, item in value.items()
        ]
        return "{\n" + ",\n".join(items) + f"\n{indent}}}"
    items = [inner + _lay_out_value(item, inner) for item in value]
    return "[\n" + ",\n".join(items) + f"\n{indent}]"


def _format_flat(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False, allow_nan=False)


def write_specs(specs: Iterable[Spec], folder: str | os.PathLike[str]) -> str:
    """Write every spec as `<id>.json`, and remove obsolete specs of the same suites.

    Only compiled files without later edits are replaced or removed.

    Returns:
        The numbers of changes: `2 new, 1 changed, 107 unchanged, 3 removed`.

    Raises:
        InputError: The folder is not writable or in a scenario of a dataset, or a file of the same
            name is not a spec as compiled.
    """
    specs, folder = list(specs), Path(folder)
    check_is_outside_scenarios(folder)
    texts = {f"{spec.id}.json": to_json(spec) for spec in specs}
    with report_write_errors():
        folder.mkdir(parents=True, exist_ok=True)
        remove_abandoned_partials(folder, max_age_s=math.inf)
        kinds = {name: _compare_file(folder / name, text) for name, text in texts.items()}
        for name, text in texts.items():
            if kinds[name] != "unchanged":
                write_atomically(folder / name, text.encode())
        changes = Counter(kinds.values())
        for path in _find_stale_files(folder, specs):
            path.unlink()
            changes["removed"] += 1
    order = ("new", "changed", "unchanged", "removed")
    return ", ".join(f"{changes[kind]} {kind}" for kind in order if changes[kind])


def check_spec_files(specs: Iterable[Spec], folder: Path) -> None:
    """Raise an InputError if `write_specs` would refuse to replace a file."""
    for spec in specs:
        _compare_file(folder / f"{spec.id}.json", to_json(spec))


def _compare_file(path: Path, text: str) -> str:
    if not os.path.lexists(path):
        return "new"
    if _has_text(path, text):
        return "unchanged"
    if _find_suite(path) is None:
        raise InputError(
            f"{path}: is not as it was compiled, and would be replaced; rename or delete it"
        )
    return "changed"


def _has_text(path: Path, text: str) -> bool:
    """Return whether a path is a regular file with this text; other kinds are not opened."""
    with suppress(InputError, OSError):
        return read_bytes(path, max_bytes=MAX_JSON_BYTES) == text.encode()
    return False


def _find_stale_files(folder: Path, specs: Sequence[Spec]) -> list[Path]:
    """Return the obsolete specs of the same suites in a folder."""
    suites = {spec.provenance.suite for spec in specs}
    names = {f"{spec.id}.json" for spec in specs}
    others = [path for path in sorted(folder.glob("*.json")) if path.name not in names]
    return [path for path in others if _find_suite(path) in suites]


def _find_suite(path: Path) -> str | None:
    """Return the suite of a compiled file; None if it is not as the compiler wrote it.

    A link is not, whatever its target.
    """
    if path.is_symlink():
        return None
    try:
        data = parse_json(read_text(path), path)
        is_own = path.stem == data["id"] and has_own_digest(data)
        return str(data["provenance"]["suite"]) if is_own else None
    except (InputError, LookupError, TypeError):
        return None


def describe_spec_differences(specs: Sequence[Spec], folder: Path) -> list[str]:
    """Describe each missing, obsolete or different spec in a folder."""
    texts = {f"{spec.id}.json": to_json(spec) for spec in specs}
    differences = [
        f"{path}: no declaration compiles to this spec" for path in _find_stale_files(folder, specs)
    ]
    for name, text in texts.items():
        path = folder / name
        if not path.exists():
            differences.append(f"{path}: is missing")
        elif not _has_text(path, text):
            differences.append(f"{path}: differs from what the library compiles to")
    return differences


def read_spec(path: Path) -> Spec:
    """Read a spec.

    Raises:
        DiagnosticsError: The file is not a valid spec of this version.
    """
    text = read_text(path)
    hint = "is it truncated? `advercity compile` writes it again"
    if path.suffix in (".yaml", ".yml"):
        hint = "`advercity compile` makes specs, which are JSON, from declarations"
    data = parse_json(text, path, hint=hint)
    try:
        return Spec.model_validate(data)
    except ValidationError:
        # Positions cost ten times as much as plain JSON and are needed for errors only.
        document = parse_document(path, text)
    _check_spec_version(document)
    return validate_model(Spec, document, previous=document.diagnostics)


def _check_spec_version(document: SourceDocument) -> None:
    """Check the version first, since another version explains all other errors."""
    version = document.data.get("spec_version") if isinstance(document.data, dict) else None
    if not isinstance(version, int) or version == SPEC_VERSION:
        return
    message = f"the spec has version {version}; this advercity reads version {SPEC_VERSION}"
    newer = "upgrade advercity, or compile its library with this one"
    hint = newer if version > SPEC_VERSION else "compile its library again"
    raise DiagnosticsError(document.build_diagnostic(("spec_version",), message, hint=hint))
