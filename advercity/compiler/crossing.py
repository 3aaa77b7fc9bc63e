"""Crosses a suite's roads, weathers and densities into specs."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import product
from typing import Any, TypeVar

from advercity_dsl import (
    Agent,
    Blueprint,
    Carrier,
    Catalogue,
    Declaration,
    Density,
    Drivers,
    Model,
    Rig,
    Road,
    RoadsideUnit,
    Spec,
    Suite,
    Typology,
    Weather,
    kind_of,
)
from advercity_dsl.distribution import Distribution
from advercity_dsl.spec import ClassDemand, CrashGroup, Provenance, SpecSeeds, Swept
from advercity_dsl.weather import Sun

from advercity import __version__
from advercity.compiler.caution import caution
from advercity.compiler.conflicts import Cell, cells, staged
from advercity.compiler.distributions import Distributions, draw
from advercity.compiler.library import Entry, Library, digest_of
from advercity.compiler.places import misplaced
from advercity.compiler.problems import Problem, ProblemsError, nearest
from advercity.compiler.selection import is_selected, required_cells
from advercity.compiler.source import dotted
from advercity.compiler.validation import validate
from advercity.compiler.variation import Step, conditions, steps

DeclarationT = TypeVar("DeclarationT", bound=Declaration)
MAX_ID = 64
KINDS_OF = {
    "roads": "road",
    "weathers": "weather",
    "densities": "density",
    "drivers": "declaration of drivers",
}
"""What a suite's field holds ids of, where it is not called so itself."""
SPAWN_AREAS = 8
"""A square around each of five agents and a box along each of three paths."""


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
        _scene(library, suite, parts, step, solved=solved)
        for parts in product(
            cells(library, suite, roads, groups),
            weathers.values(),
            densities.values(),
            [rig],
            [catalogue],
        )
        for step in taken
    )
    specs = [
        _spec(library, suite, scene, groups[scene.road.id], drivers)
        for scene in scenes
        if all(condition.holds(scene.by_kind) for condition in asked)
    ]
    if not specs:
        where = ("where",) if suite.where else ()
        message = "no scenario is left"
        hint = "widen `where`, or choose more roads, weathers and densities"
        raise ProblemsError.of(source.problem(where, message, hint=hint))
    return specs


@dataclass(frozen=True)
class _Scene:
    """What one scenario is made of, its weather drawn and its step of the sweep taken."""

    id: str
    road: Road
    weather: Weather
    density: Density
    rig: Rig
    catalogue: Catalogue
    draws: Distributions
    step: Step | None
    cell: Cell

    @property
    def by_kind(self) -> dict[str, Model]:
        return {
            "road": self.road,
            "weather": self.weather,
            "density": self.density,
            "rig": self.rig,
            "catalogue": self.catalogue,
        }


Parts = tuple[Cell, Weather, Density, Rig, Catalogue]


def _scene(
    library: Library, suite: Suite, parts: Parts, step: Step | None, *, solved: bool
) -> _Scene:
    cell, weather, density, rig, catalogue = parts
    road, crossed = cell.road, cell.crossed.id if cell.crossed else None
    name = _name(library, suite, road, weather, density, step, crossed)
    try:
        drawn, draws = weather_of(library.entry(weather), suite.seeds.weather, name, step)
        road = _stepped(library, road, step)
        density = _stepped(library, density, step)
        rig, catalogue = _stepped(library, rig, step), _stepped(library, catalogue, step)
    except ProblemsError as error:
        if step is None:
            raise
        raise ProblemsError.of(_bad_step(library, suite, step, error.problems[0])) from None
    drawn = weather_at(library.entry(weather), drawn, road, solved=solved)
    return _Scene(name, road, drawn, density, rig, catalogue, draws, step, cell)


def weather_of(
    entry: Entry[Weather], seed: int, spec_id: str, step: Step | None
) -> tuple[Weather, Distributions]:
    """The weather of one spec, and what its numbers were drawn from."""
    if step is None or step.kind != "weather":
        if not entry.distributions:
            return entry.declaration, {}
        return draw(entry.source, entry.distributions, seed, spec_id), entry.distributions
    source = entry.source.with_value(step.where, step.value)
    left = {where: item for where, item in entry.distributions.items() if where != step.where}
    return draw(source, left, seed, spec_id), left


def _stepped(library: Library, item: DeclarationT, step: Step | None) -> DeclarationT:
    if step is None or step.kind != kind_of(item):
        return item
    source = library.entry(item).source.with_value(step.where, step.value)
    stepped = validate(type(item), source)
    if isinstance(item, Road):
        kept = {"imported": item.imported, "agents": item.agents, "ego_routes": item.ego_routes}
        return stepped.model_copy(update=kept)
    return stepped


