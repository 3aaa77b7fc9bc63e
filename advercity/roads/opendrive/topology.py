"""Edges and nodes of an OpenDRIVE map, and the links between their lanes."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import shapely
from shapely.geometry.base import BaseGeometry

from advercity.foreign.ledger import Ledger
from advercity.geometry.polyline import Points
from advercity.roads.opendrive.chains import Street, StreetLane, build_streets
from advercity.roads.opendrive.document import OpenDriveMap
from advercity.roads.opendrive.lanes import Stretch, build_stretches
from advercity.roads.opendrive.links import (
    EndGroups,
    EndLink,
    StretchEnd,
    StretchIndex,
    leads_out,
    list_arm_junctions,
)
from advercity.roads.opendrive.paths import JunctionPath, LaneEnd, PathFinder


@dataclass(frozen=True, eq=False)
class DirectedEdge:
    """Lanes of a street for one direction, from the right, with their borders in it.

    Attributes:
        street: The street.
        goes_along: Whether it goes in the street's direction.
        lanes: Its lanes; the last may be closed ones beyond the innermost one for vehicles.
    """

    street: Street
    goes_along: bool
    lanes: tuple[StreetLane, ...]

    @property
    def begins(self) -> StretchEnd:
        """The stretch end at its begin."""
        return self.street.begins if self.goes_along else self.street.ends

    @property
    def ends(self) -> StretchEnd:
        """The stretch end at its end."""
        return self.street.ends if self.goes_along else self.street.begins


@dataclass(frozen=True, eq=False)
class MapTopology:
    """Links of a map's lanes.

    Attributes:
        stretches: All stretches, those inside junctions included.
        edges: Edges outside junctions, by id.
        groups: Ends of stretches in one node; junctions are in them by their id.
        lanes: Edge and index of every lane of every stretch of these edges.
        links: Links outside junctions.
        paths: Ways through junctions.
    """

    stretches: tuple[Stretch, ...]
    edges: Mapping[str, DirectedEdge]
    groups: EndGroups
    lanes: Mapping[tuple[int, int], tuple[str, int]]
    links: tuple[EndLink, ...]
    paths: tuple[JunctionPath, ...]

    def list_lane_links(self) -> Iterator[tuple[LaneEnd, LaneEnd]]:
        """List linked lanes where streets touch outside junctions."""
        for link in self.links:
            for one, other in link.lanes:
                first, second = (link.first, one), (link.second, other)
                if self._is_driven(first) and self._is_driven(second):
                    yield (first, second) if leads_out(*first) else (second, first)

    def _is_driven(self, lane: LaneEnd) -> bool:
        use = self.stretches[lane[0].stretch].ribbons[lane[1]].use
        return not (use.is_closed or use.is_walked)


def build_topology(
    document: OpenDriveMap, extent: BaseGeometry | None, ledger: Ledger
) -> MapTopology:
    """Join the lanes of a map; streets entirely outside an extent are left out."""
    stretches = tuple(
        stretch for road in document.roads.values() for stretch in build_stretches(road)
    )
    index = StretchIndex(stretches)
    links = tuple(index.list_links(document))
    finder = PathFinder(document, index, ledger)
    paths = tuple(
        path for junction in document.junctions.values() for path in finder.list_paths(junction)
    )
    plain = [
        number
        for number, stretch in enumerate(stretches)
        if stretch.ribbons and not document.is_connecting(stretch.road)
    ]
    groups = _group_ends(document, index, links, paths)
    streets = build_streets(stretches, plain, links, groups)
    edges = {
        name: edge
        for number, street in enumerate(streets)
        if extent is None or _reaches(street, extent)
        for name, edge in _split_directions(street, number)
    }
    return MapTopology(stretches, edges, groups, _place_lanes(edges), links, paths)


def _group_ends(
    document: OpenDriveMap,
    index: StretchIndex,
    links: Sequence[EndLink],
    paths: Sequence[JunctionPath],
) -> EndGroups:
    groups = EndGroups()
    for link in links:
        groups.join(link.first, link.second)
    for end, junction in list_arm_junctions(document, index).items():
        groups.join(end, junction)
    for path in paths:
        for end, _ in (path.origin, path.target):
            groups.join(end, path.junction)
    return groups


def _reaches(street: Street, extent: BaseGeometry) -> bool:
    borders = [line for lane in street.lanes for line in (lane.left, lane.right)]
    return any(extent.intersects(shapely.LineString(line[:, :2])) for line in borders)


def _split_directions(street: Street, number: int) -> Iterator[tuple[str, DirectedEdge]]:
    """Split a street into edges; a closed side lies beyond the lanes of the other."""
    sides: dict[bool, list[StreetLane]] = {
        along: [lane for lane in street.lanes if lane.goes_along == along]
        for along in (True, False)
    }
    used = [along for along, lanes in sides.items() if any(not it.use.is_closed for it in lanes)]
    alone = used or [along for along, lanes in sides.items() if lanes]
    for along in alone:
        lanes = [lane for lane in street.lanes if lane.goes_along == along or len(alone) == 1]
        ordered = lanes[::-1] if along else [_turn(lane) for lane in lanes]
        name = f"{number}" if along else f"-{number}"
        yield name, DirectedEdge(street, along, tuple(ordered))


def _turn(lane: StreetLane) -> StreetLane:
    return replace(
        lane, goes_along=not lane.goes_along, left=lane.right[::-1], right=lane.left[::-1]
    )


def _place_lanes(
    edges: Mapping[str, DirectedEdge],
) -> dict[tuple[int, int], tuple[str, int]]:
    found: dict[tuple[int, int], tuple[str, int]] = {}
    for name, edge in edges.items():
        lanes = list(edge.street.lanes)
        here = [
            place
            for place, lane in enumerate(lanes)
            if len(edge.lanes) == len(lanes) or lane.goes_along == edge.goes_along
        ]
        order = here[::-1] if edge.goes_along else here
        indices = {place: index for index, place in enumerate(order)}
        for key, place in edge.street.places.items():
            if place in indices:
                found[key] = (name, indices[place])
    return found


def list_end_points(edge: DirectedEdge, *, at_end: bool) -> list[Points]:
    """List the corners (3,) of an edge's lanes at one of its ends."""
    index = -1 if at_end else 0
    return [line[index] for lane in edge.lanes for line in (lane.left, lane.right)]
