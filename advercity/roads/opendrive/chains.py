"""Streets: stretches with the same lanes, joined as far as they have the same name."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from advercity.geometry.polyline import Points, simplify_together
from advercity.roads.opendrive.lanes import Stretch
from advercity.roads.opendrive.links import EndGroups, EndLink, StretchEnd
from advercity.roads.plain_edges import PlainLane

MAX_ERROR_M = 0.01
"""Largest distance between a border and its polyline."""
MAX_JOIN_GAP_M = 0.05


@dataclass(frozen=True, eq=False)
class StreetLane(PlainLane):
    """A lane of a street; its borders are in the direction of the street.

    Attributes:
        goes_along: Whether its traffic goes in the direction of the street.
    """

    goes_along: bool


@dataclass(frozen=True, eq=False)
class Street:
    """Stretches in a row, with their lanes from left to right.

    Attributes:
        name: Name of its roads.
        road: Id of its first road.
        begins: Its begin: an end of the first stretch.
        ends: Its end: an end of the last stretch.
        lanes: Its lanes.
        places: Place in `lanes` of every lane of every stretch, by index and id.
    """

    name: str
    road: str
    begins: StretchEnd
    ends: StretchEnd
    lanes: tuple[StreetLane, ...]
    places: dict[tuple[int, int], int]


def build_streets(
    stretches: Sequence[Stretch], chosen: Iterable[int], links: Iterable[EndLink], nodes: EndGroups
) -> Iterator[Street]:
    """Join stretches, by index, over links that neither add, drop nor change a lane.

    A street back to its own first node is split into two.
    """
    by_end: dict[StretchEnd, list[EndLink]] = {}
    for link in links:
        for end in {link.first, link.second}:
            by_end.setdefault(end, []).append(link)
    following = {
        end: found[0].second if found[0].first == end else found[0].first
        for end, found in by_end.items()
        if len(found) == 1
        and len(by_end[found[0].first]) == len(by_end[found[0].second]) == 1
        and _continues(found[0], stretches)
    }
    left = dict.fromkeys(chosen)
    while left:
        first = StretchEnd(next(iter(left)), "start")
        seen = {first.stretch}
        while (before := following.get(first)) and before.stretch not in seen:
            first = before.opposite
            seen.add(first.stretch)
        chain = [first]
        taken = {first.stretch}
        while (after := following.get(chain[-1].opposite)) and after.stretch not in taken:
            chain.append(after)
            taken.add(after.stretch)
        for index in taken:
            left.pop(index, None)
        # SUMO has no edge from a node to itself.
        is_ring = nodes.find(chain[-1].opposite) == nodes.find(chain[0])
        middle = len(chain) // 2 if is_ring else 0
        for part in (chain[:middle], chain[middle:]):
            if part:
                yield _build_street(stretches, part)


def _continues(link: EndLink, stretches: Sequence[Stretch]) -> bool:
    one, other = stretches[link.first.stretch], stretches[link.second.stretch]
    firsts, seconds = {lane for lane, _ in link.lanes}, {lane for _, lane in link.lanes}
    if not len(link.lanes) == len(firsts) == len(seconds) == len(one.ribbons) == len(other.ribbons):
        return False
    if one.road.name != other.road.name or link.first.stretch == link.second.stretch:
        return False
    is_turned = link.first.contact == link.second.contact
    ordered = sorted(link.lanes, key=lambda pair: -pair[0])
    if [pair[1] for pair in ordered] != sorted(seconds, reverse=not is_turned):
        return False
    return all(
        _is_same(one.ribbons[lane], other.ribbons[target])
        and _gap_m(one.ribbons[lane], link.first, other.ribbons[target], link.second)
        < MAX_JOIN_GAP_M
        for lane, target in link.lanes
    )


def _is_same(one: PlainLane, other: PlainLane) -> bool:
    return one.use == other.use and one.speed_m_s == other.speed_m_s


def _gap_m(one: PlainLane, end: StretchEnd, other: PlainLane, opposite: StretchEnd) -> float:
    first = np.stack([line[0 if end.contact == "start" else -1] for line in (one.left, one.right)])
    lines = (other.left, other.right)
    if end.contact == opposite.contact:
        lines = lines[::-1]
    second = np.stack([line[0 if opposite.contact == "start" else -1] for line in lines])
    return float(np.abs(first - second).max())


def _build_street(stretches: Sequence[Stretch], chain: list[StretchEnd]) -> Street:
    """Build a street from the ends at which its stretches begin."""
    places: dict[tuple[int, int], int] = {}
    lines: list[list[Points]] = []
    for end in chain:
        stretch = stretches[end.stretch]
        ordered = list(stretch.ribbons.items())
        if end.contact == "end":
            ordered.reverse()
        pieces: list[Points] = []
        for place, (lane_id, ribbon) in enumerate(ordered):
            places[end.stretch, lane_id] = place
            borders = (ribbon.left, ribbon.right)
            if end.contact == "end":
                borders = (ribbon.right[::-1], ribbon.left[::-1])
            pieces += borders
        lines.append(pieces)
    # The point where two stretches meet is in both.
    joined = [
        np.concatenate([lines[0][k], *(pieces[k][1:] for pieces in lines[1:])])
        for k in range(len(lines[0]))
    ]
    kept = simplify_together(joined, MAX_ERROR_M)
    first = stretches[chain[0].stretch]
    ordered = list(first.ribbons.items())
    if chain[0].contact == "end":
        ordered.reverse()
    lanes = tuple(
        StreetLane(
            use=ribbon.use,
            speed_m_s=ribbon.speed_m_s,
            goes_along=(lane_id < 0) == (chain[0].contact == "start"),
            left=joined[2 * place][kept],
            right=joined[2 * place + 1][kept],
        )
        for place, (lane_id, ribbon) in enumerate(ordered)
    )
    return Street(first.road.name, first.road.id, chain[0], chain[-1].opposite, lanes, places)
