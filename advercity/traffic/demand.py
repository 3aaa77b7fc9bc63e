"""Who takes part in traffic, where everybody starts and where they go."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from advercity_dsl import Agent, Blueprint, Spec, StagedActor, Vehicle
from advercity_dsl.units import KM_H_PER_M_S

from advercity.errors import InputError
from advercity.frames import Actor
from advercity.randomness import create_generator
from advercity.roads.lane_graph import LaneGraph, find_shortest_route
from advercity.roads.network_file import SumoLane
from advercity.roads.streets import approach_name
from advercity.traffic.paints import CONNECTED_PAINT, draw_paint
from advercity.traffic.pedestrians import PedestrianTrip, draw_pedestrian_trips
from advercity.traffic.placement import (
    VEHICLE_SPACING_M,
    LaneOccupancy,
    compute_start_areas,
    iterate_start_positions,
)

FIRST_BACKGROUND_VEHICLE = 1001
ENTRY_SPEED_M_S = 4.0
MAX_BACKGROUND_SPEED_M_S = 33.0
STARTING_FRACTION = 0.55
"""Share of the vehicles that start on the site, the others come in. The original drew their places
over areas that reach beyond the sites; these hold between 0.4 (rcnj) and 0.76 (rsnj) of them."""
ENTRY_WINDOW_S = 15.0
"""Vehicles that do not start on the site enter at its edge within this time."""
MAX_ROUTE_EDGES = 100
SPEED_SPREAD_PERCENT = 30
BICYCLE_SPEED_M_S = (5.0, 7.0)
CRUISE_MARGIN_KM_H = 1.0
"""Connected vehicles cruise this much below their maximum, as in the original."""


@dataclass(frozen=True)
class VehicleTrip:
    """A vehicle's way through the site.

    Attributes:
        actor: Who drives.
        edges: Route.
        lane: Index of the lane it starts in.
        front_position_m: Where its front bumper starts on the first edge; None enters from its
            beginning.
        depart_s: When it appears.
        start_speed_m_s: How fast it drives then.
        speed_factor: Wanted speed as a multiple of the limit; None ignores the limit.
        top_speed_m_s: It never goes faster.
        acceleration_limits_m_s2: Most it accelerates and brakes; None does as its class.
    """

    actor: Actor
    edges: tuple[str, ...]
    lane: int
    front_position_m: float | None
    depart_s: float
    start_speed_m_s: float
    speed_factor: float | None
    top_speed_m_s: float
    acceleration_limits_m_s2: tuple[float, float] | None = None


@dataclass(frozen=True)
class TrafficDemand:
    """Everybody who takes part."""

    connected: tuple[VehicleTrip, ...]
    staged: tuple[VehicleTrip, ...]
    """Vehicles of staged conflicts that drive in lanes."""
    vehicles: tuple[VehicleTrip, ...]
    walkers: tuple[PedestrianTrip, ...]
    scripted: tuple[Actor, ...]
    """Those in staged conflicts who follow a path of their own; SUMO knows nothing of them."""

    @property
    def trips(self) -> tuple[VehicleTrip, ...]:
        """Of everybody who drives in lanes."""
        return (*self.connected, *self.staged, *self.vehicles)

    @property
    def actors(self) -> tuple[Actor, ...]:
        """Everybody."""
        return (*(one.actor for one in (*self.trips, *self.walkers)), *self.scripted)


def draw_demand(
    spec: Spec, graph: LaneGraph, redraws: Mapping[int, int] | None = None
) -> TrafficDemand:
    """The demand of a scenario: a pure function of the spec's traffic seed, road and numbers.

    Those in staged conflicts count among the vehicles and walkers that are asked for.

    Args:
        spec: What is asked for.
        graph: Lanes of the road.
        redraws: How many draws of a background actor are passed over, by its id, because it was in
            somebody's way.
    """
    redraws = redraws or {}
    occupancy = LaneOccupancy()
    connected = tuple(
        _build_connected_trip(agent, agent.place, spec, graph, occupancy)
        for agent in spec.agents
        if isinstance(agent.place, Vehicle)
    )
    staged = [actor for conflict in spec.conflicts for actor in conflict.actors]
    on_foot = sum(actor.actor_class == "pedestrian" for actor in staged)
    vehicles = max(spec.demand.vehicles - (len(staged) - on_foot), 0)
    return TrafficDemand(
        connected=connected,
        staged=tuple(
            _build_staged_trip(item, spec, graph, occupancy) for item in staged if item.route
        ),
        vehicles=tuple(_draw_background_trips(spec, graph, occupancy, vehicles, redraws)),
        walkers=draw_pedestrian_trips(spec, graph, max(spec.demand.walkers - on_foot, 0), redraws),
        scripted=tuple(_build_staged_actor(item, spec) for item in staged if not item.route),
    )


def _build_staged_trip(
    item: StagedActor, spec: Spec, graph: LaneGraph, occupancy: LaneOccupancy
) -> VehicleTrip:
    lane = _find_start_lane(item, graph)
    actor = _build_staged_actor(item, spec)
    middle = lane.length_m - item.start_m
    occupancy.occupy(lane, middle, actor.size[0])
    return VehicleTrip(
        actor=actor,
        edges=_find_edges_along(item.route, lane.edge, graph),
        lane=lane.index,
        front_position_m=middle + actor.size[0] / 2,
        depart_s=0.0,
        start_speed_m_s=0.0,
        speed_factor=None,
        top_speed_m_s=item.speed_m_s,
        acceleration_limits_m_s2=(item.acceleration_m_s2, item.braking_m_s2),
    )


def _find_start_lane(item: StagedActor, graph: LaneGraph) -> SumoLane:
    """The lane that a staged vehicle stands in: of those that lead along its route, by number."""
    for edge in dict.fromkeys(
        lane.edge for lane in graph.driving_lanes if approach_name(lane.edge) == item.route[0]
    ):
        onward = {approach_name(after) for after in graph.find_successor_edges(edge)}
        lanes = sorted(
            (lane for lane in graph.driving_lanes if lane.edge == edge),
            key=lambda lane: -lane.index,
        )
        if item.route[1:2] and item.route[1] in onward and item.lane <= len(lanes):
            return lanes[item.lane - 1]
    raise InputError(
        f"{item.id}: lane {item.lane} of street '{item.route[0]}' does not lead along"
        f" {' > '.join(item.route)}"
    )


def _build_staged_actor(item: StagedActor, spec: Spec) -> Actor:
    if item.blueprint not in spec.blueprints:
        raise InputError(f"{item.id}: there is no blueprint '{item.blueprint}'")
    blueprint = spec.blueprints[item.blueprint]
    paint = draw_paint(blueprint.actor_class, spec.seeds.traffic, item.number)
    return Actor(item.number, blueprint.actor_class, item.blueprint, paint, _body_size(blueprint))


def _build_connected_trip(
    agent: Agent,
    place: Vehicle,
    spec: Spec,
    graph: LaneGraph,
    occupancy: LaneOccupancy,
) -> VehicleTrip:
    if agent.blueprint is None or agent.blueprint not in spec.blueprints:
        raise InputError(f"{spec.id}: agent '{agent.id}' is a vehicle without a blueprint")
    blueprint = spec.blueprints[agent.blueprint]
    lane, middle = graph.find_lane(place.spawn_m, np.radians(place.heading_deg))
    occupancy.occupy(lane, middle, blueprint.length_m)
    return VehicleTrip(
        actor=Actor(
            agent.number,
            blueprint.actor_class,
            agent.blueprint,
            CONNECTED_PAINT,
            _body_size(blueprint),
        ),
        edges=_find_connected_route(agent.id, place, lane, middle, graph),
        lane=lane.index,
        front_position_m=min(middle + blueprint.length_m / 2, lane.length_m),
        depart_s=0.0,
        start_speed_m_s=0.0,
        speed_factor=None,
        top_speed_m_s=_weather_speed_ratio(spec)
        * (place.max_speed_km_h - CRUISE_MARGIN_KM_H)
        / KM_H_PER_M_S,
    )


def _find_connected_route(
    agent: str, place: Vehicle, lane: SumoLane, position_m: float, graph: LaneGraph
) -> tuple[str, ...]:
    """Edges of a connected vehicle: as declared, else the shortest way."""
    if not place.route:
        return find_shortest_route(graph, lane, position_m, place.destination_m)
    if approach_name(lane.edge) != place.route[0]:
        raise InputError(
            f"agent '{agent}' stands on street '{approach_name(lane.edge)}', but its route"
            f" begins with '{place.route[0]}'"
        )
    return _find_edges_along(place.route, lane.edge, graph)


def _find_edges_along(streets: tuple[str, ...], first: str, graph: LaneGraph) -> tuple[str, ...]:
    """Edges through the streets, from edge `first` on."""
    edges = [first]
    for origin, street in pairwise(streets):
        onward = [
            edge for edge in graph.find_successor_edges(edges[-1]) if approach_name(edge) == street
        ]
        if not onward:
            raise InputError(
                f"route {' > '.join(streets)}: no movement leads from '{origin}' into '{street}';"
                " add it to their junction or correct the route"
            )
        edges.append(onward[0])
    return tuple(edges)


def _draw_background_trips(
    spec: Spec, graph: LaneGraph, occupancy: LaneOccupancy, count: int, redraws: Mapping[int, int]
) -> Iterator[VehicleTrip]:
    poses = list(
        iterate_start_positions(graph.driving_lanes, compute_start_areas(spec), VEHICLE_SPACING_M)
    )
    create_generator(spec.seeds.traffic, "places").shuffle(poses)
    starting = round(STARTING_FRACTION * count)
    for index in range(count):
        number = FIRST_BACKGROUND_VEHICLE + index
        actor = _draw_actor(spec, number)
        pose: tuple[SumoLane, float] | None = None
        for attempt in range(redraws.get(number, 0) + 1):
            tried = poses if attempt == 0 else _shuffle_places(spec, poses, number, attempt)
            fitting = (place for place in tried if occupancy.has_room(*place, actor.size[0]))
            pose = next(fitting, None) if index < starting else None
            if pose is not None:  # those passed over stay empty, so that nobody else moves
                poses.remove(pose)
                occupancy.occupy(*pose, actor.size[0])
        if pose is not None or graph.entry_lanes:
            yield _draw_trip(spec, graph, actor, pose, redraws.get(number, 0))


def _shuffle_places(
    spec: Spec, poses: list[tuple[SumoLane, float]], number: int, attempt: int
) -> list[tuple[SumoLane, float]]:
    tried = list(poses)
    create_generator(spec.seeds.traffic, "places", number, attempt).shuffle(tried)
    return tried


def _draw_trip(
    spec: Spec, graph: LaneGraph, actor: Actor, pose: tuple[SumoLane, float] | None, redraws: int
) -> VehicleTrip:
    draw = create_generator(spec.seeds.traffic, "ride", actor.id, *([redraws] if redraws else []))
    lane = pose[0] if pose else graph.entry_lanes[draw.integers(len(graph.entry_lanes))]
    spread = int(draw.integers(-SPEED_SPREAD_PERCENT, SPEED_SPREAD_PERCENT, endpoint=True))
    entry_s = round(float(draw.uniform(0, ENTRY_WINDOW_S)), 1)
    slow = _weather_speed_ratio(spec) * float(draw.uniform(*BICYCLE_SPEED_M_S))
    factor = _weather_speed_ratio(spec) * (1 - (spec.demand.speed_offset_percent + spread) / 100)
    return VehicleTrip(
        actor=actor,
        edges=_draw_random_route(graph, lane, draw),
        lane=lane.index,
        front_position_m=pose[1] + actor.size[0] / 2 if pose else None,
        depart_s=0.0 if pose else entry_s,
        start_speed_m_s=0.0 if pose else min(ENTRY_SPEED_M_S, factor * lane.speed_limit_m_s / 2),
        speed_factor=factor,
        top_speed_m_s=slow if actor.actor_class == "bicycle" else MAX_BACKGROUND_SPEED_M_S,
    )


def _weather_speed_ratio(spec: Spec) -> float:
    """Of the speeds in clear weather."""
    return spec.caution.speed_share if spec.caution else 1.0


def _draw_random_route(
    graph: LaneGraph, lane: SumoLane, draw: np.random.Generator
) -> tuple[str, ...]:
    """Edges of a random way that keeps to its lane wherever that goes on."""
    edges = [lane.edge]
    while len(edges) < MAX_ROUTE_EDGES and (ways := graph.find_successor_lanes(lane)):
        lane = ways[draw.integers(len(ways))]
        edges.append(lane.edge)
    return tuple(edges)


def _draw_actor(spec: Spec, number: int) -> Actor:
    draw = create_generator(spec.seeds.traffic, "vehicle", number)
    fitting: dict[str, list[str]] = {}
    for name, blueprint in spec.blueprints.items():
        if blueprint.land_use in ("any", spec.road.land_use):
            fitting.setdefault(blueprint.actor_class, []).append(name)
    shares = {
        name: share for name, share in spec.demand.classes.model_dump().items() if name in fitting
    }
    if not any(shares.values()):
        raise InputError(
            f"no blueprint of the classes that '{spec.road.id}' asks for fits {spec.road.land_use}"
            " roads; add one to the catalogue"
        )
    weights = np.array(list(shares.values())) / sum(shares.values())
    models = fitting[list(shares)[draw.choice(len(weights), p=weights)]]
    name = models[draw.integers(len(models))]
    blueprint = spec.blueprints[name]
    paint = draw_paint(blueprint.actor_class, spec.seeds.traffic, number, paints=blueprint.paints)
    return Actor(number, blueprint.actor_class, name, paint, _body_size(blueprint))


def _body_size(blueprint: Blueprint) -> tuple[float, float, float]:
    return blueprint.length_m, blueprint.width_m, blueprint.height_m
