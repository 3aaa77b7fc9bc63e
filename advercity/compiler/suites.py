"""Suites: selection of typologies, their required roads, and the declarations of a suite."""

import logging
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import TypeVar

from advercity_dsl import (
    Catalogue,
    Channel,
    Declaration,
    Density,
    Drivers,
    Rig,
    Road,
    RoadsideUnit,
    SensorSet,
    Suite,
    Typology,
    Vehicle,
    Weather,
)
from advercity_dsl.base import suggest_name
from advercity_dsl.channel import is_multiple
from advercity_dsl.road import StripKind
from advercity_dsl.suite import Coverage, Selection

from advercity.compiler.agent_places import find_place_problems, iterate_strip_lines
from advercity.compiler.library import Library
from advercity.diagnostics import Diagnostic, DiagnosticsError
from advercity.roads.arms import MisplacedPartError
from advercity.roads.capacity import describe_excess

_logger = logging.getLogger(__name__)
DeclarationT = TypeVar("DeclarationT", bound=Declaration)


def is_selected(typology: Typology, rule: Selection) -> bool:
    """Return whether crashes of a typology are fatal, with a partner, and visibility-related."""
    figures = typology.statistics
    return (
        figures is not None
        and (figures.external_entity or figures.vehicles_per_crash >= rule.vehicles_per_crash)
        and figures.fatality_rate_percent >= rule.fatality_rate_percent
        and figures.bad_visibility_percent >= rule.bad_visibility_percent
    )


@dataclass(frozen=True)
class RoadCategory:
    """A kind of road on which a typology's crashes happen; any geometry if it is None."""

    land_use: str
    junction: str
    geometry: str | None = None

    def matches(self, road: Road) -> bool:
        """Return whether a road is of this kind."""
        is_straight = road.alignment == "straight" and road.profile == "level"
        return (
            self.land_use == road.land_use
            and self.junction == road.junction
            and self.geometry in (None, "straight" if is_straight else "curved")
        )

    def __str__(self) -> str:
        """`rural non_junction curved`."""
        return " ".join(part for part in (self.land_use, self.junction, self.geometry) if part)


def find_required_categories(typology: Typology, rule: Coverage) -> tuple[RoadCategory, ...]:
    """Return the kinds of roads for a typology: the product of its frequent features."""
    roads = typology.roads
    if roads is None:
        return ()
    percent_by_use = {"urban": roads.urban_percent, "rural": roads.rural_percent}
    land_uses = [use for use, value in percent_by_use.items() if value >= rule.land_use_percent]
    junctions = dict.fromkeys(
        item.junction for item in roads.junctions if item.percent >= rule.junction_percent
    )
    # Slopes and curves hide other vehicles alike, so either requires a road of each geometry.
    bent_percent = max(roads.non_level_percent or 0, roads.curved_percent or 0)
    geometries = ("straight", "curved") if bent_percent >= rule.geometry_percent else (None,)
    return tuple(
        RoadCategory(land_use, junction, geometry)
        for land_use in land_uses
        for junction in junctions
        for geometry in geometries
    )


CONNECTED_CLASSES = ("car", "van", "truck")
"""Classes of blueprints for connected vehicles."""
SPAWN_AREAS = 8
"""Areas for which vehicles are counted: around each of five agents, along each of three paths."""


def check_demand(library: Library, road: Road, density: Density) -> None:
    """Check that a road has room for the traffic of a density; warn where it has no pedestrians.

    Raises:
        DiagnosticsError: It has no room.
    """
    vehicles, walkers = compute_demand_counts(road, density)
    lane_m, sidewalk_m = (
        sum(line.length_m for line in iterate_strip_lines(road, kind))
        for kind in (StripKind.LANE, StripKind.SIDEWALK)
    )
    if walkers and not sidewalk_m:
        _logger.warning("%s: has no pedestrians, since none of its streets has a sidewalk", road.id)
    excess = describe_excess(vehicles, walkers, lane_m=lane_m, sidewalk_m=sidewalk_m)
    if excess:
        field = "vehicles" if "vehicles" in excess else "walkers"
        factor: float = getattr(density, field)
        message = f"{factor:g} times the demand of road '{road.id}': {excess}"
        hint = f"'{field}' is a factor on the road's own demand: 1 is light traffic, 3 dense"
        raise DiagnosticsError(library.build_diagnostic(density, field, message=message, hint=hint))


def compute_demand_counts(road: Road, density: Density) -> tuple[int, int]:
    """Compute the numbers of vehicles and pedestrians of a road at a density."""
    # Rounded per area, as the original does, then multiplied.
    vehicles = SPAWN_AREAS * round(road.traffic.vehicles_per_area * density.vehicles)
    return vehicles, round(road.traffic.walkers * density.walkers)


