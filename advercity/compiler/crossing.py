"""Compilation of suites: crossing roads, weathers and densities into specs."""

import logging
import math
import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import TypeVar

from advercity_dsl import Road, Spec, Suite, Typology
from advercity_dsl.base import suggest_name
from advercity_dsl.spec import CrashGroup

from advercity.compiler.assembly import build_spec, find_ego_blueprint, is_edited
from advercity.compiler.extends import ResolvedDeclaration
from advercity.compiler.library import (
    Library,
    load_declaration,
    load_library,
)
from advercity.compiler.model_locks import list_model_assets
from advercity.compiler.references import check_references
from advercity.compiler.scenarios import (
    ScenarioInputs,
    TrafficKey,
    build_scenario_inputs,
    expand_sweeps,
    parse_conditions,
)
from advercity.compiler.settling import Settler, SolvedTraffic
from advercity.compiler.shipped_library import find_shipped_library
from advercity.compiler.spec_files import read_spec
from advercity.compiler.suite_conflicts import (
    CrashGroups,
    UnstageableError,
    build_refusal_diagnostic,
    select_conflicts,
    solve_road_conflicts,
)
from advercity.compiler.suites import (
    ResolvedSuite,
    check_demand,
    check_resolved_suite,
    find_required_categories,
    is_selected,
    list_left_out,
    resolve_suite,
)
from advercity.diagnostics import Diagnostic, DiagnosticsError
from advercity.errors import InputError
from advercity.texture_packs import TEXTURE_PACKS

_logger = logging.getLogger(__name__)
ResultT = TypeVar("ResultT")
MAX_SPECS = 100_000
"""Limit for the scenarios of a suite; their specs take gigabytes."""
MAX_PROBLEMS = 20
"""Number of equal ids in the report."""


def compile_library(
    *folders: str | os.PathLike[str], suite: str | None = None, settler: Settler | None = None
) -> list[Spec]:
    """Compile the scenarios of a suite; `advercity.write_specs` puts them into files.

    Args:
        folders: Libraries, which may refer to each other; by default advercity's own.
        suite: Id of the suite; None is the libraries' default or only suite.
        settler: Seeks seeds and waits with which staged conflicts happen, by simulation.

    Raises:
        InputError: The text lists every problem with file, line, column and a hint.
    """
    paths = [Path(folder) for folder in folders] or [find_shipped_library()]
    library = load_library(*paths)
    return compile_suite(library, find_suite(library, *paths, suite=suite), settler=settler)


def find_suite(library: Library, *folders: Path, suite: str | None = None) -> Suite:
    """Return the suite `suite` of a library, by default its default or only one.

    Raises:
        InputError: No suite has the name, or several fit.
    """
    where = ", ".join(str(folder) for folder in folders)
    suites = library.get_declarations(Suite)
    defaults = [item for item in suites.values() if item.default] or list(suites.values())
    if suite is None and len(defaults) == 1:
        return defaults[0]
    if suite in suites:
        return suites[suite]
    if not suites:
        raise InputError(f"{where}: has no suite; `advercity new suite NAME` writes one")
    if suite is None:
        names = ", ".join(suites)
        raise InputError(f"{where}: has {len(suites)} suites; select one with `suite`: {names}")
    raise InputError(f"{where}: unknown suite '{suite}'; {suggest_name(suite, suites)}")


def validate_paths(*paths: Path) -> str:
    """Validate specs, declarations, and libraries with their suites.

    Libraries and declarations are one library, as when they are compiled; declarations without any
    library are validated one by one. The shipped suites are validated only without others: they
    select from all declarations, so they are of no use with the ones you add.

    Returns:
        Numbers of checked specs, declarations and scenarios.

    Raises:
        InputError: With the errors of all of them; also for a spec edited after it was compiled.
    """
    specs = [path for path in paths if path.suffix == ".json"]
    declared = [path for path in paths if path.suffix != ".json"]
    checks: list[Callable[[], tuple[int, int]]] = [partial(_validate_spec, path) for path in specs]
    if any(path.is_dir() for path in declared):
        checks.append(partial(_validate_library, *declared))
    else:
        checks += [partial(_validate_declaration, path) for path in declared]
    found = _run_checks(checks)
    declarations, scenarios = (sum(counts) for counts in zip((0, 0), *found, strict=True))
    counts = {"spec": len(specs), "declaration": declarations, "scenario": scenarios}
    return ", ".join(f"{n} {name}{'' if n == 1 else 's'}" for name, n in counts.items() if n)


def _validate_spec(path: Path) -> tuple[int, int]:
    check_not_edited(read_spec(path), path)
    return 0, 0


def _validate_declaration(path: Path) -> tuple[int, int]:
    load_declaration(path)
    return 1, 0


def _validate_library(*folders: Path) -> tuple[int, int]:
    library = load_library(*folders)
    declared = library.get_declarations(Suite).values()
    suites = [suite for suite in declared if not library.is_shipped(suite)] or declared
    check_references(library, suites)
    compiled = _run_checks([partial(compile_suite, library, suite) for suite in suites])
    return len(library.entries), sum(map(len, compiled))


