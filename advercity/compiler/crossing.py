"""Crosses a suite's roads, weathers and densities into specs."""

from collections.abc import Mapping
from itertools import product

from advercity_dsl import Road, Spec, Suite, Typology
from advercity_dsl.spec import CrashGroup

from advercity.compiler.assembly import assembled
from advercity.compiler.chosen import Chosen, check, chosen
from advercity.compiler.conflicts import Groups, cells, staged
from advercity.compiler.library import Library
from advercity.compiler.problems import Problem, ProblemsError
from advercity.compiler.scenes import Scene, scene
from advercity.compiler.selection import is_selected, required_cells
from advercity.compiler.variation import conditions, steps


def cross(library: Library, suite: Suite, *, solved: bool = True) -> list[Spec]:
    """Every scenario of a suite, in the order of roads, weathers, densities and its sweep.

    Args:
        library: Where everything is.
        suite: What to cross.
        solved: Whether suns in somebody's view must have been found; else suns stand anywhere.

    Raises:
        ProblemsError: A reference leads nowhere, a required place has no road, a road has no
            required place, a sun in somebody's view is not found yet, or no scenario is left.
    """
    found = chosen(library, suite)
    groups = _groups(library, suite, found.roads)
    check(library, found)
    scenes = _scenes(library, suite, found, groups, solved=solved)
    conflicts = {
        key: staged(library, suite, made.cell, made.density, made.blueprints)
        for key, made in {made.traffic_key: made for made in scenes}.items()
    }
    return [
        assembled(
            library,
            suite,
            made,
            groups[made.road.id],
            conflicts[made.traffic_key],
            found.drivers,
        )
        for made in scenes
    ]


def _scenes(
    library: Library, suite: Suite, found: Chosen, groups: Groups, *, solved: bool
) -> list[Scene]:
    """Every crossing under every step, as far as the suite's conditions hold."""
    source = library.entry(suite).source
    asked, taken = conditions(suite, source), steps(suite, source)
    crossed = product(
        cells(library, suite, found.roads, groups),
        found.weathers.values(),
        found.densities.values(),
        [found.rig],
        [found.catalogue],
    )
    made = (
        scene(library, suite, parts, step, solved=solved) for parts in crossed for step in taken
    )
    kept = [one for one in made if all(condition.holds(one.by_kind) for condition in asked)]
    if not kept:
        where = ("where",) if suite.where else ()
        hint = "widen `where`, or choose more roads, weathers and densities"
        raise ProblemsError.of(source.problem(where, "no scenario is left", hint=hint))
    return kept


def _groups(
    library: Library, suite: Suite, roads: Mapping[str, Road]
) -> dict[str, tuple[CrashGroup, ...]]:
    """The selected typologies that each road is here for.

    A suite of all roads has one for every place called for, and every road is called for.
    """
    problems: list[Problem] = []
    groups: dict[str, list[CrashGroup]] = {name: [] for name in roads}
    for typology in library.of(Typology).values():
        if not is_selected(typology, suite.selection):
            continue
        group = CrashGroup(
            typology=typology.id, crash_types=tuple(item.id for item in typology.crash_types)
        )
        for cell in required_cells(typology, suite.coverage):
            fitting = [road for road in roads.values() if cell.holds(road)]
            if not fitting and suite.roads == "all":
                message = f"'{typology.id}' calls for a place that no road is: {cell}"
                problems.append(library.problem(suite, "roads", message=message))
            for road in fitting:
                if group not in groups[road.id]:
                    groups[road.id].append(group)
    for name, found in groups.items():
        if not found:
            message = "no selected typology calls for such a place"
            hint = "leave the road out of the suite, or change the suite's selection or coverage"
            problems.append(library.problem(roads[name], "id", message=message, hint=hint))
    if problems:
        raise ProblemsError(problems)
    return {name: tuple(found) for name, found in groups.items()}
