"""Who takes part in traffic, where everybody starts and where they go."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from advercity_dsl import Agent, Blueprint, Spec, StagedActor, Vehicle

from advercity.errors import InputError
from advercity.randomness import generator
from advercity.traffic.lanes import Lane, LaneGraph
from advercity.traffic.placement import VEHICLE_GRID_M, Occupancy, areas, grid
from advercity.traffic.routing import shortest_way
from advercity.traffic.trace import Actor
from advercity.traffic.walks import Walk, walks
from advercity.world.bodies import paint_for
from advercity.world.bodies.paint import CONNECTED_PAINT
from advercity.world.edges import approach

FIRST_VEHICLE = 1001
ENTRY_SPEED_M_S = 4.0
FASTEST_BACKGROUND_M_S = 33.0
STARTING_SHARE = 0.55
"""Share of the vehicles that start on the site, the others come in. The original drew their places
over areas that reach beyond the sites; these hold between 0.4 (rcnj) and 0.76 (rsnj) of them."""
ENTRY_WINDOW_S = 15.0
"""Vehicles that do not start on the site enter at its edge within this time."""
MOST_EDGES = 100
SPEED_SPREAD_PERCENT = 30
BICYCLE_SPEED_M_S = (5.0, 7.0)
CRUISE_BELOW_MAX_KM_H = 1.0
"""Connected vehicles cruise this much below their maximum, as in the original."""


@dataclass(frozen=True)
class Ride:
    """A vehicle's way through the site.

    Attributes:
        actor: Who drives.
        edges: Route.
        lane: Index of the lane it starts in.
        front_m: Where its front bumper starts on the first edge; None enters from its beginning.
        depart_s: When it appears.
        start_speed_m_s: How fast it drives then.
        speed_factor: Wanted speed as a multiple of the limit; None ignores the limit.
        top_speed_m_s: It never goes faster.
        limits_m_s2: Most it accelerates and brakes; None does as its class.
    """

    actor: Actor
    edges: tuple[str, ...]
    lane: int
    front_m: float | None
    depart_s: float
    start_speed_m_s: float
    speed_factor: float | None
    top_speed_m_s: float
    limits_m_s2: tuple[float, float] | None = None


@dataclass(frozen=True)
class Demand:
    """Everybody who takes part."""

    connected: tuple[Ride, ...]
    staged: tuple[Ride, ...]
    """Vehicles of staged conflicts that drive in lanes."""
    vehicles: tuple[Ride, ...]
    walkers: tuple[Walk, ...]
    scripted: tuple[Actor, ...]
    """Those in staged conflicts who follow a path of their own; SUMO knows nothing of them."""

    @property
    def rides(self) -> tuple[Ride, ...]:
        """Of everybody who drives in lanes."""
        return (*self.connected, *self.staged, *self.vehicles)

    @property
    def actors(self) -> tuple[Actor, ...]:
        """Everybody."""
        return (*(one.actor for one in (*self.rides, *self.walkers)), *self.scripted)


def draw(spec: Spec, graph: LaneGraph, again: Mapping[int, int] | None = None) -> Demand:
    """The demand of a scenario: a pure function of the spec's traffic seed, road and numbers.

    Those in staged conflicts count among the vehicles and walkers that are asked for.

    Args:
        spec: What is asked for.
        graph: Lanes of the road.
        again: How many draws of a background actor are passed over, by its id, because it was in
            somebody's way.
    """
    again = again or {}
    occupancy = Occupancy()
    connected = tuple(
        _connected(agent, agent.place, spec, graph, occupancy)
        for agent in spec.agents
        if isinstance(agent.place, Vehicle)
    )
    staged = [actor for conflict in spec.conflicts for actor in conflict.actors]
    on_foot = sum(actor.actor_class == "pedestrian" for actor in staged)
    vehicles = max(spec.demand.vehicles - (len(staged) - on_foot), 0)
    return Demand(
        connected=connected,
        staged=tuple(_staged(item, spec, graph, occupancy) for item in staged if item.route),
        vehicles=tuple(_background(spec, graph, occupancy, vehicles, again)),
        walkers=walks(spec, graph, max(spec.demand.walkers - on_foot, 0), again),
        scripted=tuple(_body(item, spec) for item in staged if not item.route),
    )


def _staged(item: StagedActor, spec: Spec, graph: LaneGraph, occupancy: Occupancy) -> Ride:
    lane = _first_lane(item, graph)
    actor = _body(item, spec)
    middle = lane.length_m - item.start_m
    occupancy.take(lane, middle, actor.size[0])
    return Ride(
        actor=actor,
        edges=_along(item.route, lane.edge, graph),
        lane=lane.index,
        front_m=middle + actor.size[0] / 2,
        depart_s=0.0,
        start_speed_m_s=0.0,
        speed_factor=None,
        top_speed_m_s=item.speed_m_s,
        limits_m_s2=(item.acceleration_m_s2, item.braking_m_s2),
    )


def _first_lane(item: StagedActor, graph: LaneGraph) -> Lane:
    """The lane that a staged vehicle stands in: of those that lead along its route, by number."""
    for edge in dict.fromkeys(
        lane.edge for lane in graph.driven if approach(lane.edge) == item.route[0]
    ):
        onward = {approach(after) for after in graph.edges_after(edge)}
        lanes = sorted(
            (lane for lane in graph.driven if lane.edge == edge), key=lambda lane: -lane.index
        )
        if item.route[1:2] and item.route[1] in onward and item.lane <= len(lanes):
            return lanes[item.lane - 1]
    raise InputError(
        f"{item.id}: lane {item.lane} of street '{item.route[0]}' does not lead along"
        f" {' > '.join(item.route)}"
    )


def _body(item: StagedActor, spec: Spec) -> Actor:
    if item.blueprint not in spec.blueprints:
        raise InputError(f"{item.id}: there is no blueprint '{item.blueprint}'")
    blueprint = spec.blueprints[item.blueprint]
    paint = paint_for(blueprint.actor_class, spec.seeds.traffic, item.number)
    return Actor(item.number, blueprint.actor_class, item.blueprint, paint, _size(blueprint))


def _connected(
    agent: Agent,
    place: Vehicle,
    spec: Spec,
    graph: LaneGraph,
    occupancy: Occupancy,
) -> Ride:
    if agent.blueprint is None or agent.blueprint not in spec.blueprints:
        raise InputError(f"{spec.id}: agent '{agent.id}' is a vehicle without a blueprint")
    blueprint = spec.blueprints[agent.blueprint]
    lane, middle = graph.lane_at(place.spawn_m, np.radians(place.heading_deg))
    occupancy.take(lane, middle, blueprint.length_m)
    return Ride(
        actor=Actor(
            agent.number, blueprint.actor_class, agent.blueprint, CONNECTED_PAINT, _size(blueprint)
        ),
        edges=_route(agent.id, place, lane, middle, graph),
        lane=lane.index,
        front_m=min(middle + blueprint.length_m / 2, lane.length_m),
        depart_s=0.0,
        start_speed_m_s=0.0,
        speed_factor=None,
        top_speed_m_s=_speed_share(spec) * (place.max_speed_km_h - CRUISE_BELOW_MAX_KM_H) / 3.6,
    )


def _route(
    agent: str, place: Vehicle, lane: Lane, position_m: float, graph: LaneGraph
) -> tuple[str, ...]:
    """Edges of a connected vehicle: as declared, else the shortest way."""
    if not place.route:
        return shortest_way(graph, lane, position_m, place.destination_m)
    if approach(lane.edge) != place.route[0]:
        raise InputError(
            f"agent '{agent}' stands on street '{approach(lane.edge)}', but its route"
            f" begins with '{place.route[0]}'"
        )
    return _along(place.route, lane.edge, graph)


def _along(streets: tuple[str, ...], first: str, graph: LaneGraph) -> tuple[str, ...]:
    """Edges through the streets, from edge `first` on."""
    edges = [first]
    for origin, street in pairwise(streets):
        onward = [edge for edge in graph.edges_after(edges[-1]) if approach(edge) == street]
        if not onward:
            raise InputError(
                f"route {' > '.join(streets)}: no movement leads from '{origin}' into '{street}';"
                " add it to their junction or correct the route"
            )
        edges.append(onward[0])
    return tuple(edges)


def _background(
    spec: Spec, graph: LaneGraph, occupancy: Occupancy, count: int, again: Mapping[int, int]
) -> Iterator[Ride]:
    poses = list(grid(graph.driven, areas(spec), VEHICLE_GRID_M))
    generator(spec.seeds.traffic, "places").shuffle(poses)
    starting = round(STARTING_SHARE * count)
    for index in range(count):
        number = FIRST_VEHICLE + index
        actor = _drawn(spec, number)
        pose: tuple[Lane, float] | None = None
        for attempt in range(again.get(number, 0) + 1):
            tried = poses if attempt == 0 else _reordered(spec, poses, number, attempt)
            fitting = (place for place in tried if occupancy.fits(*place, actor.size[0]))
            pose = next(fitting, None) if index < starting else None
            if pose is not None:  # those passed over stay empty, so that nobody else moves
                poses.remove(pose)
                occupancy.take(*pose, actor.size[0])
        if pose is not None or graph.entries:
            yield _ride(spec, graph, actor, pose, again.get(number, 0))


def _reordered(
    spec: Spec, poses: list[tuple[Lane, float]], number: int, attempt: int
) -> list[tuple[Lane, float]]:
    tried = list(poses)
    generator(spec.seeds.traffic, "places", number, attempt).shuffle(tried)
    return tried


def _ride(
    spec: Spec, graph: LaneGraph, actor: Actor, pose: tuple[Lane, float] | None, again: int
) -> Ride:
    draw = generator(spec.seeds.traffic, "ride", actor.id, *([again] if again else []))
    lane = pose[0] if pose else graph.entries[draw.integers(len(graph.entries))]
    spread = int(draw.integers(-SPEED_SPREAD_PERCENT, SPEED_SPREAD_PERCENT, endpoint=True))
    entry_s = round(float(draw.uniform(0, ENTRY_WINDOW_S)), 1)
    slow = _speed_share(spec) * float(draw.uniform(*BICYCLE_SPEED_M_S))
    factor = _speed_share(spec) * (1 - (spec.demand.speed_offset_percent + spread) / 100)
    return Ride(
        actor=actor,
        edges=_through(graph, lane, draw),
        lane=lane.index,
        front_m=pose[1] + actor.size[0] / 2 if pose else None,
        depart_s=0.0 if pose else entry_s,
        start_speed_m_s=0.0 if pose else min(ENTRY_SPEED_M_S, factor * lane.speed_limit_m_s / 2),
        speed_factor=factor,
        top_speed_m_s=slow if actor.actor_class == "bicycle" else FASTEST_BACKGROUND_M_S,
    )


def _speed_share(spec: Spec) -> float:
    """Of the speeds in clear weather."""
    return spec.caution.speed_share if spec.caution else 1.0


def _through(graph: LaneGraph, lane: Lane, draw: np.random.Generator) -> tuple[str, ...]:
    """Edges of a random way that keeps to its lane wherever that goes on."""
    edges = [lane.edge]
    while len(edges) < MOST_EDGES and (ways := graph.ways_from(lane)):
        lane = ways[draw.integers(len(ways))]
        edges.append(lane.edge)
    return tuple(edges)


def _drawn(spec: Spec, number: int) -> Actor:
    draw = generator(spec.seeds.traffic, "vehicle", number)
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
    paint = paint_for(blueprint.actor_class, spec.seeds.traffic, number, paints=blueprint.paints)
    return Actor(number, blueprint.actor_class, name, paint, _size(blueprint))


def _size(blueprint: Blueprint) -> tuple[float, float, float]:
    return blueprint.length_m, blueprint.width_m, blueprint.height_m