def _run_checks(checks: Iterable[Callable[[], ResultT]]) -> list[ResultT]:
    """Run every check and return the results; raise the errors of all as one."""
    results: list[ResultT] = []
    errors: list[InputError] = []
    for check in checks:
        try:
            results.append(check())
        except InputError as error:
            errors.append(error)
    diagnostics = [error.diagnostics for error in errors if isinstance(error, DiagnosticsError)]
    if errors and len(diagnostics) == len(errors):
        raise DiagnosticsError(*(item for found in diagnostics for item in found))
    if errors:
        raise InputError(*(line for error in errors for line in error.args))
    return results


def check_not_edited(spec: Spec, where: object) -> None:
    """Raise InputError if a spec was edited after it was compiled."""
    if is_edited(spec):
        raise InputError(
            f"{where}: was edited after it was compiled: its content is not that of its"
            " `provenance.digest`; change the declarations and compile them again"
            " (`advercity compile LIBRARY`), or run it as it is with `allow_edited`"
        )


def compile_suite(
    library: Library, suite: Suite, *, require_sun: bool = True, settler: Settler | None = None
) -> list[Spec]:
    """Compile every scenario of a suite: by road, weather, density, sweep step and repeat.

    Args:
        library: Library of all declarations.
        suite: Suite to compile.
        require_sun: Whether a sun in view of the ego must have been computed; any is used if not.
        settler: Seeks seeds and waits with which staged conflicts happen, by simulation.

    Raises:
        DiagnosticsError: A name is unknown, a required kind of road is missing, a road is not
            required, a sun in view of the ego has not been computed, or no scenario remains.
    """
    check_references(library, [suite])
    resolved = resolve_suite(library, suite)
    groups = _assign_crash_groups(library, suite, resolved.roads)
    check_resolved_suite(library, suite, resolved)
    for line in list_left_out(library, resolved):
        _logger.warning("%s", line)
    scenarios = _build_scenarios(library, suite, resolved, groups, require_sun=require_sun)
    by_traffic = {inputs.traffic_key: inputs for inputs in scenarios}
    by_demand = {(item.road.id, item.density.id, item.steps): item for item in scenarios}
    _run_checks(
        partial(check_demand, library, inputs.road, inputs.density) for inputs in by_demand.values()
    )

    def build(inputs: ScenarioInputs, traffic: SolvedTraffic) -> Spec:
        inputs = replace(inputs, road=traffic.road)
        assets = _list_assets(library, inputs)
        return build_spec(library, inputs, groups[inputs.road.id], traffic, resolved, assets)

    solve = partial(_solve_traffic, library)
    settle = partial(settler.settle, solve=solve, build=build) if settler else solve
    solved = _solve_all(library, suite, by_traffic, settle)
    return [
        build(inputs, solved[inputs.traffic_key])
        for inputs in scenarios
        if inputs.traffic_key in solved
    ]


def _list_assets(library: Library, inputs: ScenarioInputs) -> dict[str, str]:
    """List the checksums of the foreign files of a scenario."""
    models = list_model_assets(library, inputs.catalogue, inputs.blueprints)
    if inputs.looks == "shaped":
        return models
    return models | {name: pack.digest for name, pack in TEXTURE_PACKS.items()}


def _solve_traffic(library: Library, suite: Suite, inputs: ScenarioInputs) -> SolvedTraffic:
    conflicts, road = solve_road_conflicts(
        library,
        suite,
        inputs.conflicts,
        inputs.density,
        inputs.blueprints,
        ego=find_ego_blueprint(suite, inputs),
        sample_key=inputs.sample_key,
    )
    return SolvedTraffic(suite, conflicts, road)


def _solve_all(
    library: Library,
    suite: Suite,
    scenarios: Mapping[TrafficKey, ScenarioInputs],
    solve: Callable[[Suite, ScenarioInputs], SolvedTraffic],
) -> dict[TrafficKey, SolvedTraffic]:
    """Solve the conflicts of scenarios by the key of their traffic, and time lights.

    Solving is slow and ignores the weather: it is done once per road, density, sweep step and
    repeat. A crossed conflict without a place is left out, with a warning.
    """
    solved: dict[TrafficKey, SolvedTraffic] = {}
    errors: list[Diagnostic] = []
    refusals: list[UnstageableError] = []
    for key, inputs in scenarios.items():
        try:
            solved[key] = solve(suite, inputs)
        except UnstageableError as refusal:
            if _may_be_left_out(library, inputs, refusal):
                refusals.append(refusal)
            else:
                errors.append(build_refusal_diagnostic(library, suite, refusal))
    if refusals and not solved:
        errors += (build_refusal_diagnostic(library, suite, refusal) for refusal in refusals)
    if errors:
        raise DiagnosticsError(*errors)
    for line in dict.fromkeys(map(str, refusals)):
        _logger.warning("%s", line)
    return solved


