"""Lanes of a SUMO network and how they connect, and shortest routes over them."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from heapq import heappop, heappush
from operator import attrgetter
from pathlib import Path

import numpy as np

from advercity.errors import InputError
from advercity.roads.network_file import (
    LaneConnection,
    SignalProgram,
    SumoLane,
    read_network,
)

MAX_LANE_DISTANCE_M = 3.5
"""Between a declared pose and the centre line of its lane; a lane's width."""


LAST_START_S = 3.0
"""Time of green that a pedestrian who sets foot on a crossing still needs."""


@dataclass(frozen=True, eq=False)
class StreetCrossing:
    """A way from a sidewalk over one crossing to another sidewalk.

    Attributes:
        sidewalk: Edge of the first sidewalk.
        opposite: Edge of the other one.
        at_end: Whether it leads over the end of the first sidewalk rather than its begin.
        approach_m: Distance from there to the crossing.
        signal: Program and index of the light that governs it; None without a light.
    """

    sidewalk: str
    opposite: str
    at_end: bool
    approach_m: float
    signal: tuple[SignalProgram, int] | None

    def find_green_s(self, from_s: float) -> float:
        """Find the first time from which pedestrians have green for long enough to set out."""
        if self.signal is None:
            return from_s
        program, link = self.signal
        green_s = program.find_next_green_s(link, from_s)
        last_s = green_s + LAST_START_S
        next_s = program.find_next_green_s(link, last_s)
        return green_s if next_s == last_s else next_s


