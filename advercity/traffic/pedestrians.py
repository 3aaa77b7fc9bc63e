"""Draw pedestrians' trips over the sidewalks of the site, some of them across streets."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from advercity_dsl import Blueprint, Spec

from advercity.frames import Actor
from advercity.randomness import create_generator
from advercity.roads.capacity import WALKER_SPACING_M
from advercity.roads.lane_graph import LaneGraph, StreetCrossing
from advercity.roads.network_file import SumoLane
from advercity.traffic.blueprint_fractions import draw_by_fraction
from advercity.traffic.paints import draw_paint
from advercity.traffic.placement import (
    compute_start_areas,
    iterate_start_positions,
)

FIRST_BACKGROUND_WALKER = 5001
MIN_WALKING_SPEED_M_S, MAX_WALKING_SPEED_M_S = 1.0, 2.0
MIN_LEG_M = 5.0
END_CLEARANCE_M = 0.5
MAX_CROSSING_DRAWS = 7
"""Number of draws after which a person who still blocks others does not cross."""
CROSSING_WINDOW_S = 8.0
"""Time after the begin of the recording within which people come to the street they cross."""

MAX_GREEN_WAIT_S = 14.0
"""Maximum wait for green at the crossing they choose, if any has so short a wait."""
GREEN_SPREAD_S = 6.0
"""Time after the begin of its green within which people come to a crossing found red."""


@dataclass(frozen=True)
class WalkLeg:
    """Sidewalks (SUMO edges) to a destination, and its position on the last one."""

    edges: tuple[str, ...]
    end_position_m: float


@dataclass(frozen=True)
class PedestrianTrip:
    """A person's walk from destination to destination, longer than the scenario can last."""

    actor: Actor
    edge: str
    start_m: float
    legs: tuple[WalkLeg, ...]
    speed_m_s: float
    depart_s: float = 0.0
    crosses: bool = False
    """Whether it first crosses a street."""


def draw_pedestrian_trips(
    spec: Spec,
    graph: LaneGraph,
    count: int,
    redraws: Mapping[int, int],
    crossing_redraws: Mapping[int, int],
) -> tuple[PedestrianTrip, ...]:
    """Draw the trips of people on foot.

    The declared fraction of them first crosses a street. They start near enough to cross soon after
    the recording begins, at green if the crossing has lights.

    Args:
        spec: The scenario.
        graph: Lanes of the road.
        count: Number of people; fewer are drawn if the sidewalks are full.
        redraws: Number of draws to skip, by id of a person.
        crossing_redraws: Number of crossings to skip, by id of a person.
    """
    starts = list(
        iterate_start_positions(
            graph.sidewalks.values(), compute_start_areas(spec), WALKER_SPACING_M
        )
    )
    create_generator(spec.seeds.traffic, "walker places").shuffle(starts)
    people = {
        name: item for name, item in spec.blueprints.items() if item.actor_class == "pedestrian"
    }
    if not people:
        return ()
    trips = [
        _draw_trip(spec, graph, people, number, redraws.get(number, 0), starts, start)
        for number, start in enumerate(starts[:count], FIRST_BACKGROUND_WALKER)
    ]
    crossing = _draw_crossing_people(spec, trips)
    places = _find_crossings(spec, graph)
    return tuple(
        _send_across(
            spec,
            graph,
            places,
            trip,
            redraws.get(trip.actor.id, 0),
            crossing_redraws.get(trip.actor.id, 0),
        )
        if places
        and trip.actor.id in crossing
        and redraws.get(trip.actor.id, 0) < MAX_CROSSING_DRAWS
        else trip
        for trip in trips
    )


def _draw_crossing_people(spec: Spec, trips: Sequence[PedestrianTrip]) -> set[int]:
    numbers = [trip.actor.id for trip in trips]
    create_generator(spec.seeds.traffic, "crossing").shuffle(numbers)
    return set(numbers[: round(spec.demand.crossing_share * len(numbers))])


def _find_crossings(spec: Spec, graph: LaneGraph) -> list[StreetCrossing]:
    """Find the crossings in the start areas."""
    areas = compute_start_areas(spec)
    ends = (
        graph.sidewalks[item.sidewalk].shape[[-1 if item.at_end else 0], :2]
        for item in graph.street_crossings
    )
    return [
        item
        for item, end in zip(graph.street_crossings, ends, strict=True)
        if any(area.contains(end).any() for area in areas)
    ]