def _bad_step(library: Library, suite: Suite, step: Step, found: Problem) -> Problem:
    source = library.entry(suite).source
    message = f"{step.field} of {step.value:g} does not fit: {found.message}"
    return source.problem(("sweep",), message, hint=found.hint)


def _name(
    library: Library,
    suite: Suite,
    road: Road,
    weather: Weather,
    density: Density,
    step: Step | None,
    crossed: str | None,
) -> str:
    name = spec_id(road, weather, density, step, crossed)
    if len(name) > MAX_ID:
        message = f"makes the id '{name}', which is longer than {MAX_ID} characters"
        hint = "shorten the ids that it is made of"
        raise ProblemsError.of(library.problem(suite, "id", message=message, hint=hint))
    return name


def spec_id(
    road: Road, weather: Weather, density: Density, step: Step | None, crossed: str | None
) -> str:
    """`<road>_<weather>_<density>`, a crossed conflict after the road, a sweep's step last."""
    middle = [crossed] if crossed else []
    parts = (road.id, *middle, weather.id, density.id, *([step.suffix] if step else []))
    return "_".join(parts)


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


def _spec(
    library: Library,
    suite: Suite,
    scene: _Scene,
    groups: tuple[CrashGroup, ...],
    drivers: Drivers | None,
) -> Spec:
    road, density = scene.road, scene.density
    parts = (suite, road, scene.weather, density, scene.rig, scene.catalogue)
    parts += (*scene.cell.conflicts, *([drivers] if drivers else []))
    digests = {f"{kind_of(item)}/{item.id}": library.entry(item).digest for item in parts}
    blueprints = _blueprints(road, scene.catalogue)
    spec = Spec(
        id=scene.id,
        groups=groups,
        road=road,
        weather=scene.weather,
        density=density,
        agents=_agents(road, scene.rig, scene.catalogue),
        demand=_demand(road, density),
        conflicts=staged(library, suite, replace(scene.cell, road=road), density, blueprints),
        drivers=drivers,
        caution=caution(drivers, scene.weather) if drivers else None,
        blueprints=blueprints,
        timing=suite.timing,
        seeds=SpecSeeds(
            traffic=_seed(suite.seeds.traffic, "traffic", road.id, density.id),
            sensors=suite.seeds.sensors,
            weather=suite.seeds.weather,
        ),
        provenance=Provenance(
            compiler=__version__,
            suite=suite.id,
            declarations=dict(sorted(digests.items())),
            draws=_recorded(scene.draws),
            conflict=scene.cell.crossed.id if scene.cell.crossed else None,
            sweep=Swept(field=scene.step.field, value=scene.step.value) if scene.step else None,
            digest="0" * 64,
        ),
    )
    return sealed(spec)


def _recorded(draws: Distributions) -> dict[str, Distribution]:
    return {f"weather.{dotted(where)}": item for where, item in draws.items()}


def sealed(spec: Spec) -> Spec:
    """The spec with its own digest filled in."""
    data = spec.model_dump(mode="json")
    del data["provenance"]["digest"]
    provenance = spec.provenance.model_copy(update={"digest": digest_of(data)})
    return spec.model_copy(update={"provenance": provenance})


def under(spec: Spec, entry: Entry[Weather]) -> Spec:
    """The same scenario under another weather: what the suite would have compiled to."""
    sources = {
        name: digest
        for name, digest in spec.provenance.declarations.items()
        if not name.startswith("weather/")
    }
    sources[f"weather/{entry.declaration.id}"] = entry.digest
    swept = spec.provenance.sweep
    step = Step(swept.field, swept.value) if swept else None
    crossed = spec.provenance.conflict
    name = spec_id(spec.road, entry.declaration, spec.density, step, crossed)
    weather, draws = weather_of(entry, spec.seeds.weather, name, step)
    provenance = spec.provenance.model_copy(
        update={"declarations": dict(sorted(sources.items())), "draws": _recorded(draws)}
    )
    return sealed(
        spec.model_copy(
            update={
                "id": name,
                "weather": weather_at(entry, weather, spec.road),
                "caution": caution(spec.drivers, weather) if spec.drivers else None,
                "provenance": provenance,
            }
        )
    )


def weather_at(
    entry: Entry[Weather], weather: Weather, road: Road, *, solved: bool = True
) -> Weather:
    """The weather as it is at a road: its own sun in place of `sun_at`.

    Raises:
        ProblemsError: The sun is to be in somebody's view, and is not found yet.
    """
    sun = weather.sun_at.get(road.id, weather.sun)
    if sun.in_view_of is not None and solved:
        where = ("sun", "in_view_of") if sun is weather.sun else ("sun_at", road.id, "in_view_of")
        message = f"where the sun is in view of the ego at road '{road.id}' is not known yet"
        hint = "`advercity solve LIBRARY` finds it, and writes it to sun_at"
        raise ProblemsError.of(entry.source.problem(where, message, hint=hint))
    if sun.in_view_of is not None:
        sun = Sun()
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
