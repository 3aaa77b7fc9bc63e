"""Draw the traffic demand of a scenario: its vehicles and pedestrians, their starts and routes.

Each draw has a random stream of its own, so no actor depends on the draws of another.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from advercity_dsl import Agent, Blueprint, DriverResponse, Spec, StagedActor, Vehicle
from advercity_dsl.units import KM_H_PER_M_S

from advercity.conflicts.ego_motion import CRUISE_MARGIN_KM_H, SpeedZone, list_speed_zones
from advercity.errors import InputError
from advercity.frames import Actor
from advercity.randomness import create_generator
from advercity.roads.capacity import VEHICLE_SPACING_M, describe_excess
from advercity.roads.lane_graph import (
    MAX_ROUTE_EDGES,
    LaneGraph,
    extend_route,
    find_shortest_route,
)
from advercity.roads.network_file import SumoLane
from advercity.roads.streets import approach_name
from advercity.traffic.blueprint_fractions import draw_by_fraction
from advercity.traffic.driving_styles import MEDIAN_STYLE, DrivingStyle, draw_driving_style
from advercity.traffic.paints import CONNECTED_PAINT, draw_paint
from advercity.traffic.pedestrians import PedestrianTrip, draw_pedestrian_trips
from advercity.traffic.placement import (
    LaneOccupancy,
    compute_start_areas,
    iterate_start_positions,
)
from advercity.traffic.semitrailers import TowedTrailer, build_towed_trailer

FIRST_BACKGROUND_VEHICLE = 1001
ENTRY_SPEED_M_S = 4.0
MAX_BACKGROUND_SPEED_M_S = 33.0
STARTING_FRACTION = 0.55
"""Fraction of the vehicles starting on the site; the others enter. The original drew starts over
areas larger than the sites, which hold between 0.4 (rcnj) and 0.76 (rsnj) of them."""
ENTRY_WINDOW_S = 15.0
"""Time within which the other vehicles enter at the edge of the site."""
SPEED_SPREAD_PERCENT = 30
BICYCLE_SPEED_M_S = (5.0, 7.0)


@dataclass(frozen=True)
class VehicleTrip:
    """A vehicle's start and its route through the site.

    Attributes:
        actor: The vehicle.
        edges: Route in SUMO's edges.
        lane: Index of its first lane.
        front_position_m: Position of its front bumper on the first edge; None enters at its start.
        depart_s: Time at which it appears.
        start_speed_m_s: Speed at that time.
        speed_factor: Desired speed as a multiple of the limit; None ignores the limit.
        top_speed_m_s: Maximum speed.
        acceleration_limits_m_s2: Maximum acceleration and braking; None takes its class's.
        waits_s: Time for which it waits at its start.
        speed_zones: Stretches with a speed limit of its own, measured from its start.
        style: Differences of its driver from others.
        trailer: Its semi-trailer; in SUMO, one vehicle is both.
        trailer_heading_rad: Heading of the semi-trailer at the start.
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
    waits_s: float = 0.0
    speed_zones: tuple[SpeedZone, ...] = ()
    style: DrivingStyle = MEDIAN_STYLE
    trailer: TowedTrailer | None = None
    trailer_heading_rad: float = 0.0

    @property
    def length_m(self) -> float:
        """Length of the vehicle with its semi-trailer."""
        return self.trailer.lorry_length_m if self.trailer else self.actor.size[0]


@dataclass(frozen=True)
class TrafficDemand:
    """All actors of a scenario and their trips.

    Attributes:
        connected: Trips of connected vehicles.
        staged: Trips of staged vehicles in lanes.
        vehicles: Trips of background vehicles.
        walkers: Trips of background pedestrians.
        scripted: Staged actors with a path of their own, which SUMO does not simulate.
    """

    connected: tuple[VehicleTrip, ...]
    staged: tuple[VehicleTrip, ...]
    vehicles: tuple[VehicleTrip, ...]
    walkers: tuple[PedestrianTrip, ...]
    scripted: tuple[Actor, ...]

    @property
    def trips(self) -> tuple[VehicleTrip, ...]:
        """Trips of all vehicles in lanes."""
        return (*self.connected, *self.staged, *self.vehicles)

    @property
    def actors(self) -> tuple[Actor, ...]:
        """All actors."""
        trailers = (trip.trailer.actor for trip in self.vehicles if trip.trailer)
        return (
            *(trip.actor for trip in (*self.trips, *self.walkers)),
            *trailers,
            *self.scripted,
        )

    def select_background(self, numbers: Iterable[int]) -> set[int]:
        """Select the background actors among ids; a semi-trailer counts as its tractor unit."""
        towing = {trip.trailer.actor.id: trip.actor.id for trip in self.vehicles if trip.trailer}
        background = {trip.actor.id for trip in (*self.vehicles, *self.walkers)}
        return {towing.get(number, number) for number in numbers} & background


