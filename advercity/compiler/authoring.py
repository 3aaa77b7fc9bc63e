"""Editing of declarations: commented starters of each kind, and computed suns in weathers."""

import os
import re
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path

from advercity_dsl import DECLARATIONS
from advercity_dsl.base import ID_HINT, ID_PATTERN, suggest_name
from advercity_dsl.weather_components import Sun

from advercity.atomic_files import resolve_links, write_atomically
from advercity.compiler.schema import find_schema_file, write_schemas
from advercity.compiler.source import parse_document
from advercity.diagnostics import DiagnosticsError
from advercity.documents import read_text
from advercity.errors import InputError, report_write_errors
from advercity.output_files import check_is_outside_scenarios, is_replaceable

SCHEMAS_FOLDER = ".advercity"
"""Folder of a library with the schemas to which the first lines of its files refer."""


def format_starter(kind: str, name: str, *, schemas: str = SCHEMAS_FOLDER) -> str:
    """Format a declaration to start from; its first line refers editors to the schema.

    Args:
        kind: Kind of the declaration.
        name: Id of the declaration.
        schemas: Folder of schemas, relative to the file.

    Raises:
        InputError: The kind is unknown, or the name is not an id.
    """
    if kind not in DECLARATIONS:
        raise InputError(f"unknown kind '{kind}'; {suggest_name(kind, DECLARATIONS)}")
    if not re.fullmatch(ID_PATTERN, name):
        raise InputError(f"'{name}' is not an id; {ID_HINT}")
    if not isinstance(parse_document(Path(name), name).data, str):
        raise InputError(f"'{name}' is a value in YAML, not a text; choose another id")
    text = (files("advercity") / "compiler" / "starters" / f"{kind}.yaml").read_text("utf-8")
    modeline = f"# yaml-language-server: $schema={schemas}/{kind}.schema.json\n"
    return modeline + text.replace("{id}", name)


def write_starter(kind: str, name: str, folder: Path) -> Path:
    """Write a new declaration and its schema; existing declarations are never overwritten.

    The schema goes into the library's folder of schemas, or next to the file; an edited schema
    stays.

    Raises:
        InputError: The kind or name is not valid, the file exists, or the folder is in a scenario.
    """
    schemas = _find_schemas_folder(folder)
    text = format_starter(
        kind, name, schemas=Path(os.path.relpath(schemas, resolve_links(folder))).as_posix()
    )
    path = folder / f"{name}.yaml"
    check_is_outside_scenarios(folder)
    with report_write_errors():
        if os.path.lexists(path):
            raise InputError(f"{path}: already exists; choose another name")
        write_atomically(path, text.encode())
    # After the declaration: a taken name must not leave a schema behind.
    if is_replaceable(find_schema_file(kind, schemas)):
        write_schemas(schemas, [kind])
    return path


def _find_schemas_folder(folder: Path) -> Path:
    """Return the nearest existing folder of schemas in a folder or its parents, else a new one."""
    resolved = resolve_links(folder)
    candidates = (parent / SCHEMAS_FOLDER for parent in (resolved, *resolved.parents))
    return next((path for path in candidates if path.is_dir()), resolved / SCHEMAS_FOLDER)


SUN_AT_HEADER = "sun_at:  # found by `advercity solve`"


def write_sun_positions(path: Path, suns: Mapping[str, Sun]) -> None:
    """Add computed suns to a weather's `sun_at`, by road id, or insert it after `sun`.

    Comments and suns of other roads in the file stay.

    Raises:
        InputError: `sun` does not begin a line of the file, `sun_at` is written in one line or has
            one of the roads, or the file is not writable.
    """
    content = read_text(path)
    newline = "\r\n" if "\r\n" in content else "\n"
    lines = content.removesuffix(newline).split(newline)
    entries = [
        f"{road}: {{elevation_deg: {sun.elevation_deg:g}, azimuth_deg: {sun.azimuth_deg:g}}}"
        for road, sun in suns.items()
    ]
    place = _place_sun_entries(lines, entries)
    if place is None:
        text = ", ".join(entries)
        raise InputError(
            f"{path}: `sun` or `sun_at` does not begin a line of its own; write: sun_at: {{{text}}}"
        )
    index, added = place
    text = newline.join([*lines[:index], *added, *lines[index:], ""])
    # If the edit would break the file, it stays unchanged.
    if problems := parse_document(path, text).diagnostics:
        raise DiagnosticsError(*problems)
    with report_write_errors():
        write_atomically(resolve_links(path), text.encode())


def _place_sun_entries(lines: list[str], entries: list[str]) -> tuple[int, list[str]] | None:
    """Return the index of the line before which entries of `sun_at` go, and their lines.

    None if there is no such place.
    """
    former = _find_field_lines(lines, "sun_at")
    if former is None:
        sun = _find_field_lines(lines, "sun")
        return sun and (sun[1], [SUN_AT_HEADER, *(f"  {entry}" for entry in entries)])
    begin, end = former
    if lines[begin].removeprefix("sun_at:").partition("#")[0].strip():
        return None
    values = (line for line in lines[begin + 1 : end] if line.partition("#")[0].strip())
    first = next(values, "  ")
    indent = first[: len(first) - len(first.lstrip())] or "  "
    return end, [f"{indent}{entry}" for entry in entries]


def _find_field_lines(lines: list[str], name: str) -> tuple[int, int] | None:
    """Return the index of a top-level field's first line, and the index after its last line."""
    for begin, line in enumerate(lines):
        if line.startswith(f"{name}:"):
            end = begin + 1
            while end < len(lines) and lines[end].startswith((" ", "\t")):
                end += 1
            return begin, end
    return None
