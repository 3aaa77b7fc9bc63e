"""Which ends of stretches meet, and which of their lanes lead into each other."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from advercity.geometry.polyline import Points
from advercity.roads.opendrive.document import CONTACTS, Contact, OpenDriveMap, Road
from advercity.roads.opendrive.lanes import Stretch
from advercity.roads.plain_edges import PlainLane

MAX_GAP_M = 0.5
"""Largest distance between the middles of two lanes that follow each other without a link."""


class StretchEnd(NamedTuple):
    """One end of a stretch, by its index."""

    stretch: int
    contact: Contact

    @property
    def opposite(self) -> "StretchEnd":
        """The other end of the same stretch."""
        return StretchEnd(self.stretch, "end" if self.contact == "start" else "start")


@dataclass(frozen=True)
class EndLink:
    """Two ends at one place, and the pairs of ids of their continuing lanes."""

    first: StretchEnd
    second: StretchEnd
    lanes: tuple[tuple[int, int], ...]


class StretchIndex:
    """Finds the stretches at the ends of roads."""

    def __init__(self, stretches: Sequence[Stretch]) -> None:
        self.stretches = stretches
        self._by_road: dict[str, list[int]] = {}
        for index, stretch in enumerate(stretches):
            self._by_road.setdefault(stretch.road.id, []).append(index)

    def find_end(self, road: str, contact: Contact) -> StretchEnd | None:
        """Find an end of a road; None if the map has no such road, or it has no length."""
        found = self._by_road.get(road)
        return (
            None if found is None else StretchEnd(found[0 if contact == "start" else -1], contact)
        )

    def list_links(self, document: OpenDriveMap) -> Iterator[EndLink]:
        """List links outside junctions, between stretches of a road and from road to road."""
        roads = [road for road in document.roads.values() if not document.is_connecting(road)]
        for road in roads:
            for first, second in pairwise(self._by_road.get(road.id, ())):
                yield self.link(StretchEnd(first, "end"), StretchEnd(second, "start"))
        seen: set[frozenset[StretchEnd]] = set()
        for road in roads:
            for contact in CONTACTS:
                link = road.get_link(contact)
                if link is None or link.element_type != "road":
                    continue
                ends = self.find_end(road.id, contact), self.find_end(link.id, link.contact)
                if ends[0] is None or ends[1] is None or frozenset(ends) in seen:
                    continue
                if document.is_connecting(document.roads[link.id]):
                    continue
                seen.add(frozenset([ends[0], ends[1]]))
                yield self.link(ends[0], ends[1])

    def link(self, first: StretchEnd, second: StretchEnd, *, is_mutual: bool = True) -> EndLink:
        """Pair the lanes of two ends: by the map, else by touch.

        If a link is not mutual, only lanes of the first have successors.
        """
        one, other = self.stretches[first.stretch], self.stretches[second.stretch]
        turned = 1 if first.contact != second.contact else -1
        if one.section is other.section and first.stretch != second.stretch:
            return EndLink(
                first, second, tuple((lane, lane) for lane in one.ribbons if lane in other.ribbons)
            )
        declared = {
            (lane, target)
            for lane in one.ribbons
            for target in _list_declared(one, lane, first.contact)
        } | {
            (target, lane)
            for lane in (other.ribbons if is_mutual else ())
            for target in _list_declared(other, lane, second.contact)
        }
        pairs = {
            (lane, target)
            for lane, target in declared
            if lane in one.ribbons and target in other.ribbons and lane * target * turned > 0
        }
        used = {lane for lane, _ in declared}, {target for _, target in declared}
        for lane, ribbon in one.ribbons.items():
            for target, opposite in other.ribbons.items():
                is_free = lane not in used[0] and target not in used[1]
                if is_free and lane * target * turned > 0 and ribbon.use == opposite.use:
                    gap = _end_middle(ribbon, first.contact) - _end_middle(opposite, second.contact)
                    if np.linalg.norm(gap) < MAX_GAP_M:
                        pairs.add((lane, target))
        return EndLink(first, second, tuple(sorted(pairs)))


def leads_out(end: StretchEnd, lane: int) -> bool:
    """Whether traffic leaves a stretch at this end of a lane, where it keeps right."""
    return end.contact == ("end" if lane < 0 else "start")


def _list_declared(stretch: Stretch, lane: int, contact: Contact) -> tuple[int, ...]:
    found = stretch.section.lanes[lane]
    return found.predecessors if contact == "start" else found.successors


def _end_middle(ribbon: PlainLane, contact: Contact) -> Points:
    index = 0 if contact == "start" else -1
    return (ribbon.left[index, :2] + ribbon.right[index, :2]) / 2


class EndGroups:
    """Groups of ends at one place: each is a node of the network."""

    def __init__(self) -> None:
        self._parents: dict[object, object] = {}

    def find(self, item: object) -> object:
        """Find the representative of the group of an end or junction."""
        while (parent := self._parents.get(item, item)) != item:
            item = parent
        return item

    def join(self, first: object, second: object) -> None:
        """Make two groups one."""
        self._parents[self.find(first)] = self.find(second)


def list_arm_junctions(document: OpenDriveMap, index: StretchIndex) -> Mapping[StretchEnd, str]:
    """List the ends of roads at a junction, with its id.

    A direct junction names its ends, in contradiction to the links of some roads.
    """
    named = {
        (item.road, item.contact): junction.id
        for junction in document.junctions.values()
        for item in junction.connections
        if item.is_direct
    }
    found: dict[StretchEnd, str] = {}
    for road in document.roads.values():
        for contact, junction in _list_junctions(road, document):
            end = index.find_end(road.id, contact)
            if end is not None:
                found[end] = named.get((road.id, contact), junction)
    return found


def _list_junctions(road: Road, document: OpenDriveMap) -> Iterator[tuple[Contact, str]]:
    for contact in CONTACTS:
        link = road.get_link(contact)
        if link and link.element_type == "junction" and link.id in document.junctions:
            yield contact, link.id
