"""Crosses a suite's roads, weathers and densities into specs."""

import hashlib
from collections.abc import Mapping
from typing import Any, TypeVar

from advercity_dsl import (
    Agent,
    Blueprint,
    Carrier,
    Catalogue,
    Declaration,
    Density,
    Rig,
    Road,
    RoadsideUnit,
    Spec,
    Suite,
    Typology,
    Weather,
    kind_of,
)
from advercity_dsl.spec import ClassDemand, CrashGroup, Provenance, SpecSeeds

from advercity import __version__
from advercity.compiler.library import Library, digest_of
from advercity.compiler.problems import Problem, ProblemsError, nearest
from advercity.compiler.selection import is_selected, required_cells

DeclarationT = TypeVar("DeclarationT", bound=Declaration)
SPAWN_AREAS = 8
"""A square around each of five agents and a box along each of three paths."""


def cross(library: Library, suite: Suite) -> list[Spec]:
    """Every scenario of a suite, in the order of roads, weathers and densities.

    Raises:
        ProblemsError: A reference leads nowhere, a required place has no road, or a road has
            no required place.
    """
    problems: list[Problem] = []
    roads = _chosen(library, suite, "roads", Road, problems)
    weathers = _chosen(library, suite, "weathers", Weather, problems)
    densities = _chosen(library, suite, "densities", Density, problems)
    rig = _one(library, suite, "rig", Rig, problems)
    catalogue = _one(library, suite, "catalogue", Catalogue, problems)
    groups = _groups(library, suite, roads, problems)
    if problems or rig is None or catalogue is None:
        raise ProblemsError(problems)
    _check_catalogue(library, catalogue)
    _check_beams(library, rig, roads)
    _check_egos(library, roads)
    return [
        _spec(library, suite, road, weather, density, rig, catalogue, groups[road.id])
        for road in roads.values()
        for weather in weathers.values()
        for density in densities.values()
    ]


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
    message = f"there is no '{name}' among the library's {what}"
    return library.problem(suite, *where, message=message, hint=nearest(name, there))


def _groups(
    library: Library, suite: Suite, roads: Mapping[str, Road], problems: list[Problem]
) -> dict[str, tuple[CrashGroup, ...]]:
    """The selected typologies that each road is here for; every place and road accounted for."""
    groups: dict[str, list[CrashGroup]] = {name: [] for name in roads}
    for typology in library.of(Typology).values():
        if not is_selected(typology, suite.selection):
            continue
        group = CrashGroup(
            typology=typology.id, crash_types=tuple(item.id for item in typology.crash_types)
        )
        for cell in required_cells(typology, suite.coverage):
            fitting = [road for road in roads.values() if cell.holds(road)]
            if not fitting:
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


def _check_catalogue(library: Library, catalogue: Catalogue) -> None:
    if catalogue.ego not in catalogue.blueprints:
        message = f"there is no blueprint '{catalogue.ego}'"
        hint = nearest(catalogue.ego, catalogue.blueprints)
        raise ProblemsError.of(library.problem(catalogue, "ego", message=message, hint=hint))


def _spec(
    library: Library,
    suite: Suite,
    road: Road,
    weather: Weather,
    density: Density,
    rig: Rig,
    catalogue: Catalogue,
    groups: tuple[CrashGroup, ...],
) -> Spec:
    name = f"{road.id}_{weather.id}_{density.id}"
    sources = (suite, road, weather, density, rig, catalogue)
    spec = Spec(
        id=name,
        groups=groups,
        road=road,
        weather=weather_at(weather, road),
        density=density,
        agents=_agents(road, rig, catalogue),
        demand=_demand(road, density),
        blueprints=_blueprints(road, catalogue),
        timing=suite.timing,
        seeds=SpecSeeds(
            traffic=_seed(suite.seeds.traffic, "traffic", road.id, density.id),
            sensors=suite.seeds.sensors,
        ),
        provenance=Provenance(
            compiler=__version__,
            suite=suite.id,
            declarations=dict(
                sorted((f"{kind_of(item)}/{item.id}", library.digest(item)) for item in sources)
            ),
            digest="0" * 64,
        ),
    )
    return sealed(spec)


def sealed(spec: Spec) -> Spec:
    """The spec with its own digest filled in."""
    data = spec.model_dump(mode="json")
    del data["provenance"]["digest"]
    provenance = spec.provenance.model_copy(update={"digest": digest_of(data)})
    return spec.model_copy(update={"provenance": provenance})


def under(spec: Spec, weather: Weather) -> Spec:
    """The same scenario under another weather: what the suite would have compiled to."""
    sources = {
        name: digest
        for name, digest in spec.provenance.declarations.items()
        if not name.startswith("weather/")
    }
    sources[f"weather/{weather.id}"] = digest_of(weather.model_dump(mode="json"))
    provenance = spec.provenance.model_copy(update={"declarations": dict(sorted(sources.items()))})
    return sealed(
        spec.model_copy(
            update={
                "id": f"{spec.road.id}_{weather.id}_{spec.density.id}",
                "weather": weather_at(weather, spec.road),
                "provenance": provenance,
            }
        )
    )


def weather_at(weather: Weather, road: Road) -> Weather:
    """The weather as it is at a road: its own sun in place of `sun_at`."""
    sun = weather.sun_at.get(road.id, weather.sun)
    return weather.model_copy(update={"sun": sun, "sun_at": {}})


def _agents(road: Road, rig: Rig, catalogue: Catalogue) -> tuple[Agent, ...]:
    agents: list[Agent] = []
    units = 0
    for name, place in road.agents.items():
        if isinstance(place, RoadsideUnit):
            units += 1
            sensors = _unit_sensors(rig.roadside_unit, place)
            agents.append(Agent(id=name, number=-units, place=place, sensors=sensors))
        else:
            number = 101 + len(agents) - units
            agents.append(
                Agent(
                    id=name,
                    number=number,
                    place=place,
                    sensors=rig.vehicle,
                    blueprint=catalogue.ego,
                )
            )
    return tuple(agents)


def _unit_sensors(carrier: Carrier, unit: RoadsideUnit) -> Carrier:
    if unit.lidar_upper_deg is None:
        return carrier
    lidar = carrier.lidar.model_copy(update={"upper_deg": unit.lidar_upper_deg})
    return carrier.model_copy(update={"lidar": lidar})


def _demand(road: Road, density: Density) -> ClassDemand:
    asked = road.traffic
    return ClassDemand(
        vehicles=SPAWN_AREAS * round(asked.vehicles_per_area * density.vehicles),
        walkers=round(asked.walkers * density.walkers),
        crossing_share=asked.crossing_share,
        classes=asked.classes,
        around_agent_m=asked.around_agent_m,
        around_path_m=asked.around_path_m,
        speed_offset_percent=asked.speed_offset_percent,
    )


def _blueprints(road: Road, catalogue: Catalogue) -> dict[str, Blueprint]:
    return {
        name: blueprint
        for name, blueprint in catalogue.blueprints.items()
        if blueprint.land_use in ("any", road.land_use)
    }


def _seed(base: int, *purpose: str) -> int:
    digest = hashlib.blake2b("/".join((str(base), *purpose)).encode(), digest_size=4).digest()
    return int.from_bytes(digest, "little")
