"""Finds declarations that people name: in a file of theirs, or in the library that ships."""

from importlib.resources import files
from pathlib import Path
from typing import cast

from advercity_dsl import Declaration, Suite, Weather

from advercity.compiler.crossing import cross
from advercity.compiler.emission import read_spec
from advercity.compiler.library import Entry, load_beside, load_library
from advercity.compiler.problems import ProblemsError, nearest
from advercity.errors import InputError


def shipped_library() -> Path:
    """The library inside the installed package, or beside the source in a checkout."""
    source = Path(__file__).parents[2] / "library"
    return source if source.is_dir() else Path(str(files("advercity") / "_library"))


def find_declaration(path: Path) -> Entry[Declaration]:
    """The declaration in a file; it may extend those that ship."""
    return load_beside(path, shipped_library())


def find_weather(text: str) -> Entry[Weather]:
    """The weather in the file `text`, or the shipped one with that name.

    A weather in a file of its own may extend those that ship.
    """
    path = Path(text)
    if path.suffix in (".yaml", ".yml") or path.exists():
        entry = find_declaration(path)
        if not isinstance(entry.declaration, Weather):
            problem = entry.source.problem(("kind",), "is no weather", hint="give a weather's file")
            raise ProblemsError.of(problem)
        return cast(Entry[Weather], entry)
    library = load_library(shipped_library())
    weathers = library.of(Weather)
    if text not in weathers:
        hint = nearest(text, weathers)
        raise InputError(f"there is no weather '{text}', and no such file; {hint}")
    return library.entry(weathers[text])


def shipped_weathers() -> list[str]:
    """Names of the weathers that ship."""
    return list(load_library(shipped_library()).of(Weather))


def validate_path(path: Path) -> None:
    """Check a spec, a declaration, or a whole library and its suites; raise on problems."""
    if path.suffix == ".json":
        read_spec(path)
        return
    if not path.is_dir():
        find_declaration(path)
        return
    library = load_library(path)
    for suite in library.of(Suite).values():
        cross(library, suite)
