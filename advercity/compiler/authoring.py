"""Files to start from: one commented declaration of each kind, which compiles as it is.

Writes suns that were found into the weathers that asked for them, comments left as they are.
"""

import os
import re
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path

from advercity_dsl import DECLARATIONS
from advercity_dsl.base import suggest_name
from advercity_dsl.weather import Sun

from advercity.compiler.schema import write_schema
from advercity.compiler.source import parse_document, read_source_text
from advercity.compiler.validation import ID_HINT
from advercity.errors import InputError

SCHEMAS_FOLDER = ".advercity"
"""Folder of a library with the schemas that the first lines of its files name."""


def format_starter(kind: str, name: str, *, schemas: str = SCHEMAS_FOLDER) -> str:
    """Text of a declaration of `kind` called `name`; its first line tells editors its schema.

    Args:
        kind: Of the declaration.
        name: Its id.
        schemas: Folder of schemas, relative to the file.

    Raises:
        InputError: There is no such kind, or the name is no id.
    """
    if kind not in DECLARATIONS:
        raise InputError(f"there is no kind '{kind}'; {suggest_name(kind, DECLARATIONS)}")
    if not re.fullmatch(r"[a-z][a-z0-9_]{0,63}", name):
        raise InputError(f"'{name}' is not an id; {ID_HINT}")
    text = (files("advercity") / "compiler" / "starters" / f"{kind}.yaml").read_text("utf-8")
    modeline = f"# yaml-language-server: $schema={schemas}/{kind}.schema.json\n"
    return modeline + text.replace("{id}", name)


def write_starter(kind: str, name: str, folder: Path) -> Path:
    """Write a new declaration, and its schema for editors; no declaration is overwritten.

    The schema goes into the library's folder of schemas, or into a new one beside the file.

    Raises:
        InputError: The kind or name is wrong, or the file is there already.
    """
    schemas = _find_schemas_folder(folder)
    text = format_starter(
        kind, name, schemas=Path(os.path.relpath(schemas, folder.resolve())).as_posix()
    )
    path = folder / f"{name}.yaml"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with path.open("x", encoding="utf-8", newline="\n") as file:
            file.write(text)
    except FileExistsError:
        raise InputError(f"{path}: is there already; choose another name") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from error
    write_schema(kind, schemas)
    return path


def _find_schemas_folder(folder: Path) -> Path:
    """The nearest folder of schemas in or above a folder; in it if there is none."""
    inside = folder.resolve()
    around = (inside, *inside.parents)
    found = (parent / SCHEMAS_FOLDER for parent in around if (parent / SCHEMAS_FOLDER).is_dir())
    return next(found, inside / SCHEMAS_FOLDER)


SUN_AT_HEADER = "sun_at:  # found by `advercity solve`"


def write_sun_positions(path: Path, suns: Mapping[str, Sun]) -> None:
    """Put suns, by road id, in the place of a weather's `sun_at`, or behind its `sun`.

    Raises:
        InputError: `sun` has no line of its own in the file, or it cannot be written.
    """
    block = [
        f"  {road}: {{elevation_deg: {sun.elevation_deg:g}, azimuth_deg: {sun.azimuth_deg:g}}}"
        for road, sun in suns.items()
    ]
    lines = read_source_text(path).splitlines()
    asked, there = _find_field_lines(lines, "sun"), _find_field_lines(lines, "sun_at")
    if asked is None:
        found = ", ".join(line.strip() for line in block)
        raise InputError(f"{path}: `sun` has no line of its own; write: sun_at: {{{found}}}")
    begin, end = there or (asked[1], asked[1])
    text = "\n".join([*lines[:begin], SUN_AT_HEADER, *block, *lines[end:]]) + "\n"
    parse_document(path, text)
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from error


def _find_field_lines(lines: list[str], name: str) -> tuple[int, int] | None:
    """The first line of a field of the declaration, and the one behind its last."""
    for begin, line in enumerate(lines):
        if line.startswith(f"{name}:"):
            end = begin + 1
            while end < len(lines) and lines[end].startswith((" ", "\t")):
                end += 1
            return begin, end
    return None