@dataclass(frozen=True, eq=False)
class LaneGraph:
    """All lanes of a network by id, in file order, how they connect, and its lights by id."""

    lanes: Mapping[str, SumoLane]
    connections: tuple[LaneConnection, ...]
    programs: Mapping[str, SignalProgram] = field(default_factory=dict[str, SignalProgram])

    @cached_property
    def driving_lanes(self) -> tuple[SumoLane, ...]:
        """Driving lanes between junctions, in the order of the file."""
        return tuple(lane for lane in self.lanes.values() if lane.is_driving_lane)

    @cached_property
    def sidewalks(self) -> Mapping[str, SumoLane]:
        """Sidewalks by edge; of two on one edge SUMO uses the right one."""
        found: dict[str, SumoLane] = {}
        for lane in self.lanes.values():
            if lane.is_sidewalk:
                found.setdefault(lane.edge, lane)
        return found

    @cached_property
    def shortest_lane_m(self) -> Mapping[str, float]:
        """Length of the shortest lane of every edge."""
        found: dict[str, float] = {}
        for lane in self.lanes.values():
            found[lane.edge] = min(lane.length_m, found.get(lane.edge, lane.length_m))
        return found

    @cached_property
    def driving_connections(self) -> tuple[LaneConnection, ...]:
        """Connections between driving lanes, without turning around, in file order."""
        driving = {lane.id for lane in self.driving_lanes}
        return tuple(
            link
            for link in self.connections
            if link.direction != "t" and {link.origin, link.target} <= driving
        )

    @cached_property
    def _links_by_edge(self) -> Mapping[str, list[LaneConnection]]:
        return _group(self.driving_connections, attrgetter("from_edge"))

    @cached_property
    def entry_lanes(self) -> tuple[SumoLane, ...]:
        """Driving lanes from the edge of the site."""
        entered = {link.to_edge for link in self.driving_connections}
        return tuple(lane for lane in self.driving_lanes if lane.edge not in entered)

    def find_lane(self, point: tuple[float, float], heading_rad: float) -> tuple[SumoLane, float]:
        """Find the driving lane at a point within 60 degrees of a heading, and the position on it.

        Raises:
            InputError: No such lane is within a lane's width.
        """
        found = [(*lane.line.project_point(point)[::-1], lane) for lane in self.driving_lanes]
        fitting = [
            (distance, position, lane)
            for distance, position, lane in found
            if distance < MAX_LANE_DISTANCE_M
            and np.cos(lane.line.headings_at(position) - heading_rad) > np.cos(np.pi / 3)
        ]
        if not fitting:
            raise InputError(
                f"no driving lane at {point[0]:g}, {point[1]:g} leads"
                f" {np.degrees(heading_rad):g} degrees from east; move or turn the vehicle"
            )
        _, position, lane = min(fitting, key=lambda item: item[0])
        return lane, position

    def find_connection(self, lane: SumoLane, edge: str) -> LaneConnection:
        """Find a connection into an edge, from this lane rather than from its neighbours."""
        links = [link for link in self._links_by_edge[lane.edge] if link.to_edge == edge]
        return min(links, key=lambda link: link.origin != lane.id)

    def iterate_internal_lanes(self, connection: LaneConnection) -> Iterator[SumoLane]:
        """Yield the lanes of a connection inside the junction."""
        step = connection
        while step.via is not None:
            yield self.lanes[step.via]
            step = next(other for other in self.connections if other.origin == step.via)

    def find_successor_edges(self, edge: str, *, straight_first: bool = False) -> tuple[str, ...]:
        """List the edges after an edge, in file order or straight ones first."""
        links = self._links_by_edge.get(edge, [])
        if straight_first:
            links = sorted(links, key=lambda link: link.direction != "s")
        return tuple(dict.fromkeys(link.to_edge for link in links))

    def find_successor_lanes(self, lane: SumoLane) -> tuple[SumoLane, ...]:
        """List lanes to continue in, one per edge; the neighbours' where this lane ends."""
        links = self._links_by_edge.get(lane.edge, [])
        own = [link for link in links if link.origin == lane.id] or links
        # The first connection into an edge counts, but edges come in the order of their last:
        # random draws pick by position, so the order must stay.
        return tuple({link.to_edge: self.lanes[link.target] for link in reversed(own)}.values())

    @cached_property
    def _footsteps(self) -> Mapping[str, list[LaneConnection]]:
        """Connections onto and off walking areas and crossings, by the lane before."""
        footways = [link for link in self.connections if self._is_footway_connection(link)]
        # SUMO lists a footway once, but pedestrians walk in both directions.
        back = [replace(link, origin=link.target, target=link.origin) for link in footways]
        return _group(footways + back, attrgetter("origin"))

    @cached_property
    def adjacent_sidewalks(self) -> Mapping[str, tuple[str, ...]]:
        """Next edges with a sidewalk of each sidewalk, without a crossing between."""
        return {
            edge: tuple(sorted(self._find_reachable_sidewalks(lane.id) - {edge}))
            for edge, lane in self.sidewalks.items()
        }

    @cached_property
    def street_crossings(self) -> tuple[StreetCrossing, ...]:
        """Ways from each sidewalk over one crossing to another."""
        adjacent = self.adjacent_sidewalks
        found = {
            (edge, other): crossing
            for edge in sorted(self.sidewalks)
            for area in self._list_steps(self.sidewalks[edge].id, "walkingarea")
            for crossing in self._list_steps(area.id, "crossing")
            for beyond in self._list_steps(crossing.id, "walkingarea")
            for other in sorted(self._find_reachable_sidewalks(beyond.id))
            if other not in (edge, *adjacent[edge])
        }
        return tuple(self._locate_crossing(*edges, found[edges]) for edges in sorted(found))

    def _list_steps(self, lane: str, function: str) -> list[SumoLane]:
        lanes = (self.lanes[link.target] for link in self._footsteps.get(lane, ()))
        return [lane for lane in lanes if lane.function == function]

    def _locate_crossing(self, edge: str, opposite: str, crossing: SumoLane) -> StreetCrossing:
        own, middle = self.sidewalks[edge].shape[[0, -1], :2], crossing.shape[[0, -1], :2]
        begin_m, end_m = np.linalg.norm(own[:, None] - middle, axis=2).min(axis=1).tolist()
        signals = (
            (self.programs[link.traffic_light], link.link_index)
            for link in self.connections
            if link.target == crossing.id and link.traffic_light
        )
        return StreetCrossing(
            edge, opposite, end_m < begin_m, min(begin_m, end_m), next(signals, None)
        )

    def _is_footway_connection(self, link: LaneConnection) -> bool:
        ends = (self.lanes[link.origin], self.lanes[link.target])
        return any(lane.function in ("walkingarea", "crossing") for lane in ends)

    def _find_reachable_sidewalks(self, start: str) -> set[str]:
        seen, todo, found = {start}, [start], set[str]()
        while todo:
            for link in self._footsteps.get(todo.pop(), ()):
                lane = self.lanes[link.target]
                if lane.id in seen or lane.function == "crossing":
                    continue
                seen.add(lane.id)
                if lane.is_sidewalk and lane is self.sidewalks[lane.edge]:
                    found.add(lane.edge)
                # On streets without a sidewalk, SUMO lets pedestrians walk on the roadway.
                elif lane.function != "normal":
                    todo.append(lane.id)
        return found


