"""Draw pedestrians' trips over the sidewalks of the site, some of them across streets."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from advercity_dsl import Blueprint, Spec
from numpy.typing import NDArray

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
MAX_CROSSING_DRAWS = 2
"""A person who still is in the way after that many draws does not cross."""
CROSSING_WINDOW_S = 8.0
"""People who cross a street come to it within this time from the begin of the recording."""

AdjacentSidewalks = Mapping[str, tuple[str, ...]]


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


def draw_pedestrian_trips(
    spec: Spec,
    graph: LaneGraph,
    count: int,
    redraws: Mapping[int, int],
    *,
    crossing_share: float | None = None,
) -> tuple[PedestrianTrip, ...]:
    """Draw the trips of people on foot.

    Those who cross a street start so near to it that they can be there soon after the recording
    begins.

    Args:
        spec: The scenario.
        graph: Lanes of the road.
        count: Number of people; fewer are drawn if the sidewalks are full.
        redraws: Number of draws to pass over, by id of a person.
        crossing_share: Fraction of the people who set out to cross; None is the declared one.
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
    adjacent = {
        crossing: graph.find_adjacent_sidewalks(use_crossings=crossing)
        for crossing in (False, True)
    }
    trips = [
        _draw_trip(spec, graph, adjacent, people, number, redraws.get(number, 0), starts, start)
        for number, start in enumerate(starts[:count], FIRST_BACKGROUND_WALKER)
    ]
    share = spec.demand.crossing_share if crossing_share is None else crossing_share
    kerbs = _KerbPlaces(spec, graph)
    return tuple(
        kerbs.send_across(trip, adjacent[True], redraws.get(trip.actor.id, 0))
        if redraws.get(trip.actor.id, 0) < MAX_CROSSING_DRAWS
        and _draw_inclination(spec, trip) < share
        else trip
        for trip in trips
    )


def _draw_inclination(spec: Spec, trip: PedestrianTrip) -> float:
    """Draw the share from which on a person is one of those who cross."""
    return float(create_generator(spec.seeds.traffic, "crossing", trip.actor.id).random())


class _KerbPlaces:
    """Places from which people come to the crossings of a site; each is taken once."""

    def __init__(self, spec: Spec, graph: LaneGraph) -> None:
        self._spec, self._graph = spec, graph
        areas = compute_start_areas(spec)
        self._crossings = [
            item
            for item in graph.street_crossings
            if any(area.contains(self._locate_end(item)).any() for area in areas)
        ]
        self._taken = set[tuple[str, float]]()

    def _locate_end(self, crossing: StreetCrossing) -> NDArray[np.float64]:
        return self._graph.sidewalks[crossing.sidewalk].shape[[-1 if crossing.at_end else 0], :2]

    def send_across(
        self, trip: PedestrianTrip, adjacent: AdjacentSidewalks, redraws: int
    ) -> PedestrianTrip:
        """Return the trip of a person who first crosses a street; as it is where none can be."""
        timing = self._spec.timing
        draw = create_generator(self._spec.seeds.traffic, "crosses", trip.actor.id, redraws)
        for at in draw.permutation(len(self._crossings)).tolist():
            crossing = self._crossings[at]
            after_s = timing.warm_up_ticks * timing.tick_s + draw.uniform(0, CROSSING_WINDOW_S)
            length_m = self._graph.sidewalks[crossing.sidewalk].length_m
            before_m = min(float(round(trip.speed_m_s * after_s)), length_m - END_CLEARANCE_M)
            start_m = length_m - before_m if crossing.at_end else before_m
            if (crossing.sidewalk, start_m) not in self._taken:
                self._taken.add((crossing.sidewalk, start_m))
                far_m = self._graph.sidewalks[crossing.opposite].length_m / 2
                way_m = trip.speed_m_s * timing.max_ticks * timing.tick_s
                onward = _draw_legs(self._graph, adjacent, crossing.opposite, far_m, way_m, draw)
                first = WalkLeg((crossing.sidewalk, crossing.opposite), far_m)
                return replace(trip, edge=crossing.sidewalk, start_m=start_m, legs=(first, *onward))
        return trip


def _draw_trip(
    spec: Spec,
    graph: LaneGraph,
    adjacent: Mapping[bool, AdjacentSidewalks],
    people: Mapping[str, Blueprint],
    number: int,
    redraws: int,
    starts: Sequence[tuple[SumoLane, float]],
    start: tuple[SumoLane, float],
) -> PedestrianTrip:
    draw = create_generator(spec.seeds.traffic, "walker", number, *([redraws] if redraws else []))
    lane, start_m = starts[int(draw.integers(len(starts)))] if redraws else start
    # Who has no fraction is drawn first and for everyone, so that fractions move nobody else.
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
        legs=tuple(_draw_legs(graph, adjacent[False], lane.edge, start_m, distance, draw)),
        speed_m_s=speed,
    )


def _draw_legs(
    graph: LaneGraph,
    adjacent: AdjacentSidewalks,
    edge: str,
    position_m: float,
    distance_m: float,
    draw: np.random.Generator,
) -> Iterator[WalkLeg]:
    """Draw legs to random destinations until they add up to a distance."""
    names = sorted(_find_shortest_chains(adjacent, edge))
    lengths = np.array([graph.sidewalks[name].length_m for name in names])
    while distance_m > 0:
        target = names[draw.choice(len(names), p=lengths / lengths.sum())]
        room = graph.sidewalks[target].length_m - 2 * END_CLEARANCE_M
        end = END_CLEARANCE_M + float(draw.uniform(0, max(room, 0.0)))
        edges = _find_shortest_chains(adjacent, edge)[target]
        if target == edge and abs(end - position_m) < min(MIN_LEG_M, room / 4):
            continue  # hardly a walk: draw another destination
        yield WalkLeg(edges, end)
        between = sum(graph.sidewalks[name].length_m for name in edges[1:-1])
        distance_m -= abs(end - position_m) if target == edge else max(between, 1.0)
        edge, position_m = target, end


def _find_shortest_chains(adjacent: AdjacentSidewalks, start: str) -> dict[str, tuple[str, ...]]:
    """Find the shortest chain of sidewalks from one to each that it is connected with."""
    chains: dict[str, tuple[str, ...]] = {start: (start,)}
    queue = [start]
    for edge in queue:  # breadth first: the list grows while it is read
        new = [name for name in adjacent[edge] if name not in chains]
        chains.update({name: (*chains[edge], name) for name in new})
        queue.extend(new)
    return chains
