"""Ways through junctions, lane by lane: over connecting roads, or directly from road to road."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from advercity.foreign.ledger import Ledger
from advercity.geometry.polyline import Points
from advercity.roads.opendrive.document import (
    CONTACTS,
    Connection,
    Contact,
    Junction,
    OpenDriveMap,
    RoadLink,
)
from advercity.roads.opendrive.links import StretchEnd, StretchIndex, leads_out

LaneEnd = tuple[StretchEnd, int]
"""A lane at one end of a stretch, by its id there."""
LanePairs = tuple[tuple[int, int], ...]


@dataclass(frozen=True, eq=False)
class JunctionPath:
    """A way from a lane into a lane, in the direction of travel.

    Attributes:
        junction: Id of the junction.
        road: Id of the connecting road; empty where the roads touch.
        origin: The lane at its start.
        target: The lane at its end.
        borders: (2, n, 3) its left and right border; None where the roads touch.
    """

    junction: str
    road: str
    origin: LaneEnd
    target: LaneEnd
    borders: Points | None


class PathFinder:
    """Finds the paths through the junctions of a map."""

    def __init__(self, document: OpenDriveMap, index: StretchIndex, ledger: Ledger) -> None:
        self._document = document
        self._ledger = ledger
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
            if leads_out(*origin) == leads_out(*entered):
                name = "lane link against the direction of traffic"
                self._ledger.leave_out(name, plural="lane links against the direction of traffic")
                continue
            yield JunctionPath(junction.id, "", origin, entered, None)

    def _list_connecting(
        self, junction: Junction, connection: Connection
    ) -> Iterator[JunctionPath]:
        near = self._find_near(connection)
        arm = None if near is None else self._find_arm(junction, connection, near)
        if near is None or arm is None:
            return
        links = connection.lane_links or tuple(
            (outer, inner) for inner, outer in self._index.link(near, arm, is_mutual=False).lanes
        )
        for outer, inner in links:
            if not (self._is_driven((arm, outer)) and self._is_driven((near, inner))):
                continue
            for far, borders in self._trace((near, inner)):
                leaves = leads_out(arm, outer)
                origin, target = ((arm, outer), far) if leaves else (far, (arm, outer))
                line = borders if leaves else borders[::-1, ::-1]
                if self._is_driven(far) and leads_out(*origin) != leads_out(*target):
                    yield JunctionPath(junction.id, connection.road, origin, target, line)

    def _find_near(self, connection: Connection) -> StretchEnd | None:
        """Find the end of a connecting road at the incoming road.

        If a contact point contradicts the links, the links count.
        """
        road = self._document.roads.get(connection.road)
        if road is None:
            return None
        linked: list[Contact] = [
            contact
            for contact in CONTACTS
            if (link := road.get_link(contact)) and link.id == connection.incoming_road
        ]
        contact = linked[0] if len(linked) == 1 else connection.contact
        return self._index.find_end(connection.road, contact)

    def _find_arm(
        self, junction: Junction, connection: Connection, near: StretchEnd
    ) -> StretchEnd | None:
        """Find the end of the incoming road at the junction."""
        link = self._index.stretches[near.stretch].road.get_link(near.contact)
        if link is not None and link.id == connection.incoming_road and not connection.is_direct:
            return self._find_linked(link, junction.id, near)
        return self._find_nearest(self._list_arms(junction.id, connection.incoming_road), near)

    def _find_linked(self, link: RoadLink, junction: str, near: StretchEnd) -> StretchEnd | None:
        """Find the end of a road to which an end in a junction is linked.

        If both ends are possible, or the contact point contradicts the road, it is the nearest.
        """
        arms = self._list_arms(junction, link.id)
        if len(arms) == 1:
            return arms[0]
        # The end named by the link comes first.
        said = self._index.find_end(link.id, link.contact)
        other = self._index.find_end(link.id, "end" if link.contact == "start" else "start")
        return self._find_nearest(arms or [end for end in (said, other) if end], near)

    def _list_arms(self, junction: str, road: str) -> list[StretchEnd]:
        found = self._document.roads.get(road)
        ends = [
            self._index.find_end(road, contact)
            for contact in CONTACTS
            if found and (link := found.get_link(contact)) and link.id == junction
        ]
        return [end for end in ends if end is not None]

    def _find_nearest(self, ends: Sequence[StretchEnd], near: StretchEnd) -> StretchEnd | None:
        """Find the end nearest to another; the first of several at one place."""
        places = [np.linalg.norm(self._place(end) - self._place(near)) for end in ends]
        return ends[int(np.argmin(np.floor(places)))] if ends else None

    def _trace(self, start: LaneEnd) -> Iterator[tuple[LaneEnd, Points]]:
        """Follow a lane of a connecting road to the lanes behind its other end.

        Yields those lanes, and the borders of the path (2, n, 3) from the start.
        """
        pending: list[tuple[LaneEnd, list[Points]]] = [(start, [])]
        seen = {start}
        while pending:
            (end, lane), lines = pending.pop()
            lines = [*lines, self._borders((end, lane))]
            for following, pairs in self._list_following(end.opposite):
                for one, other in pairs:
                    if one != lane:
                        continue
                    if not self._is_connecting(following):
                        yield (following, other), np.concatenate(lines, axis=1)
                    elif (following, other) not in seen and self._is_driven((following, other)):
                        seen.add((following, other))
                        pending.append(((following, other), lines))

    def _list_following(self, end: StretchEnd) -> Iterator[tuple[StretchEnd, LanePairs]]:
        """List the ends that touch a connecting road's end, and the lanes that go on there."""
        stretch = self._index.stretches[end.stretch]
        if self._index.find_end(stretch.road.id, end.contact) != end:
            step, contact = (1, "start") if end.contact == "end" else (-1, "end")
            following = StretchEnd(end.stretch + step, contact)
            yield following, self._index.link(end, following).lanes
            return
        link = stretch.road.get_link(end.contact)
        if link is None:
            return
        if link.element_type == "junction":
            # Two junctions touch: the next one defines where a lane of this one leads.
            for connection in self._list_entered(link.id, stretch.road.id):
                near = self._find_near(connection)
                if near is not None:
                    yield near, connection.lane_links or self._index.link(end, near).lanes
            return
        found = self._find_linked(link, stretch.road.junction, end)
        if found is not None:
            inside = self._is_connecting(found)
            yield found, self._index.link(end, found, is_mutual=inside).lanes

    def _list_entered(self, junction: str, road: str) -> Iterator[Connection]:
        found = self._document.junctions.get(junction)
        for connection in () if found is None else found.connections:
            if connection.incoming_road == road and not connection.is_direct:
                yield connection

    def _is_connecting(self, end: StretchEnd) -> bool:
        return self._document.is_connecting(self._index.stretches[end.stretch].road)

    def _is_driven(self, lane: LaneEnd) -> bool:
        ribbon = self._index.stretches[lane[0].stretch].ribbons.get(lane[1])
        return ribbon is not None and not (ribbon.use.is_closed or ribbon.use.is_walked)

    def _borders(self, lane: LaneEnd) -> Points:
        """Return the left and right border (2, n, 3) of a lane, from this end of it."""
        end, name = lane
        ribbon = self._index.stretches[end.stretch].ribbons[name]
        borders = np.stack([ribbon.left, ribbon.right])
        return borders if end.contact == "start" else borders[::-1, ::-1]

    def _place(self, end: StretchEnd) -> Points:
        """Compute the middle (2,) of the lanes at an end."""
        at = 0 if end.contact == "start" else -1
        ribbons = self._index.stretches[end.stretch].ribbons.values()
        points = [line[at, :2] for item in ribbons for line in (item.left, item.right)]
        return np.mean(points, axis=0) if points else np.full(2, np.inf)