def _send_across(
    spec: Spec,
    graph: LaneGraph,
    crossings: Sequence[StreetCrossing],
    trip: PedestrianTrip,
    *redraws: int,
) -> PedestrianTrip:
    """Return the trip of a person who first crosses a street, if possible one with green soon."""
    timing = spec.timing
    draw = create_generator(spec.seeds.traffic, "crosses", trip.actor.id, *redraws)
    begin_s = timing.warm_up_ticks * timing.tick_s
    at_s = begin_s + float(draw.uniform(0, CROSSING_WINDOW_S))
    later_s = float(draw.uniform(0, GREEN_SPREAD_S))
    order = draw.permutation(len(crossings)).tolist()
    waits_s = [max(crossings[at].find_green_s(at_s) - at_s, MAX_GREEN_WAIT_S) for at in order]
    crossing = crossings[order[int(np.argmin(waits_s))]]
    green_s = crossing.find_green_s(at_s)
    crosses_s = at_s if green_s == at_s else crossing.find_green_s(green_s + later_s)
    length_m = graph.sidewalks[crossing.sidewalk].length_m
    way_m = trip.speed_m_s * crosses_s - crossing.approach_m
    before_m = min(max(way_m, END_CLEARANCE_M), length_m - END_CLEARANCE_M)
    far_m = graph.sidewalks[crossing.opposite].length_m / 2
    onward_m = trip.speed_m_s * timing.max_ticks * timing.tick_s
    first = WalkLeg((crossing.sidewalk, crossing.opposite), far_m)
    return replace(
        trip,
        edge=crossing.sidewalk,
        start_m=length_m - before_m if crossing.at_end else before_m,
        legs=(first, *_draw_legs(graph, crossing.opposite, far_m, onward_m, draw)),
        crosses=True,
    )


def _draw_trip(
    spec: Spec,
    graph: LaneGraph,
    people: Mapping[str, Blueprint],
    number: int,
    redraws: int,
    starts: Sequence[tuple[SumoLane, float]],
    start: tuple[SumoLane, float],
) -> PedestrianTrip:
    draw = create_generator(spec.seeds.traffic, "walker", number, *([redraws] if redraws else []))
    lane, start_m = starts[int(draw.integers(len(starts)))] if redraws else start
    # People without a fraction are drawn first, for everyone, so fractions move no other person.
    usual = [name for name, item in people.items() if item.fraction is None] or list(people)
    name = usual[draw.integers(len(usual))]
    name = draw_by_fraction(people, spec.seeds.traffic, "walker fraction", number) or name
    paint = draw_paint("pedestrian", spec.seeds.traffic, number)
    speed = float(draw.uniform(MIN_WALKING_SPEED_M_S, MAX_WALKING_SPEED_M_S))
    distance = speed * spec.timing.max_ticks * spec.timing.tick_s
    return PedestrianTrip(
        actor=Actor.from_blueprint(number, name, spec.blueprints[name], paint),
        edge=lane.edge,
        start_m=start_m,
        legs=tuple(_draw_legs(graph, lane.edge, start_m, distance, draw)),
        speed_m_s=speed,
    )


def _draw_legs(
    graph: LaneGraph,
    edge: str,
    position_m: float,
    distance_m: float,
    draw: np.random.Generator,
) -> Iterator[WalkLeg]:
    """Draw legs to random destinations until they add up to a distance."""
    names = sorted(_find_shortest_chains(graph.adjacent_sidewalks, edge))
    lengths = np.array([graph.sidewalks[name].length_m for name in names])
    while distance_m > 0:
        target = names[draw.choice(len(names), p=lengths / lengths.sum())]
        room = graph.sidewalks[target].length_m - 2 * END_CLEARANCE_M
        end = END_CLEARANCE_M + float(draw.uniform(0, max(room, 0.0)))
        edges = _find_shortest_chains(graph.adjacent_sidewalks, edge)[target]
        if target == edge and abs(end - position_m) < min(MIN_LEG_M, room / 4):
            continue  # hardly a walk: draw another destination
        yield WalkLeg(edges, end)
        between = sum(graph.sidewalks[name].length_m for name in edges[1:-1])
        distance_m -= abs(end - position_m) if target == edge else max(between, 1.0)
        edge, position_m = target, end


def _find_shortest_chains(
    adjacent: Mapping[str, tuple[str, ...]], start: str
) -> dict[str, tuple[str, ...]]:
    """Find the shortest chain of sidewalks from one to every connected one."""
    chains: dict[str, tuple[str, ...]] = {start: (start,)}
    queue = [start]
    for edge in queue:  # breadth first: the list grows while it is read
        new = [name for name in adjacent[edge] if name not in chains]
        chains.update({name: (*chains[edge], name) for name in new})
        queue.extend(new)
    return chains
