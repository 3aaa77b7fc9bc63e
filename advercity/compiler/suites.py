"""Which crash types a suite is about, and what roads they call for.

Whether agents stand on the map that their road is made of.

The declarations that a suite names, found in its library and checked against each other.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
import shapely
from advercity_dsl import (
    Catalogue,
    Declaration,
    Density,
    Drivers,
    MapNetwork,
    Rig,
    Road,
    RoadsideUnit,
    Suite,
    Typology,
    Vehicle,
    Weather,
)
from advercity_dsl.base import suggest_name
from advercity_dsl.road import StripKind
from advercity_dsl.suite import Coverage, Selection
from advercity_dsl.units import Point2

from advercity.compiler.diagnostics import Diagnostic, DiagnosticsError
from advercity.compiler.library import Library
from advercity.compiler.source import ValuePath
from advercity.roads.map_import import is_car_lane
from advercity.roads.routes import RoutePlanner
from advercity.roads.sumo_xml import unpack_network


def has_collision_partner(typology: Typology, rule: Selection) -> bool:
    """Whether there is somebody or something that the driver can misperceive."""
    figures = typology.statistics
    return figures is not None and (
        figures.external_entity or figures.vehicles_per_crash >= rule.vehicles_per_crash
    )


def is_selected(typology: Typology, rule: Selection) -> bool:
    """Whether the crashes are deadly perception errors in which visibility plays a part."""
    figures = typology.statistics
    return (
        figures is not None
        and has_collision_partner(typology, rule)
        and figures.fatality_rate_percent >= rule.fatality_rate_percent
        and figures.bad_visibility_percent >= rule.bad_visibility_percent
    )


@dataclass(frozen=True)
class RoadCategory:
    """A kind of place that a typology's crashes happen at; None stands for any."""

    land_use: str
    junction: str
    geometry: str | None = None

    def matches(self, road: Road) -> bool:
        """Whether `road` is such a place."""
        straight = road.alignment == "straight" and road.profile == "level"
        geometry = "straight" if straight else "curved"
        return (
            self.land_use == road.land_use
            and self.junction == road.junction
            and self.geometry in (None, geometry)
        )

    def __str__(self) -> str:
        """`rural non_junction curved`."""
        return " ".join(part for part in (self.land_use, self.junction, self.geometry) if part)


def find_required_categories(typology: Typology, rule: Coverage) -> tuple[RoadCategory, ...]:
    """Every place that a typology's road facts call for: the product of its large shares."""
    facts = typology.roads
    if facts is None:
        return ()
    shares = {"urban": facts.urban_percent, "rural": facts.rural_percent}
    land_uses = [use for use, share in shares.items() if share >= rule.land_use_percent]
    junctions = list(
        dict.fromkeys(
            item.junction for item in facts.junctions if item.percent >= rule.junction_percent
        )
    )
    bent = max(facts.non_level_percent or 0, facts.curved_percent or 0)
    geometries = ("straight", "curved") if bent >= rule.geometry_percent else (None,)
    return tuple(
        RoadCategory(land_use, junction, geometry)
        for land_use in land_uses
        for junction in junctions
        for geometry in geometries
    )


MAX_SPAWN_DISTANCE_M = 3.5
"""A vehicle starts no farther from the middle of a lane than a lane is wide."""
MAX_DESTINATION_DISTANCE_M = 10.0
"""Nearer to the end of a way than this counts as reached."""
MAX_ROADSIDE_DISTANCE_M = 100.0
"""Farther from any lane a roadside unit sees no traffic."""

AgentMisplacement = tuple[ValuePath, str]
"""Path of a place in the road's declaration, and what is wrong with it."""


def find_misplaced_agents(road: Road) -> Iterator[AgentMisplacement]:
    """Places of agents that lie off the road's map.

    Maps of one town have often gone with places of another; what stands off every lane tells.
    """
    lanes = shapely.MultiLineString(list(_iterate_lane_centre_lines(road)))
    for name, agent in road.agents.items():
        if isinstance(agent, Vehicle):
            yield from _check_lane_distance(
                lanes, name, "spawn_m", agent.spawn_m, MAX_SPAWN_DISTANCE_M
            )
            yield from _check_lane_distance(
                lanes, name, "destination_m", agent.destination_m, MAX_DESTINATION_DISTANCE_M
            )
        else:
            yield from _check_lane_distance(
                lanes, name, "position_m", agent.position_m[:2], MAX_ROADSIDE_DISTANCE_M
            )


def _check_lane_distance(
    lanes: shapely.MultiLineString, agent: str, field: str, place: Point2, most_m: float
) -> Iterator[AgentMisplacement]:
    away = shapely.distance(lanes, shapely.Point(place))
    if away > most_m:
        east, north = place
        yield (
            ("agents", agent, field),
            f"{east:g}, {north:g} is {away:.0f} m from the nearest lane of this map;"
            f" it may be {most_m:g} m away",
        )


