"""From a library of declarations to specs: load, resolve, select, cover, cross, emit."""

from pathlib import Path

from advercity_dsl import Spec, Suite

from advercity.compiler.assembly import under
from advercity.compiler.comparison import compared
from advercity.compiler.crossing import cross
from advercity.compiler.emission import differences, read_spec, to_json, write_specs
from advercity.compiler.explanation import explained
from advercity.compiler.library import Entry, Library, load_library
from advercity.compiler.problems import Problem, ProblemsError, nearest
from advercity.compiler.shipped import (
    find_declaration,
    find_weather,
    shipped_library,
    shipped_weathers,
    validate_path,
)
from advercity.errors import InputError


def compile_library(*folders: Path, suite: str | None = None) -> list[Spec]:
    """Every spec of a library's suite; of its default or only one, or of the one called `suite`."""
    library = load_library(*folders)
    return cross(library, chosen_suite(library, *folders, suite=suite))


def chosen_suite(library: Library, *folders: Path, suite: str | None = None) -> Suite:
    """A library's default or only suite, or the one called `suite`.

    Raises:
        InputError: There is none, or no such one.
    """
    named = ", ".join(str(folder) for folder in folders)
    suites = library.of(Suite)
    usual = [item for item in suites.values() if item.default] or list(suites.values())
    if suite is None and len(usual) == 1:
        return usual[0]
    if suite in suites:
        return suites[suite]
    if not suites:
        raise InputError(f"{named}: has no suite; `advercity new suite NAME` writes one")
    if suite is None:
        choice = f"has {len(suites)} suites; name one with --suite: {', '.join(suites)}"
        raise InputError(f"{named}: {choice}")
    raise InputError(f"{named}: there is no suite '{suite}'; {nearest(suite, suites)}")


__all__ = [
    "Entry",
    "Library",
    "Problem",
    "ProblemsError",
    "chosen_suite",
    "compared",
    "compile_library",
    "cross",
    "differences",
    "explained",
    "find_declaration",
    "find_weather",
    "load_library",
    "nearest",
    "read_spec",
    "shipped_library",
    "shipped_weathers",
    "to_json",
    "under",
    "validate_path",
    "write_specs",
]