def draw_demand(
    spec: Spec,
    graph: LaneGraph,
    redraws: Mapping[int, int] | None = None,
    crossing_redraws: Mapping[int, int] | None = None,
) -> TrafficDemand:
    """Draw the demand of a scenario, a pure function of its traffic seed, road and numbers.

    Staged actors count among the vehicles and walkers of the density.

    Args:
        spec: The scenario.
        graph: Lanes of the road.
        redraws: Number of draws to skip, by id of a background actor that blocked another.
        crossing_redraws: Number of crossings to skip, by id of a person who could not cross.

    Raises:
        InputError: A start, route or blueprint does not exist, or the road has no room for all.
    """
    _check_room(spec, graph)
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
        walkers=draw_pedestrian_trips(
            spec,
            graph,
            max(spec.demand.walkers - on_foot, 0),
            redraws,
            crossing_redraws or {},
        ),
        scripted=tuple(_build_staged_actor(item, spec) for item in staged if not item.route),
    )


def let_others_drive_on(spec: Spec, demand: TrafficDemand, graph: LaneGraph) -> TrafficDemand:
    """Extend the routes of connected vehicles other than the ego to the edge of the site."""
    return replace(
        demand,
        connected=tuple(
            trip
            if trip.actor.id == spec.ego.number
            else replace(trip, edges=extend_route(graph, trip.edges))
            for trip in demand.connected
        ),
    )


def _check_room(spec: Spec, graph: LaneGraph) -> None:
    excess = describe_excess(
        spec.demand.vehicles,
        spec.demand.walkers,
        lane_m=sum(lane.length_m for lane in graph.driving_lanes),
        sidewalk_m=sum(lane.length_m for lane in graph.sidewalks.values()),
    )
    if excess:
        raise InputError(f"{excess}; ask for fewer in `demand`")


def _build_staged_trip(
    item: StagedActor, spec: Spec, graph: LaneGraph, occupancy: LaneOccupancy
) -> VehicleTrip:
    lane = _find_start_lane(item, graph)
    actor = _build_staged_actor(item, spec)
    centre_m = lane.length_m - item.start_m
    rear_m = centre_m - actor.size[0] / 2
    # An actor through a junction needs a lane without vehicles waiting there at red.
    end_m = lane.length_m if item.behaviour == "stops_short" else rear_m + actor.size[0]
    occupancy.occupy(lane, (rear_m + end_m) / 2, end_m - rear_m)
    return VehicleTrip(
        actor=actor,
        edges=_find_edges_along(item.route, lane.edge, graph),
        lane=lane.index,
        front_position_m=centre_m + actor.size[0] / 2,
        depart_s=0.0,
        start_speed_m_s=0.0,
        speed_factor=None,
        top_speed_m_s=item.speed_m_s,
        acceleration_limits_m_s2=(item.acceleration_m_s2, item.braking_m_s2),
    )


def _find_start_lane(item: StagedActor, graph: LaneGraph) -> SumoLane:
    """Find the first lane of a staged vehicle, by its number among the lanes of its route."""
    for edge in dict.fromkeys(
        lane.edge for lane in graph.driving_lanes if approach_name(lane.edge) == item.route[0]
    ):
        next_streets = {approach_name(after) for after in graph.find_successor_edges(edge)}
        lanes = sorted(
            (lane for lane in graph.driving_lanes if lane.edge == edge),
            key=lambda lane: -lane.index,  # SUMO counts from the right, declarations from inside
        )
        if item.route[1:2] and item.route[1] in next_streets and item.lane <= len(lanes):
            return lanes[item.lane - 1]
    raise InputError(
        f"{item.id}: lane {item.lane} of street '{item.route[0]}' does not lead along"
        f" {' > '.join(item.route)}"
    )


