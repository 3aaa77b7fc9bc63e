"""Finds the way of a vehicle of which only start and destination are declared."""

from collections.abc import Iterator
from heapq import heappop, heappush

from advercity.errors import InputError
from advercity.traffic.lanes import Lane, LaneGraph

FARTHEST_M = 10.0
"""From the end of the way to the destination; nearer ones count as reached."""
SAME_PLACE_M = 0.5
MOST_EDGES = 100


def shortest_way(
    graph: LaneGraph, start: Lane, position_m: float, destination: tuple[float, float]
) -> tuple[str, ...]:
    """Edges from a position on a lane to a point by the shortest way, and on from there.

    Beyond the destination it goes straight on wherever it can, to the edge of the site.

    Raises:
        InputError: No way leads near the destination.
    """
    ways = _ways(graph, start.edge)
    ends = list(_ends(graph, ways, start, position_m, destination))
    if not ends or min(gap for gap, _, _ in ends) > FARTHEST_M:
        raise InputError(
            f"no way leads from lane {start.id} to {destination[0]:g}, {destination[1]:g};"
            " move the destination onto a lane that can be reached, or turn the vehicle"
        )
    nearest = min(gap for gap, _, _ in ends)
    _, edge = min((cost, edge) for gap, cost, edge in ends if gap <= nearest + SAME_PLACE_M)
    return _extended(graph, ways[edge][1])


def _ways(graph: LaneGraph, start: str) -> dict[str, tuple[float, tuple[str, ...]]]:
    """Length to the beginning of every edge that can be reached, and the edges there."""
    lengths = {lane.edge: lane.length_m for lane in graph.driven}
    found: dict[str, tuple[float, tuple[str, ...]]] = {}
    todo: list[tuple[float, tuple[str, ...]]] = [(0.0, (start,))]
    while todo:
        cost, edges = heappop(todo)
        if edges[-1] not in found:
            found[edges[-1]] = cost, edges
            for onward in graph.edges_after(edges[-1]):
                heappush(todo, (cost + lengths[edges[-1]], (*edges, onward)))
    return found


def _ends(
    graph: LaneGraph,
    ways: dict[str, tuple[float, tuple[str, ...]]],
    start: Lane,
    position_m: float,
    destination: tuple[float, float],
) -> Iterator[tuple[float, float, str]]:
    """Distance to the destination, length of the way, and edge, for every lane to arrive in."""
    for lane in graph.driven:
        if lane.edge in ways:
            at, gap = lane.nearest(destination)
            if lane.edge != start.edge or at >= position_m:
                yield gap, ways[lane.edge][0] + at, lane.edge


def _extended(graph: LaneGraph, edges: tuple[str, ...]) -> tuple[str, ...]:
    while len(edges) < MOST_EDGES and (onward := graph.edges_after(edges[-1], straight_first=True)):
        edges = (*edges, onward[0])
    return edges
