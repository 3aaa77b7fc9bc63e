"""The SUMO network as typed lanes: where they run, who may use them, and how they join.

Finds the way of a vehicle of which only start and destination are declared.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from heapq import heappop, heappush
from pathlib import Path

import numpy as np

from advercity.errors import InputError
from advercity.roads.network_file import LaneConnection, SumoLane, read_network

MAX_LANE_DISTANCE_M = 3.5
"""Between a declared pose and the centre line of its lane; a lane's width."""


@dataclass(frozen=True, eq=False)
class LaneGraph:
    """All lanes of a network and how they join."""

    lanes: Mapping[str, SumoLane]
    connections: tuple[LaneConnection, ...]

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
    def outgoing_connections(self) -> Mapping[str, tuple[LaneConnection, ...]]:
        """Joints that leave a driving lane, turning around left out."""
        return _group_by_origin(
            joint
            for joint in self.connections
            if joint.direction != "t"
            and self.lanes[joint.origin].is_driving_lane
            and self.lanes[joint.target].is_driving_lane
        )

    @cached_property
    def entry_lanes(self) -> tuple[SumoLane, ...]:
        """Driving lanes that begin at the edge of the site."""
        edges = {lane.edge for lane in self.driving_lanes}
        reached = {
            self.lanes[joint.target].edge
            for joints in self.outgoing_connections.values()
            for joint in joints
        }
        return tuple(lane for lane in self.driving_lanes if lane.edge in edges - reached)

    def find_lane(self, point: tuple[float, float], heading_rad: float) -> tuple[SumoLane, float]:
        """The driving lane at a point that leads within 60 degrees of a heading, and where on it.

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
        """A way into an edge: from this lane if there is one, else from a lane beside it."""
        ways = [
            joint
            for joints in self.outgoing_connections.values()
            for joint in joints
            if self.lanes[joint.origin].edge == lane.edge and self.lanes[joint.target].edge == edge
        ]
        return min(ways, key=lambda way: way.origin != lane.id)

    def iterate_internal_lanes(self, connection: LaneConnection) -> Iterator[SumoLane]:
        """Lanes inside the junction that a joint leads through."""
        step = connection
        while step.via is not None:
            yield self.lanes[step.via]
            step = next(other for other in self.connections if other.origin == step.via)

    def find_successor_edges(self, edge: str, *, straight_first: bool = False) -> tuple[str, ...]:
        """Edges that some lane of an edge leads into, as in the file or straight ones first."""
        ways = [
            joint
            for origin, joints in self.outgoing_connections.items()
            for joint in joints
            if self.lanes[origin].edge == edge
        ]
        if straight_first:
            ways.sort(key=lambda joint: joint.direction != "s")
        return tuple(dict.fromkeys(self.lanes[joint.target].edge for joint in ways))

    def find_successor_lanes(self, lane: SumoLane) -> tuple[SumoLane, ...]:
        """Lanes to go on in, one an edge: from this lane, or if it ends, from its neighbours."""
        targets = self._find_successor_targets(lane.edge, lane.id) or self._find_successor_targets(
            lane.edge, None
        )
        return tuple({target.edge: target for target in reversed(targets)}.values())

    def _find_successor_targets(self, edge: str, lane: str | None) -> list[SumoLane]:
        return [
            self.lanes[joint.target]
            for origin, joints in self.outgoing_connections.items()
            for joint in joints
            if self.lanes[origin].edge == edge and lane in (None, origin)
        ]

    def find_adjacent_sidewalks(self, *, use_crossings: bool) -> Mapping[str, tuple[str, ...]]:
        """Sidewalks (edges) one can walk into from each sidewalk, with or without crossings."""
        footways = [joint for joint in self.connections if self._is_footway_connection(joint)]
        back = [replace(joint, origin=joint.target, target=joint.origin) for joint in footways]
        steps = _group_by_origin(footways + back)
        return {
            edge: tuple(
                sorted(
                    self._find_reachable_sidewalks(lane.id, steps, crossing=use_crossings) - {edge}
                )
            )
            for edge, lane in self.sidewalks.items()
        }

    def _is_footway_connection(self, connection: LaneConnection) -> bool:
        on_foot = ("walkingarea", "crossing")
        return any(
            self.lanes[end].function in on_foot for end in (connection.origin, connection.target)
        )

    def _find_reachable_sidewalks(
        self, start: str, steps: Mapping[str, tuple[LaneConnection, ...]], *, crossing: bool
    ) -> set[str]:
        seen, todo, found = {start}, [start], set[str]()
        while todo:
            for joint in steps.get(todo.pop(), ()):
                lane = self.lanes[joint.target]
                if lane.id in seen or (lane.function == "crossing" and not crossing):
                    continue
                seen.add(lane.id)
                if lane.is_sidewalk:
                    if lane is self.sidewalks[lane.edge]:
                        found.add(lane.edge)
                else:
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
    return LaneGraph(lanes, tuple(known))


def _group_by_origin(joints: Iterable[LaneConnection]) -> dict[str, tuple[LaneConnection, ...]]:
    groups: dict[str, list[LaneConnection]] = {}
    for joint in joints:
        groups.setdefault(joint.origin, []).append(joint)
    return {origin: tuple(found) for origin, found in groups.items()}


MAX_DESTINATION_GAP_M = 10.0
"""From the end of the way to the destination; nearer ones count as reached."""
DESTINATION_TIE_M = 0.5
MAX_ROUTE_EDGES = 100


def find_shortest_route(
    graph: LaneGraph, start: SumoLane, position_m: float, destination: tuple[float, float]
) -> tuple[str, ...]:
    """Edges from a position on a lane to a point by the shortest way, and on from there.

    Beyond the destination it goes straight on wherever it can, to the edge of the site.

    Raises:
        InputError: No way leads near the destination.
    """
    ways = _compute_routes_from(graph, start.edge)
    ends = list(_find_arrivals(graph, ways, start, position_m, destination))
    if not ends or min(gap for gap, _, _ in ends) > MAX_DESTINATION_GAP_M:
        raise InputError(
            f"no way leads from lane {start.id} to {destination[0]:g}, {destination[1]:g};"
            " move the destination onto a lane that can be reached, or turn the vehicle"
        )
    nearest = min(gap for gap, _, _ in ends)
    _, edge = min((cost, edge) for gap, cost, edge in ends if gap <= nearest + DESTINATION_TIE_M)
    return _extend_route(graph, ways[edge][1])


def _compute_routes_from(graph: LaneGraph, start: str) -> dict[str, tuple[float, tuple[str, ...]]]:
    """Length to the beginning of every edge that can be reached, and the edges there."""
    lengths = {lane.edge: lane.length_m for lane in graph.driving_lanes}
    found: dict[str, tuple[float, tuple[str, ...]]] = {}
    todo: list[tuple[float, tuple[str, ...]]] = [(0.0, (start,))]
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
    """Distance to the destination, length of the way, and edge, for every lane to arrive in."""
    for lane in graph.driving_lanes:
        if lane.edge in routes:
            at, gap = lane.line.project_point(destination)
            if lane.edge != start.edge or at >= position_m:
                yield gap, routes[lane.edge][0] + at, lane.edge


def _extend_route(graph: LaneGraph, edges: tuple[str, ...]) -> tuple[str, ...]:
    while len(edges) < MAX_ROUTE_EDGES and (
        onward := graph.find_successor_edges(edges[-1], straight_first=True)
    ):
        edges = (*edges, onward[0])
    return edges
