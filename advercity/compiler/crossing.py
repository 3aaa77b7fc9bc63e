"""Crosses a suite's roads, weathers and densities into specs."""

from collections.abc import Mapping
from itertools import product
from pathlib import Path

from advercity_dsl import Road, Spec, Suite, Typology
from advercity_dsl.base import suggest_name
from advercity_dsl.spec import CrashGroup

from advercity.compiler.assembly import build_spec
from advercity.compiler.diagnostics import Diagnostic, DiagnosticsError
from advercity.compiler.library import Library, load_declaration, load_library
from advercity.compiler.scenarios import (
    ScenarioInputs,
    build_scenario_inputs,
    expand_sweep,
    parse_conditions,
)
from advercity.compiler.spec_files import read_spec
from advercity.compiler.suite_conflicts import CrashGroups, select_conflicts, solve_road_conflicts
from advercity.compiler.suites import (
    ResolvedSuite,
    check_resolved_suite,
    find_required_categories,
    is_selected,
    resolve_suite,
)
from advercity.errors import InputError


def compile_library(*folders: Path, suite: str | None = None) -> list[Spec]:
    """Every spec of a library's suite; of its default or only one, or of the one called `suite`."""
    library = load_library(*folders)
    return compile_suite(library, find_suite(library, *folders, suite=suite))


def find_suite(library: Library, *folders: Path, suite: str | None = None) -> Suite:
    """A library's default or only suite, or the one called `suite`.

    Raises:
        InputError: There is none, or no such one.
    """
    named = ", ".join(str(folder) for folder in folders)
    suites = library.get_declarations(Suite)
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
    raise InputError(f"{named}: there is no suite '{suite}'; {suggest_name(suite, suites)}")


def validate_path(path: Path) -> None:
    """Check a spec, a declaration, or a whole library and its suites; raise on problems."""
    if path.suffix == ".json":
        read_spec(path)
        return
    if not path.is_dir():
        load_declaration(path)
        return
    library = load_library(path)
    for suite in library.get_declarations(Suite).values():
        compile_suite(library, suite)


def compile_suite(library: Library, suite: Suite, *, require_sun: bool = True) -> list[Spec]:
    """Every scenario of a suite, in the order of roads, weathers, densities and its sweep.

    Args:
        library: Where everything is.
        suite: What to cross.
        require_sun: Whether suns in somebody's view must have been found; else suns stand anywhere.

    Raises:
        ProblemsError: A reference leads nowhere, a required place has no road, a road has no
            required place, a sun in somebody's view is not found yet, or no scenario is left.
    """
    found = resolve_suite(library, suite)
    groups = _assign_crash_groups(library, suite, found.roads)
    check_resolved_suite(library, found)
    scenes = _build_crossings(library, suite, found, groups, require_sun=require_sun)
    conflicts = {
        key: solve_road_conflicts(library, suite, made.cell, made.density, made.blueprints)
        for key, made in {made.traffic_key: made for made in scenes}.items()
    }
    return [
        build_spec(
            library,
            suite,
            made,
            groups[made.road.id],
            conflicts[made.traffic_key],
            found.drivers,
        )
        for made in scenes
    ]


def _build_crossings(
    library: Library, suite: Suite, found: ResolvedSuite, groups: CrashGroups, *, require_sun: bool
) -> list[ScenarioInputs]:
    """Every crossing under every step, as far as the suite's conditions hold."""
    source = library.find_entry(suite).source
    asked, taken = parse_conditions(suite, source), expand_sweep(suite, source)
    crossed = product(
        select_conflicts(library, suite, found.roads, groups),
        found.weathers.values(),
        found.densities.values(),
        [found.rig],
        [found.catalogue],
    )
    made = (
        build_scenario_inputs(library, suite, parts, step, require_sun=require_sun)
        for parts in crossed
        for step in taken
    )
    kept = [one for one in made if all(condition.is_met(one.by_kind) for condition in asked)]
    if not kept:
        where = ("where",) if suite.where else ()
        hint = "widen `where`, or choose more roads, weathers and densities"
        raise DiagnosticsError.from_diagnostic(
            source.build_diagnostic(where, "no scenario is left", hint=hint)
        )
    return kept


def _assign_crash_groups(
    library: Library, suite: Suite, roads: Mapping[str, Road]
) -> dict[str, tuple[CrashGroup, ...]]:
    """The selected typologies that each road is here for.

    A suite of all roads has one for every place called for, and every road is called for.
    """
    problems: list[Diagnostic] = []
    groups: dict[str, list[CrashGroup]] = {name: [] for name in roads}
    for typology in library.get_declarations(Typology).values():
        if not is_selected(typology, suite.selection):
            continue
        group = CrashGroup(
            typology=typology.id, crash_types=tuple(item.id for item in typology.crash_types)
        )
        for cell in find_required_categories(typology, suite.coverage):
            fitting = [road for road in roads.values() if cell.matches(road)]
            if not fitting and suite.roads == "all":
                message = f"'{typology.id}' calls for a place that no road is: {cell}"
                problems.append(library.build_diagnostic(suite, "roads", message=message))
            for road in fitting:
                if group not in groups[road.id]:
                    groups[road.id].append(group)
    for name, found in groups.items():
        if not found:
            message = "no selected typology calls for such a place"
            hint = "leave the road out of the suite, or change the suite's selection or coverage"
            problems.append(library.build_diagnostic(roads[name], "id", message=message, hint=hint))
    if problems:
        raise DiagnosticsError(problems)
    return {name: tuple(found) for name, found in groups.items()}
