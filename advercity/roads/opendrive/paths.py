"""Ways through junctions, lane by lane: over connecting roads, or directly from road to road."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from advercity.geometry.polyline import Points
from advercity.roads.opendrive.document import Connection, Junction, OpenDriveMap
from advercity.roads.opendrive.links import StretchEnd, StretchIndex, leads_out

LaneEnd = tuple[StretchEnd, int]
"""A lane at one end of a stretch, by its id there."""


@dataclass(frozen=True, eq=False)
class JunctionPath:
    """A way from a lane into a lane, in the direction of travel.

    Attributes:
        junction: Id of the junction.
        road: Id of the connecting road; empty where the roads touch.
        origin: The lane that it leaves.
        target: The lane that it enters.
        centre: (n, 3) its middle; two equal points where the roads touch.
    """

    junction: str
    road: str
    origin: LaneEnd
    target: LaneEnd
    centre: Points


class PathFinder:
    """Finds the paths through the junctions of a map."""

    def __init__(self, document: OpenDriveMap, index: StretchIndex) -> None:
        self._document = document
        self._index = index

    def list_paths(self, junction: Junction) -> Iterator[JunctionPath]:
        """List the paths through a junction, each once."""
        seen: set[tuple[LaneEnd, LaneEnd]] = set()
        for connection in junction.connections:
            find = self._list_direct if connection.is_direct else self._list_connecting
            for path in find(junction, connection):
                key = (path.origin, path.target)
                if key not in seen:
                    seen.add(key)
                    yield path

    def _list_direct(self, junction: Junction, connection: Connection) -> Iterator[JunctionPath]:
        linked = self._index.find_end(connection.road, connection.contact)
        incoming = None if linked is None else self._find_arm(junction, connection, linked)
        if linked is None or incoming is None:
            return
        pairs = connection.lane_links or self._index.link(incoming, linked).lanes
        for lane, target in pairs:
            ends = (incoming, lane), (linked, target)
            if not all(self._is_driven(end) for end in ends):
                continue
            origin, entered = ends if leads_out(*ends[0]) else ends[::-1]
            touch = np.stack([self._middle(origin)[-1], self._middle(entered)[0]])
            yield JunctionPath(junction.id, "", origin, entered, touch)

    def _list_connecting(
        self, junction: Junction, connection: Connection
    ) -> Iterator[JunctionPath]:
        near = self._index.find_end(connection.road, connection.contact)
        arm = None if near is None else self._find_arm(junction, connection, near)
        if near is None or arm is None:
            return
        links = connection.lane_links or tuple(
            (outer, inner) for inner, outer in self._index.link(near, arm, is_mutual=False).lanes
        )
        for outer, inner in links:
            if not (self._is_driven((arm, outer)) and self._is_driven((near, inner))):
                continue
            for far, centre in self._trace((near, inner)):
                ends = ((arm, outer), far)
                origin, target = ends if leads_out(arm, outer) else ends[::-1]
                line = centre if leads_out(arm, outer) else centre[::-1]
                if self._is_driven(far) and leads_out(*origin) != leads_out(*target):
                    yield JunctionPath(junction.id, connection.road, origin, target, line)

    def _find_arm(
        self, junction: Junction, connection: Connection, near: StretchEnd
    ) -> StretchEnd | None:
        """Find the end of the incoming road that leads to the junction."""
        road = self._index.stretches[near.stretch].road
        link = road.get_link(connection.contact)
        if link is not None and link.id == connection.incoming_road and not connection.is_direct:
            return self._index.find_end(link.id, link.contact)
        incoming = self._document.roads.get(connection.incoming_road)
        if incoming is None:
            return None
        ends: list[StretchEnd] = []
        for contact in ("start", "end"):
            found = incoming.get_link(contact)
            end = self._index.find_end(incoming.id, contact)
            if end is not None and found is not None and found.id == junction.id:
                ends.append(end)
        places = [np.linalg.norm(self._place(end) - self._place(near)) for end in ends]
        return ends[int(np.argmin(places))] if ends else None

    def _trace(self, start: LaneEnd) -> Iterator[tuple[LaneEnd, Points]]:
        """Follow a lane of a connecting road to the lanes behind its other end.

        Yields those lanes, and the middle of the path (n, 3) from the start.
        """
        pending: list[tuple[LaneEnd, list[Points], int]] = [(start, [], 0)]
        while pending:
            (end, lane), lines, depth = pending.pop()
            middle = self._middle((end, lane))
            lines = [*lines, middle if end.contact == "start" else middle[::-1]]
            far = end.opposite
            for following in self._list_following(far):
                inside = self._is_connecting(following)
                for one, other in self._index.link(far, following, is_mutual=inside).lanes:
                    if one != lane:
                        continue
                    if not inside:
                        yield (following, other), np.concatenate(lines)
                    elif depth < len(self._index.stretches):
                        pending.append(((following, other), lines, depth + 1))

    def _list_following(self, end: StretchEnd) -> Iterator[StretchEnd]:
        """List the ends that a connecting road's end touches."""
        stretch = self._index.stretches[end.stretch]
        if self._index.find_end(stretch.road.id, end.contact) != end:
            step, contact = (1, "start") if end.contact == "end" else (-1, "end")
            yield StretchEnd(end.stretch + step, contact)
            return
        link = stretch.road.get_link(end.contact)
        found = None if link is None else self._index.find_end(link.id, link.contact)
        if found is not None and link is not None and link.element_type == "road":
            yield found

    def _is_connecting(self, end: StretchEnd) -> bool:
        return self._document.is_connecting(self._index.stretches[end.stretch].road)

    def _is_driven(self, lane: LaneEnd) -> bool:
        ribbon = self._index.stretches[lane[0].stretch].ribbons.get(lane[1])
        return ribbon is not None and not (ribbon.use.is_closed or ribbon.use.is_walked)

    def _middle(self, lane: LaneEnd) -> Points:
        """Compute the middle (n, 3) of a lane in the direction of stations."""
        ribbon = self._index.stretches[lane[0].stretch].ribbons[lane[1]]
        return (ribbon.left + ribbon.right) / 2

    def _place(self, end: StretchEnd) -> Points:
        """Compute the middle (2,) of the lanes at an end."""
        at = 0 if end.contact == "start" else -1
        ribbons = self._index.stretches[end.stretch].ribbons.values()
        points = [line[at, :2] for item in ribbons for line in (item.left, item.right)]
        return np.mean(points, axis=0) if points else np.full(2, np.inf)
