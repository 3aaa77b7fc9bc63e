"""Writes suns that were found into the weathers that asked for them, comments left as they are."""

from collections.abc import Mapping
from pathlib import Path

from advercity_dsl.weather import Sun

from advercity.compiler.source import parse, read_text
from advercity.errors import InputError

HEAD = "sun_at:  # found by `advercity solve`"


def write_suns(path: Path, suns: Mapping[str, Sun]) -> None:
    """Put suns, by road id, in the place of a weather's `sun_at`, or behind its `sun`.

    Raises:
        InputError: `sun` has no line of its own in the file, or it cannot be written.
    """
    block = [
        f"  {road}: {{elevation_deg: {sun.elevation_deg:g}, azimuth_deg: {sun.azimuth_deg:g}}}"
        for road, sun in suns.items()
    ]
    lines = read_text(path).splitlines()
    asked, there = _field(lines, "sun"), _field(lines, "sun_at")
    if asked is None:
        found = ", ".join(line.strip() for line in block)
        raise InputError(f"{path}: `sun` has no line of its own; write: sun_at: {{{found}}}")
    begin, end = there or (asked[1], asked[1])
    text = "\n".join([*lines[:begin], HEAD, *block, *lines[end:]]) + "\n"
    parse(path, text)
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from error


def _field(lines: list[str], name: str) -> tuple[int, int] | None:
    """The first line of a field of the declaration, and the one behind its last."""
    for begin, line in enumerate(lines):
        if line.startswith(f"{name}:"):
            end = begin + 1
            while end < len(lines) and lines[end].startswith((" ", "\t")):
                end += 1
            return begin, end
    return None