def _may_be_left_out(library: Library, inputs: ScenarioInputs, refusal: UnstageableError) -> bool:
    """Return whether a suite may go without a conflict on a road.

    A conflict of the author's own must fit the roads declared one by one.
    """
    is_variant = library.find_declared_id(inputs.road.id) != inputs.road.id
    may_not_fit = is_variant or library.is_shipped(refusal.conflict)
    return may_not_fit and inputs.conflicts.crossed is not None


def _build_scenarios(
    library: Library,
    suite: Suite,
    resolved: ResolvedSuite,
    groups: CrashGroups,
    *,
    require_sun: bool,
) -> list[ScenarioInputs]:
    """Build the inputs of every crossing, sweep step and repeat within the suite's `where`."""
    source = library.find_entry(suite).source
    conditions, steps = parse_conditions(suite, source), expand_sweeps(suite, source)
    repeats = range(1, suite.repeats + 1) if suite.repeats > 1 else (None,)
    places = select_conflicts(library, suite, resolved.roads, groups)
    factors = (places, resolved.weathers, resolved.densities, steps, repeats)
    _check_count(source, math.prod(map(len, factors)))
    crossings = product(places, resolved.weathers.values(), resolved.densities.values())
    common = (resolved.rig, resolved.catalogue, resolved.channel)
    build = partial(build_scenario_inputs, library, suite, require_sun=require_sun)
    scenarios = _run_checks(
        partial(build, (turns[turn], weather, density, *common), step, repeat)
        for turns, weather, density in crossings
        for step in steps
        for repeat in repeats
        for turn in (((repeat or 1) - 1) % len(turns),)
    )
    kept = [
        inputs
        for inputs in scenarios
        if all(condition.is_met(inputs.by_kind) for condition in conditions)
    ]
    if not kept:
        value_path = ("where",) if suite.where else ()
        hint = "widen `where`, or select more roads, weathers and densities"
        raise DiagnosticsError(
            source.build_diagnostic(value_path, "no scenario remains", hint=hint)
        )
    _check_ids(source, kept)
    return kept


def _check_count(source: ResolvedDeclaration, count: int) -> None:
    if count > MAX_SPECS:
        message = f"crosses to {count:,} scenarios; the limit is {MAX_SPECS:,}"
        hint = "select fewer roads, weathers or densities, or fewer steps or repeats"
        raise DiagnosticsError(source.build_diagnostic(("id",), message, hint=hint))


def _check_ids(source: ResolvedDeclaration, scenarios: Iterable[ScenarioInputs]) -> None:
    """Check that no two scenarios have one id: one file would be lost."""
    first: dict[str, ScenarioInputs] = {}
    problems: list[Diagnostic] = []
    for inputs in scenarios:
        other = first.setdefault(inputs.id, inputs)
        if other is not inputs:
            pairs = zip(other.origin.items(), inputs.origin.items(), strict=True)
            differing = [pair for pair in pairs if pair[0] != pair[1]]
            origins = (", ".join(map(" ".join, origin)) for origin in zip(*differing, strict=True))
            message = f"two scenarios have the id '{inputs.id}': of {' and of '.join(origins)}"
            problems.append(
                source.build_diagnostic(("id",), message, hint="rename one, or select one")
            )
    if problems:
        raise DiagnosticsError(*problems[:MAX_PROBLEMS])


def _assign_crash_groups(
    library: Library, suite: Suite, roads: Mapping[str, Road]
) -> dict[str, tuple[CrashGroup, ...]]:
    """Return the selected crash groups for each road.

    A suite of all roads must have a road of every required kind; each road of any suite must be
    required.
    """
    diagnostics: list[Diagnostic] = []
    groups: dict[str, list[CrashGroup]] = {name: [] for name in roads}
    for typology in library.get_declarations(Typology).values():
        if not is_selected(typology, suite.selection):
            continue
        crash_types = tuple(item.id for item in typology.crash_types)
        group = CrashGroup(typology=typology.id, crash_types=crash_types)
        for category in find_required_categories(typology, suite.coverage):
            matching = [road.id for road in roads.values() if category.matches(road)]
            if not matching and suite.roads == "all":
                message = f"'{typology.id}' requires a kind of road that is missing: {category}"
                diagnostics.append(library.build_diagnostic(suite, "roads", message=message))
            for name in matching:
                if group not in groups[name]:
                    groups[name].append(group)
    # Recorded traffic stages no conflict on any road.
    simulated = {name for name, road in roads.items() if road.trajectories is None}
    for name in (name for name, assigned in groups.items() if name in simulated and not assigned):
        message = "no selected typology requires this kind of road"
        hint = "remove the road from the suite, or change the suite's selection or coverage"
        diagnostics.append(library.build_diagnostic(roads[name], "id", message=message, hint=hint))
    if diagnostics:
        raise DiagnosticsError(*diagnostics)
    return {name: tuple(assigned) for name, assigned in groups.items()}