def read_lane_graph(path: Path) -> LaneGraph:
    """Read the lanes of a SUMO network file; RunError if it is none.

    Where a street leaves the site SUMO lets pedestrians walk around its end; here they cannot.
    """
    network = read_network(path)
    dead_ends = {item.id for item in network.junctions if item.type == "dead_end"}
    lanes = {
        lane.id: lane
        for edge in network.edges
        if edge.junction not in dead_ends
        for lane in edge.lanes
    }
    known = (link for link in network.connections if {link.origin, link.target} <= lanes.keys())
    programs = {program.light: program for program in network.programs}
    return LaneGraph(lanes, tuple(known), programs)


def _group(
    links: Iterable[LaneConnection], key: Callable[[LaneConnection], str]
) -> dict[str, list[LaneConnection]]:
    groups: dict[str, list[LaneConnection]] = {}
    for link in links:
        groups.setdefault(key(link), []).append(link)
    return groups


MAX_DESTINATION_GAP_M = 10.0
"""Largest distance between the end of a route and the destination."""
DESTINATION_TIE_M = 0.5
"""Lanes ending up to this much further from the destination than the nearest compete in length."""
MAX_ROUTE_EDGES = 100
"""Bound on a route in circles."""


def find_shortest_route(
    graph: LaneGraph, start: SumoLane, position_m: float, destination: tuple[float, float]
) -> tuple[str, ...]:
    """Find the shortest route from a position on a lane to a point, and on to the edge of the site.

    Beyond the destination it goes straight on wherever it can. The result are edges' ids.

    Raises:
        InputError: No route leads near the destination.
    """
    routes = _compute_routes_from(graph, start.edge)
    ends = list(_find_arrivals(graph, routes, start, position_m, destination))
    if not ends or min(gap for gap, _, _ in ends) > MAX_DESTINATION_GAP_M:
        raise InputError(
            f"no route leads from lane {start.id} to {destination[0]:g}, {destination[1]:g};"
            " move the destination onto a reachable lane, or turn the vehicle"
        )
    nearest = min(gap for gap, _, _ in ends)
    _, edge = min((cost, edge) for gap, cost, edge in ends if gap <= nearest + DESTINATION_TIE_M)
    return extend_route(graph, routes[edge][1])


def _compute_routes_from(graph: LaneGraph, start: str) -> dict[str, tuple[float, tuple[str, ...]]]:
    """Compute, for every reachable edge, the length to its start and the edges to it.

    Dijkstra's algorithm; ids order equal lengths, so results are the same everywhere.
    """
    lengths = {lane.edge: lane.length_m for lane in graph.driving_lanes}
    found: dict[str, tuple[float, tuple[str, ...]]] = {}
    todo: list[tuple[float, tuple[str, ...]]] = [(0.0, (start,))]
    # The heap compares edge ids after lengths, so ties never depend on the order of the file.
    while todo:
        cost, edges = heappop(todo)
        if edges[-1] not in found:
            found[edges[-1]] = cost, edges
            for onward in graph.find_successor_edges(edges[-1]):
                heappush(todo, (cost + lengths[edges[-1]], (*edges, onward)))
    return found


def _find_arrivals(
    graph: LaneGraph,
    routes: dict[str, tuple[float, tuple[str, ...]]],
    start: SumoLane,
    position_m: float,
    destination: tuple[float, float],
) -> Iterator[tuple[float, float, str]]:
    """Yield the distance to the destination, the length of the route and the edge of every lane."""
    for lane in graph.driving_lanes:
        if lane.edge in routes:
            at, gap = lane.line.project_point(destination)
            if lane.edge != start.edge or at >= position_m:
                yield gap, routes[lane.edge][0] + at, lane.edge


def extend_route(graph: LaneGraph, edges: tuple[str, ...]) -> tuple[str, ...]:
    """Extend a route to the edge of the site, straight on where possible."""
    while len(edges) < MAX_ROUTE_EDGES and (
        onward := graph.find_successor_edges(edges[-1], straight_first=True)
    ):
        edges = (*edges, onward[0])
    return edges