def _build_staged_actor(item: StagedActor, spec: Spec) -> Actor:
    if item.blueprint not in spec.blueprints:
        raise InputError(f"{item.id}: no blueprint '{item.blueprint}' in the spec")
    blueprint = spec.blueprints[item.blueprint]
    paint = draw_paint(blueprint.actor_class, spec.seeds.traffic, item.number)
    return Actor.from_blueprint(item.number, item.blueprint, blueprint, paint)


def _build_connected_trip(
    agent: Agent,
    place: Vehicle,
    spec: Spec,
    graph: LaneGraph,
    occupancy: LaneOccupancy,
) -> VehicleTrip:
    if agent.blueprint is None or agent.blueprint not in spec.blueprints:
        raise InputError(f"agent '{agent.id}' is a vehicle without a blueprint")
    blueprint = spec.blueprints[agent.blueprint]
    lane, centre_m = graph.find_lane(place.spawn_m, np.radians(place.heading_deg))
    occupancy.occupy(lane, centre_m, blueprint.length_m)
    return VehicleTrip(
        actor=Actor.from_blueprint(agent.number, agent.blueprint, blueprint, CONNECTED_PAINT),
        edges=_find_connected_route(agent.id, place, lane, centre_m, graph),
        lane=lane.index,
        front_position_m=min(centre_m + blueprint.length_m / 2, lane.length_m),
        depart_s=0.0,
        start_speed_m_s=0.0,
        speed_factor=None,
        top_speed_m_s=_weather_speed_ratio(spec)
        * (place.max_speed_km_h - CRUISE_MARGIN_KM_H)
        / KM_H_PER_M_S,
        waits_s=place.waits_s,
        speed_zones=list_speed_zones(spec.conflicts) if agent.is_ego else (),
    )


def _find_connected_route(
    agent: str, place: Vehicle, lane: SumoLane, position_m: float, graph: LaneGraph
) -> tuple[str, ...]:
    """Find the edges of a connected vehicle: as declared, else the shortest route."""
    if not place.route:
        return find_shortest_route(graph, lane, position_m, place.destination_m)
    if approach_name(lane.edge) != place.route[0]:
        raise InputError(
            f"agent '{agent}' is on street '{approach_name(lane.edge)}', but its route"
            f" begins with '{place.route[0]}'"
        )
    return _find_edges_along(place.route, lane.edge, graph)


def _find_edges_along(streets: tuple[str, ...], first: str, graph: LaneGraph) -> tuple[str, ...]:
    """Find the edges along streets, from edge `first` on."""
    edges = [first]
    for origin, street in pairwise(streets):
        successors = [
            edge for edge in graph.find_successor_edges(edges[-1]) if approach_name(edge) == street
        ]
        if not successors:
            raise InputError(
                f"route {' > '.join(streets)}: no movement leads from '{origin}' into '{street}';"
                " add it to their junction or correct the route"
            )
        edges.append(successors[0])
    return tuple(edges)


def _draw_background_trips(
    spec: Spec, graph: LaneGraph, occupancy: LaneOccupancy, count: int, redraws: Mapping[int, int]
) -> Iterator[VehicleTrip]:
    starts = list(
        iterate_start_positions(graph.driving_lanes, compute_start_areas(spec), VEHICLE_SPACING_M)
    )
    create_generator(spec.seeds.traffic, "places").shuffle(starts)
    starting = round(STARTING_FRACTION * count)
    for index in range(count):
        number = FIRST_BACKGROUND_VEHICLE + index
        actor = _draw_actor(spec, number)
        trailer = build_towed_trailer(spec, actor)
        length_m = trailer.lorry_length_m if trailer else actor.size[0]
        free = (item for item in starts if occupancy.has_room(*item, length_m))
        start = next(free, None) if index < starting else None
        if start is not None:
            starts.remove(start)
            occupancy.occupy(*start, length_m)
        if redraws.get(number, 0):
            # A blocking vehicle enters at the edge. Its start stays empty, so no other moves.
            start = None
        if start is not None or graph.entry_lanes:
            trip = _draw_trip(spec, graph, actor, start, redraws.get(number, 0), length_m)
            yield _add_trailer(trip, trailer, graph) if trailer else trip


