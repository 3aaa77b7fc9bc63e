"""Draw pedestrians' trips over the sidewalks of the site, some of them across streets."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from advercity_dsl import Blueprint, Spec

from advercity.frames import Actor
from advercity.randomness import create_generator
from advercity.roads.capacity import WALKER_SPACING_M
from advercity.roads.lane_graph import LaneGraph
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
    spec: Spec, graph: LaneGraph, count: int, redraws: Mapping[int, int]
) -> tuple[PedestrianTrip, ...]:
    """Draw the trips of people on foot.

    Args:
        spec: The scenario.
        graph: Lanes of the road.
        count: Number of people; fewer are drawn if the sidewalks are full.
        redraws: Number of draws to pass over, by id of a person.
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
    return tuple(
        _draw_trip(spec, graph, adjacent, people, number, redraws.get(number, 0), starts, start)
        for number, start in enumerate(starts[:count], FIRST_BACKGROUND_WALKER)
    )


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
    crosses = bool(draw.random() < spec.demand.crossing_share)
    speed = float(draw.uniform(MIN_WALKING_SPEED_M_S, MAX_WALKING_SPEED_M_S))
    distance = speed * spec.timing.max_ticks * spec.timing.tick_s
    return PedestrianTrip(
        actor=Actor.from_blueprint(number, name, spec.blueprints[name], paint),
        edge=lane.edge,
        start_m=start_m,
        legs=tuple(_draw_legs(graph, adjacent[crosses], lane.edge, start_m, distance, draw)),
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