@dataclass(frozen=True)
class ResolvedSuite:
    """Declarations crossed by a suite, by id, and the ones common to its scenarios."""

    roads: Mapping[str, Road]
    weathers: Mapping[str, Weather]
    densities: Mapping[str, Density]
    rig: Rig
    agent_rigs: Mapping[str, Rig]
    channel: Channel | None
    catalogue: Catalogue
    drivers: Drivers | None
    reaction_weather: Weather | None


def list_left_out(library: Library, suite: ResolvedSuite) -> Iterator[str]:
    """List the parts of a suite without effect: junctions without agents."""
    entries = {
        library.find_declared_id(road.id): library.find_entry(road) for road in suite.roads.values()
    }
    for name, entry in entries.items():
        for junction, reason in entry.left_out.items():
            yield f"{name}: no agents at {junction}: {reason}"


def resolve_suite(library: Library, suite: Suite) -> ResolvedSuite:
    """Find the declarations named by a suite, which `check_references` has checked."""

    def find(field: str, kind: type[DeclarationT]) -> dict[str, DeclarationT]:
        available = library.get_declarations(kind)
        written: Iterable[str] = getattr(suite, field)
        if written == "all":
            return available
        of_kind = str(kind.model_fields["kind"].default)
        selected = (item for name in written for item in library.list_selected(of_kind, name))
        return {name: available[name] for name in selected}

    rigs, drivers = library.get_declarations(Rig), library.get_declarations(Drivers)
    weathers = library.get_declarations(Weather)
    return ResolvedSuite(
        find("roads", Road),
        library.list_weathers() if suite.weathers == "all" else find("weathers", Weather),
        find("densities", Density),
        rigs[suite.rig],
        {agent: rigs[name] for agent, name in suite.agents.items()},
        library.get_declarations(Channel)[suite.channel] if suite.channel else None,
        library.get_declarations(Catalogue)[suite.catalogue],
        drivers[suite.drivers] if suite.drivers else None,
        weathers[suite.reaction_weather] if suite.reaction_weather else None,
    )


def select_sensors(place: Vehicle | RoadsideUnit, rig: Rig) -> SensorSet | None:
    """Select a rig's sensors for an agent at a place; None if the rig has none for its kind."""
    return rig.roadside_unit if isinstance(place, RoadsideUnit) else rig.vehicle


def check_resolved_suite(library: Library, declared: Suite, suite: ResolvedSuite) -> None:
    """Check the declarations of a suite against each other.

    Raises:
        DiagnosticsError: The suite equips missing or unsuitable agents, a roadside unit has no
            vertical field of view, a road does not have exactly one ego, an agent is off its road's
            map, or messages are sent between two ticks.
    """
    diagnostics = [
        *_check_named_agents(library, declared, suite),
        *_check_staged_roads(library, declared, suite),
    ]
    diagnostics += _check_swept_channel(library, declared, suite)
    if suite.channel is not None:
        diagnostics += find_untimely_messages(library, declared, suite.channel)
    for road in suite.roads.values():
        diagnostics += _check_bodies(library, declared, suite, road)
        diagnostics += _check_sensors(library, declared, suite, road)
        diagnostics += _check_lidars(library, suite, road)
        diagnostics += _check_ego(library, road)
        diagnostics += _check_agent_positions(library, road)
        diagnostics += _check_recorded_road(library, declared, road)
    if diagnostics:
        raise DiagnosticsError(*diagnostics)


def _check_staged_roads(
    library: Library, declared: Suite, suite: ResolvedSuite
) -> Iterator[Diagnostic]:
    """Check that a suite selects the roads for which it stages conflicts itself."""
    selected = {library.find_declared_id(name) for name in suite.roads}
    document = library.find_entry(declared).source.document
    for name in declared.stage:
        # A suite may select fewer roads than its parent stages conflicts on.
        if name not in selected and document.has_value(("stage", name)):
            message, hint = f"`roads` does not select '{name}'", "select it, or remove it here"
            yield library.build_diagnostic(declared, "stage", name, message=message, hint=hint)


def _check_recorded_road(library: Library, suite: Suite, road: Road) -> Iterator[Diagnostic]:
    """Check that no conflict is staged among actors with recorded trajectories."""
    staged = ("stage", road.id) if suite.stage.get(road.id) else ()
    at = ("cross_conflicts",) if suite.cross_conflicts else staged
    if road.trajectories is not None and at:
        message = f"the actors of '{road.id}' follow recorded trajectories, which stage no conflict"
        hint = "leave the road out, or give it a suite of its own"
        yield library.build_diagnostic(suite, *at, message=message, hint=hint)


