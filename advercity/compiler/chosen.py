"""The declarations that a suite names, found in its library and checked against each other."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

from advercity_dsl import (
    Catalogue,
    Declaration,
    Density,
    Drivers,
    Rig,
    Road,
    RoadsideUnit,
    Suite,
    Weather,
)

from advercity.compiler.library import Library
from advercity.compiler.places import misplaced
from advercity.compiler.problems import Problem, ProblemsError, nearest

DeclarationT = TypeVar("DeclarationT", bound=Declaration)
KINDS_OF = {
    "roads": "road",
    "weathers": "weather",
    "densities": "density",
    "drivers": "declaration of drivers",
}
"""What a suite's field holds ids of, where it is not called so itself."""


@dataclass(frozen=True)
class Chosen:
    """What a suite crosses, by id, and what all its scenarios share."""

    roads: Mapping[str, Road]
    weathers: Mapping[str, Weather]
    densities: Mapping[str, Density]
    rig: Rig
    catalogue: Catalogue
    drivers: Drivers | None


def chosen(library: Library, suite: Suite) -> Chosen:
    """What a suite names.

    Raises:
        ProblemsError: A name leads nowhere.
    """
    problems: list[Problem] = []
    roads = _several(library, suite, "roads", Road, problems)
    weathers = _several(library, suite, "weathers", Weather, problems)
    densities = _several(library, suite, "densities", Density, problems)
    rig = _one(library, suite, "rig", Rig, problems)
    catalogue = _one(library, suite, "catalogue", Catalogue, problems)
    drivers = _one(library, suite, "drivers", Drivers, problems) if suite.drivers else None
    if problems or rig is None or catalogue is None:
        raise ProblemsError(problems)
    return Chosen(roads, weathers, densities, rig, catalogue, drivers)


def check(library: Library, found: Chosen) -> None:
    """See that what was chosen goes together.

    Raises:
        ProblemsError: The ego's blueprint is missing, a roadside unit's beams do not open upwards,
            a road has not one ego, or an agent stands off its road's map.
    """
    _check_catalogue(library, found.catalogue)
    _check_beams(library, found.rig, found.roads)
    _check_egos(library, found.roads)
    _check_places(library, found.roads)


def _several(
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