def _draw_trip(
    spec: Spec,
    graph: LaneGraph,
    actor: Actor,
    start: tuple[SumoLane, float] | None,
    redraws: int,
    length_m: float,
) -> VehicleTrip:
    draw = create_generator(spec.seeds.traffic, "ride", actor.id, *([redraws] if redraws else []))
    lane = start[0] if start else graph.entry_lanes[draw.integers(len(graph.entry_lanes))]
    spread = int(draw.integers(-SPEED_SPREAD_PERCENT, SPEED_SPREAD_PERCENT, endpoint=True))
    entry_s = round(float(draw.uniform(0, ENTRY_WINDOW_S)), 1)
    slow = _weather_speed_ratio(spec) * float(draw.uniform(*BICYCLE_SPEED_M_S))
    factor = _weather_speed_ratio(spec) * (1 - (spec.demand.speed_offset_percent + spread) / 100)
    return VehicleTrip(
        actor=actor,
        edges=_draw_random_route(graph, lane, draw),
        lane=lane.index,
        front_position_m=start[1] + length_m / 2 if start else None,
        depart_s=0.0 if start else entry_s,
        start_speed_m_s=0.0 if start else min(ENTRY_SPEED_M_S, factor * lane.speed_limit_m_s / 2),
        speed_factor=factor,
        top_speed_m_s=slow if actor.actor_class == "bicycle" else MAX_BACKGROUND_SPEED_M_S,
        style=draw_driving_style(spec.seeds.traffic, actor.id),
    )


def _add_trailer(trip: VehicleTrip, trailer: TowedTrailer, graph: LaneGraph) -> VehicleTrip:
    lane = graph.lanes[f"{trip.edges[0]}_{trip.lane}"]
    # An entering lorry has its rear at the start of the lane.
    front_m = trailer.lorry_length_m if trip.front_position_m is None else trip.front_position_m
    heading_rad = trailer.find_start_heading(lane, front_m)
    return replace(trip, trailer=trailer, trailer_heading_rad=heading_rad)


def slow_trip(
    trip: VehicleTrip, response: DriverResponse, *, before: DriverResponse | None
) -> VehicleTrip:
    """Return a trip at the speed of another response of drivers."""
    ratio = response.speed_share / (before.speed_share if before else 1.0)
    slows = trip.speed_factor is None or trip.actor.actor_class == "bicycle"
    return replace(
        trip,
        speed_factor=None if trip.speed_factor is None else ratio * trip.speed_factor,
        top_speed_m_s=ratio * trip.top_speed_m_s if slows else trip.top_speed_m_s,
    )


def _weather_speed_ratio(spec: Spec) -> float:
    """Return the ratio of drivers' speed to their speed in clear weather."""
    return spec.caution.speed_share if spec.caution else 1.0


def _draw_random_route(
    graph: LaneGraph, lane: SumoLane, draw: np.random.Generator
) -> tuple[str, ...]:
    """Draw a random route that keeps to its lane wherever the lane continues."""
    edges = [lane.edge]
    while len(edges) < MAX_ROUTE_EDGES and (successors := graph.find_successor_lanes(lane)):
        lane = successors[draw.integers(len(successors))]
        edges.append(lane.edge)
    return tuple(edges)


def _draw_actor(spec: Spec, number: int) -> Actor:
    draw = create_generator(spec.seeds.traffic, "vehicle", number)
    fitting: dict[str, dict[str, Blueprint]] = {}
    for name, blueprint in spec.blueprints.items():
        if blueprint.land_use in ("any", spec.road.land_use) and not blueprint.semitrailer:
            fitting.setdefault(blueprint.actor_class, {})[name] = blueprint
    weights = {
        name: weight for name, weight in spec.demand.classes.model_dump().items() if name in fitting
    }
    if not any(weights.values()):
        raise InputError(
            f"no blueprint of the classes that '{spec.road.id}' asks for fits {spec.road.land_use}"
            " roads; add one to the catalogue"
        )
    fractions = np.array(list(weights.values())) / sum(weights.values())
    models = fitting[list(weights)[draw.choice(len(fractions), p=fractions)]]
    # Blueprints without a fraction first, so fractions change no other vehicle.
    usual = [name for name, item in models.items() if item.fraction is None] or list(models)
    name = usual[draw.integers(len(usual))]
    name = draw_by_fraction(models, spec.seeds.traffic, "vehicle fraction", number) or name
    blueprint = spec.blueprints[name]
    paint = draw_paint(blueprint.actor_class, spec.seeds.traffic, number, paints=blueprint.paints)
    return Actor.from_blueprint(number, name, blueprint, paint)