def _check_named_agents(
    library: Library, declared: Suite, suite: ResolvedSuite
) -> Iterator[Diagnostic]:
    """Check that agents with a rig or a body of their own exist."""
    names = {name for road in suite.roads.values() for name in road.agents}
    for field, named in (("agents", declared.agents), ("bodies", declared.bodies)):
        for name in named:
            if name not in names:
                message, hint = "no road of the suite has this agent", suggest_name(name, names)
                at = (field, name)
                yield library.build_diagnostic(declared, *at, message=message, hint=hint, key=True)


def _check_swept_channel(
    library: Library, declared: Suite, suite: ResolvedSuite
) -> Iterator[Diagnostic]:
    """Check that a suite with a swept channel field has a channel."""
    for at, sweep in declared.sweeps.items():
        if suite.channel is None and sweep.field.startswith("channel."):
            message, hint = "the suite has no channel", "name one: `channel: ideal`"
            yield library.build_diagnostic(declared, *at, "field", message=message, hint=hint)


def find_untimely_messages(
    library: Library, declared: Suite, channel: Channel
) -> Iterator[Diagnostic]:
    """Find the messages of a channel whose period is no whole number of a suite's ticks."""
    tick_s = declared.timing.tick_s
    for name, period_s in channel.periods_s.items():
        if not is_multiple(period_s, tick_s):
            suite = f"tick_s of suite '{declared.id}', {tick_s:g} s"
            message = f"{period_s:g} s is no multiple of {suite}"
            hint = f"messages are sent at ticks: {tick_s:g} s, {2 * tick_s:g} s, ..."
            yield library.build_diagnostic(channel, name, "period_s", message=message, hint=hint)


def _check_bodies(
    library: Library, declared: Suite, suite: ResolvedSuite, road: Road
) -> Iterator[Diagnostic]:
    for name, place in road.agents.items():
        if name not in declared.bodies:
            continue
        blueprint = suite.catalogue.blueprints[declared.bodies[name]]
        if isinstance(place, RoadsideUnit):
            message = f"is a roadside unit of '{road.id}', which has no body"
        elif blueprint.actor_class not in CONNECTED_CLASSES:
            message = f"is a {blueprint.actor_class}; connected vehicles are cars, vans or trucks"
        elif blueprint.tows or blueprint.semitrailer:
            message = "is articulated; connected vehicles are rigid"
        elif blueprint.land_use not in ("any", road.land_use):
            message = f"is not seen on {road.land_use} roads such as '{road.id}'"
        else:
            continue
        yield library.build_diagnostic(declared, "bodies", name, message=message)


def _check_sensors(
    library: Library, declared: Suite, suite: ResolvedSuite, road: Road
) -> Iterator[Diagnostic]:
    for name, place in road.agents.items():
        rig = suite.agent_rigs.get(name, suite.rig)
        if select_sensors(place, rig) is None:
            at = ("agents", name) if name in suite.agent_rigs else ("rig",)
            message = f"'{rig.id}' has no sensors of a {place.kind}, which '{name}' is"
            hint = f"add `{place.kind}` to the rig, or give '{name}' another one in `agents`"
            yield library.build_diagnostic(declared, *at, message=message, hint=hint)


def _check_lidars(library: Library, suite: ResolvedSuite, road: Road) -> Iterator[Diagnostic]:
    for name, agent in road.agents.items():
        sensors = select_sensors(agent, suite.agent_rigs.get(name, suite.rig))
        upper_deg = agent.lidar_upper_deg if isinstance(agent, RoadsideUnit) else None
        lidar = sensors.lidar if sensors else None
        lower_deg = lidar.lower_deg if lidar else -math.inf
        if upper_deg is not None and upper_deg <= lower_deg:
            message = f"{upper_deg:g} is not above the rig's lower_deg {lower_deg:g}"
            value_path = ("agents", name, "lidar_upper_deg")
            yield library.build_diagnostic(road, *value_path, message=message)


def _check_ego(library: Library, road: Road) -> Iterator[Diagnostic]:
    count = sum(agent.is_ego for agent in road.agents.values())
    if count != 1:
        message = f"{count} agents have the role 'ego'; exactly one is required"
        yield library.build_diagnostic(road, "agents", message=message)


def _check_agent_positions(library: Library, road: Road) -> Iterator[Diagnostic]:
    try:
        for value_path, message, hint in find_place_problems(road):
            yield library.build_diagnostic(road, *value_path, message=message, hint=hint)
    except MisplacedPartError as error:
        yield library.build_diagnostic(road, *error.value_path, message=str(error))