def _iterate_lane_centre_lines(road: Road) -> Iterator[shapely.LineString]:
    """Middles of lanes for vehicles; of streets as declared, or of an imported map."""
    if isinstance(road.imported, MapNetwork):
        for lane in unpack_network(road.imported.network).iter("lane"):
            if is_car_lane(lane):
                points = [word.split(",")[:2] for word in lane.get("shape", "").split()]
                yield shapely.LineString(np.array(points, dtype=float))
        return
    for street in RoutePlanner(road).streets.values():
        for along in (True, False):
            for band in street.strips_in_direction(along=along):
                if band.kind is StripKind.LANE:
                    yield shapely.LineString(street.offset_line(band.centre_t)[:, :2])


DeclarationT = TypeVar("DeclarationT", bound=Declaration)
KIND_LABELS = {
    "roads": "road",
    "weathers": "weather",
    "densities": "density",
    "drivers": "declaration of drivers",
}
"""What a suite's field holds ids of, where it is not called so itself."""


@dataclass(frozen=True)
class ResolvedSuite:
    """What a suite crosses, by id, and what all its scenarios share."""

    roads: Mapping[str, Road]
    weathers: Mapping[str, Weather]
    densities: Mapping[str, Density]
    rig: Rig
    catalogue: Catalogue
    drivers: Drivers | None


def resolve_suite(library: Library, suite: Suite) -> ResolvedSuite:
    """What a suite names.

    Raises:
        ProblemsError: A name leads nowhere.
    """
    problems: list[Diagnostic] = []
    roads = _find_declarations(library, suite, "roads", Road, problems)
    weathers = _find_declarations(library, suite, "weathers", Weather, problems)
    densities = _find_declarations(library, suite, "densities", Density, problems)
    rig = _find_declaration(library, suite, "rig", Rig, problems)
    catalogue = _find_declaration(library, suite, "catalogue", Catalogue, problems)
    drivers = (
        _find_declaration(library, suite, "drivers", Drivers, problems) if suite.drivers else None
    )
    if problems or rig is None or catalogue is None:
        raise DiagnosticsError(problems)
    return ResolvedSuite(roads, weathers, densities, rig, catalogue, drivers)


def check_resolved_suite(library: Library, found: ResolvedSuite) -> None:
    """See that what was chosen goes together.

    Raises:
        ProblemsError: The ego's blueprint is missing, a roadside unit's beams do not open upwards,
            a road has not one ego, or an agent stands off its road's map.
    """
    _check_catalogue(library, found.catalogue)
    _check_beams(library, found.rig, found.roads)
    _check_egos(library, found.roads)
    _check_agent_positions(library, found.roads)


def _find_declarations(
    library: Library,
    suite: Suite,
    field: str,
    kind: type[DeclarationT],
    problems: list[Diagnostic],
) -> dict[str, DeclarationT]:
    there = library.get_declarations(kind)
    wanted = getattr(suite, field)
    if wanted == "all":
        return there
    for index, name in enumerate(wanted):
        if name not in there:
            problems.append(
                _build_reference_diagnostic(library, suite, (field, index), field, name, there)
            )
    return {name: there[name] for name in wanted if name in there}


def _find_declaration(
    library: Library,
    suite: Suite,
    field: str,
    kind: type[DeclarationT],
    problems: list[Diagnostic],
) -> DeclarationT | None:
    there = library.get_declarations(kind)
    name = getattr(suite, field)
    if name not in there:
        problems.append(_build_reference_diagnostic(library, suite, (field,), field, name, there))
    return there.get(name)


def _build_reference_diagnostic(
    library: Library,
    suite: Suite,
    where: tuple[str | int, ...],
    what: str,
    name: str,
    there: Mapping[str, Any],
) -> Diagnostic:
    kind = KIND_LABELS.get(what, what)
    message = f"there is no {kind} '{name}' in this library"
    return library.build_diagnostic(suite, *where, message=message, hint=suggest_name(name, there))


def _check_beams(library: Library, rig: Rig, roads: Mapping[str, Road]) -> None:
    lowest = rig.roadside_unit.lidar.lower_deg
    problems = [
        library.build_diagnostic(
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
        raise DiagnosticsError(problems)


def _check_egos(library: Library, roads: Mapping[str, Road]) -> None:
    problems: list[Diagnostic] = []
    for road in roads.values():
        egos = sum(place.is_ego for place in road.agents.values())
        if egos != 1:
            message = f"{egos} of the agents have the role 'ego'; one vehicle has it"
            problems.append(library.build_diagnostic(road, "agents", message=message))
    if problems:
        raise DiagnosticsError(problems)


def _check_agent_positions(library: Library, roads: Mapping[str, Road]) -> None:
    problems = [
        library.build_diagnostic(
            road, *where, message=message, hint="is it the right map? correct the place"
        )
        for road in roads.values()
        for where, message in find_misplaced_agents(road)
    ]
    if problems:
        raise DiagnosticsError(problems)


def _check_catalogue(library: Library, catalogue: Catalogue) -> None:
    if catalogue.ego not in catalogue.blueprints:
        message = f"there is no blueprint '{catalogue.ego}'"
        hint = suggest_name(catalogue.ego, catalogue.blueprints)
        raise DiagnosticsError.from_diagnostic(
            library.build_diagnostic(catalogue, "ego", message=message, hint=hint)
        )
