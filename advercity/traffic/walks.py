"""Where people walk: over the sidewalks of the site, some of them across streets."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from advercity_dsl import Spec

from advercity.randomness import generator
from advercity.traffic.lanes import Lane, LaneGraph
from advercity.traffic.placement import WALKER_GRID_M, areas, grid
from advercity.traffic.trace import Actor
from advercity.world.bodies import paint_for

FIRST_WALKER = 5001
SLOWEST_M_S, FASTEST_M_S = 1.0, 2.0
SHORTEST_LEG_M = 5.0
END_CLEARANCE_M = 0.5

Beside = Mapping[str, tuple[str, ...]]


@dataclass(frozen=True)
class Leg:
    """Sidewalks (edges) up to the next place to turn, and where on the last one that is."""

    edges: tuple[str, ...]
    end_m: float


@dataclass(frozen=True)
class Walk:
    """A person's way: from place to place, longer than the scenario can last."""

    actor: Actor
    edge: str
    start_m: float
    legs: tuple[Leg, ...]
    speed_m_s: float
    depart_s: float = 0.0


def walks(spec: Spec, graph: LaneGraph, count: int, again: Mapping[int, int]) -> tuple[Walk, ...]:
    """Up to `count` people on foot; fewer if the sidewalks are full.

    Args:
        spec: The scenario.
        graph: Lanes of the road.
        count: How many are wanted.
        again: How many draws of a person are passed over, by id.
    """
    starts = list(grid(graph.sidewalks.values(), areas(spec), WALKER_GRID_M))
    generator(spec.seeds.traffic, "walker places").shuffle(starts)
    people = [name for name, item in spec.blueprints.items() if item.actor_class == "pedestrian"]
    if not people:
        return ()
    beside = {crossing: graph.beside(crossing=crossing) for crossing in (False, True)}
    return tuple(
        _walk(spec, graph, beside, people, number, again.get(number, 0), starts, start)
        for number, start in enumerate(starts[:count], FIRST_WALKER)
    )


def _walk(
    spec: Spec,
    graph: LaneGraph,
    beside: Mapping[bool, Beside],
    people: list[str],
    number: int,
    again: int,
    starts: Sequence[tuple[Lane, float]],
    start: tuple[Lane, float],
) -> Walk:
    draw = generator(spec.seeds.traffic, "walker", number, *([again] if again else []))
    lane, start_m = starts[int(draw.integers(len(starts)))] if again else start
    name = people[draw.integers(len(people))]
    blueprint = spec.blueprints[name]
    crosses = bool(draw.random() < spec.demand.crossing_share)
    speed = float(draw.uniform(SLOWEST_M_S, FASTEST_M_S))
    distance = speed * spec.timing.max_ticks * spec.timing.tick_s
    return Walk(
        actor=Actor(
            number,
            "pedestrian",
            name,
            paint_for("pedestrian", spec.seeds.traffic, number),
            (blueprint.length_m, blueprint.width_m, blueprint.height_m),
        ),
        edge=lane.edge,
        start_m=start_m,
        legs=tuple(_legs(graph, beside[crosses], lane.edge, start_m, distance, draw)),
        speed_m_s=speed,
    )


def _legs(
    graph: LaneGraph,
    beside: Beside,
    edge: str,
    position_m: float,
    distance_m: float,
    draw: np.random.Generator,
) -> Iterator[Leg]:
    """Legs to random places until at least `distance_m` is walked."""
    ways = _ways(beside, edge)
    names = sorted(ways)
    lengths = np.array([graph.sidewalks[name].length_m for name in names])
    while distance_m > 0:
        target = names[draw.choice(len(names), p=lengths / lengths.sum())]
        room = graph.sidewalks[target].length_m - 2 * END_CLEARANCE_M
        end = END_CLEARANCE_M + float(draw.uniform(0, max(room, 0.0)))
        edges = _ways(beside, edge)[target]
        if target == edge and abs(end - position_m) < min(SHORTEST_LEG_M, room / 4):
            continue
        yield Leg(edges, end)
        between = sum(graph.sidewalks[name].length_m for name in edges[1:-1])
        distance_m -= abs(end - position_m) if target == edge else max(between, 1.0)
        edge, position_m = target, end


def _ways(beside: Beside, start: str) -> dict[str, tuple[str, ...]]:
    """Shortest chains of sidewalks from `start` to all it is joined with, itself included."""
    found: dict[str, tuple[str, ...]] = {start: (start,)}
    todo = [start]
    for edge in todo:
        new = [name for name in beside[edge] if name not in found]
        found.update({name: (*found[edge], name) for name in new})
        todo.extend(new)
    return found
