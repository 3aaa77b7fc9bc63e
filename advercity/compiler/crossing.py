"""Crosses a suite's roads, weathers and densities into specs."""

from collections.abc import Mapping
from itertools import product
from typing import Any, TypeVar

from advercity_dsl import (
    Catalogue,
    Declaration,
    Density,
    Drivers,
    Rig,
    Road,
    RoadsideUnit,
    Spec,
    Suite,
    Typology,
    Weather,
)
from advercity_dsl.spec import CrashGroup

from advercity.compiler.assembly import assembled
from advercity.compiler.conflicts import cells, staged
from advercity.compiler.library import Library
from advercity.compiler.places import misplaced
from advercity.compiler.problems import Problem, ProblemsError, nearest
from advercity.compiler.scenes import scene
from advercity.compiler.selection import is_selected, required_cells
from advercity.compiler.variation import conditions, steps

DeclarationT = TypeVar("DeclarationT", bound=Declaration)
KINDS_OF = {
    "roads": "road",
    "weathers": "weather",
    "densities": "density",
    "drivers": "declaration of drivers",
}
"""What a suite's field holds ids of, where it is not called so itself."""


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
    problems: list[Problem] = []
    roads = _chosen(library, suite, "roads", Road, problems)
    weathers = _chosen(library, suite, "weathers", Weather, problems)
    densities = _chosen(library, suite, "densities", Density, problems)
    rig = _one(library, suite, "rig", Rig, problems)
    catalogue = _one(library, suite, "catalogue", Catalogue, problems)
    drivers = _one(library, suite, "drivers", Drivers, problems) if suite.drivers else None
    if problems or rig is None or catalogue is None:
        raise ProblemsError(problems)
    groups = _groups(library, suite, roads, problems)
    if problems:
        raise ProblemsError(problems)
    _check_catalogue(library, catalogue)
    _check_beams(library, rig, roads)
    _check_egos(library, roads)
    _check_places(library, roads)
    source = library.entry(suite).source
    asked, taken = conditions(suite, source), steps(suite, source)
    scenes = (
        scene(library, suite, parts, step, solved=solved)
        for parts in product(
            cells(library, suite, roads, groups),
            weathers.values(),
            densities.values(),
            [rig],
            [catalogue],
        )
        for step in taken
    )
    kept = [made for made in scenes if all(condition.holds(made.by_kind) for condition in asked)]
    conflicts = {
        key: staged(library, suite, made.cell, made.density, made.blueprints)
        for key, made in {made.traffic_key: made for made in kept}.items()
    }
    specs = [
        assembled(library, suite, made, groups[made.road.id], conflicts[made.traffic_key], drivers)
        for made in kept
    ]
    if not specs:
        where = ("where",) if suite.where else ()
        message = "no scenario is left"
        hint = "widen `where`, or choose more roads, weathers and densities"
        raise ProblemsError.of(source.problem(where, message, hint=hint))
    return specs


def _chosen(
    library: Library,
    suite: Suite,
    field: str,
    kind: type[DeclarationT],
    problems: list[Problem],
) -> dict[str, DeclarationT]:
    there = library.of(kind)
    wanted = getattr(suite, field)
    if wanted == "all":
        return there
    for index, name in enumerate(wanted):
        if name not in there:
            problems.append(_dangling(library, suite, (field, index), field, name, there))
    return {name: there[name] for name in wanted if name in there}


def _one(
    library: Library,
    suite: Suite,
    field: str,
    kind: type[DeclarationT],
    problems: list[Problem],
) -> DeclarationT | None:
    there = library.of(kind)
    name = getattr(suite, field)
    if name not in there:
        problems.append(_dangling(library, suite, (field,), field, name, there))
    return there.get(name)


def _dangling(
    library: Library,
    suite: Suite,
    where: tuple[str | int, ...],
    what: str,
    name: str,
    there: Mapping[str, Any],
) -> Problem:
    kind = KINDS_OF.get(what, what)
    message = f"there is no {kind} '{name}' in this library"
    return library.problem(suite, *where, message=message, hint=nearest(name, there))


def _groups(
    library: Library, suite: Suite, roads: Mapping[str, Road], problems: list[Problem]
) -> dict[str, tuple[CrashGroup, ...]]:
    """The selected typologies that each road is here for.

    A suite of all roads has one for every place called for, and every road is called for.
    """
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
    return {name: tuple(found) for name, found in groups.items()}


def _check_beams(library: Library, rig: Rig, roads: Mapping[str, Road]) -> None:
    lowest = rig.roadside_unit.lidar.lower_deg
    problems = [
        library.problem(
            road,
            *("agents", name, "lidar_upper_deg"),
            message=f"{place.lidar_upper_deg:g} is not above the rig's lower_deg {lowest:g}",
        )
        for road in roads.values()
        for name, place in road.agents.items()
        if isinstance(place, RoadsideUnit)
        and place.lidar_upper_deg is not None
        and place.lidar_upper_deg <= lowest
    ]
    if problems:
        raise ProblemsError(problems)


def _check_egos(library: Library, roads: Mapping[str, Road]) -> None:
    problems: list[Problem] = []
    for road in roads.values():
        egos = sum(getattr(place, "role", "") == "ego" for place in road.agents.values())
        if egos != 1:
            message = f"{egos} of the agents have the role 'ego'; one vehicle has it"
            problems.append(library.problem(road, "agents", message=message))
    if problems:
        raise ProblemsError(problems)


def _check_places(library: Library, roads: Mapping[str, Road]) -> None:
    problems = [
        library.problem(
            road, *where, message=message, hint="is it the right map? correct the place"
        )
        for road in roads.values()
        for where, message in misplaced(road)
    ]
    if problems:
        raise ProblemsError(problems)


def _check_catalogue(library: Library, catalogue: Catalogue) -> None:
    if catalogue.ego not in catalogue.blueprints:
        message = f"there is no blueprint '{catalogue.ego}'"
        hint = nearest(catalogue.ego, catalogue.blueprints)
        raise ProblemsError.of(library.problem(catalogue, "ego", message=message, hint=hint))
