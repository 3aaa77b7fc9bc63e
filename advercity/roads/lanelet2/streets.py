"""Streets: pieces of cross-sections in a row with the same lanes, and the nodes between."""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

from advercity.roads.lanelet2.lanelets import Lanelet
from advercity.roads.lanelet2.overlaps import Overlap
from advercity.roads.lanelet2.pieces import MIN_STREET_M, LaneGraph, LanePath, Piece, PieceKey
from advercity.roads.lanelet2.sections import CrossSection, join_lanes
from advercity.roads.opendrive.links import EndGroups
from advercity.roads.plain_edges import PlainLane

Part = tuple[CrossSection, float, float]
"""A cross-section, and the fractions of its length between which a street follows it."""
BEGIN, END, INSIDE, MIDDLE = "begin", "end", "inside", "middle"


@dataclass(frozen=True, eq=False)
class Street:
    """Lanes in one direction, between two nodes.

    Attributes:
        parts: Its cross-sections.
        begins: Its begin: an end of a piece.
        ends: Its end.
    """

    parts: tuple[Part, ...]
    begins: object
    ends: object

    @property
    def lanes(self) -> tuple[PlainLane, ...]:
        """Its lanes from the right."""
        cut = [section.cut(begins, ends) for section, begins, ends in self.parts]
        return tuple(join_lanes(lanes) for lanes in zip(*cut, strict=True))

    @property
    def length_m(self) -> float:
        """Mean length of its bounds."""
        return sum(section.length_m * (ends - begins) for section, begins, ends in self.parts)

    @property
    def first_lanelets(self) -> tuple[Lanelet, ...]:
        """Lanelets at its begin, from the right."""
        return self.parts[0][0].lanelets[::-1]


@dataclass(frozen=True, eq=False)
class StreetMap:
    """Streets by edge, and their links.

    Attributes:
        streets: Streets by the name of their edge.
        groups: Ends of pieces in one node.
        lanes_at: Names of the first and the last street of each piece.
        links: Pairs of consecutive streets with linked lanes.
    """

    streets: dict[str, Street]
    groups: EndGroups
    lanes_at: dict[PieceKey, tuple[str, str]]
    links: tuple[tuple[str, str], ...]

    def find_inner_pieces(self) -> set[PieceKey]:
        """Find the pieces of short streets back to the junction at their begin.

        They are inside it: the other direction of the street before or behind begins or ends there.
        """
        return {
            key
            for key, (first, last) in self.lanes_at.items()
            if first != last
            and self.streets[first].length_m + self.streets[last].length_m < MIN_STREET_M
        }


def build_streets(
    graph: LaneGraph,
    pieces: Sequence[tuple[Piece, ...]],
    paths: Sequence[LanePath],
    overlaps: Iterable[Overlap],
) -> StreetMap:
    """Join pieces to streets; a street back to its own begin is split into two."""
    following = _find_continuations(graph, pieces, paths)
    groups = _group_ends(graph, pieces, paths, overlaps)
    preceding = set(following.values())
    outside = [
        PieceKey(section, index)
        for section, parts in enumerate(pieces)
        for index, part in enumerate(parts)
        if not part.is_inside
    ]
    streets: dict[str, Street] = {}
    lanes_at: dict[PieceKey, tuple[str, str]] = {}
    links: list[tuple[str, str]] = []
    # A ring of streets without a beginning begins anywhere.
    for first in sorted(outside, key=lambda key: key in preceding):
        if first in lanes_at:
            continue
        chain = [first]
        while (after := following.get(chain[-1])) and after not in lanes_at and after != first:
            chain.append(after)
        names: list[str] = []
        for street in _build_streets(graph, pieces, chain, groups):
            names.append(str(len(streets)))
            streets[names[-1]] = street
        links += pairwise(names)
        lanes_at |= dict.fromkeys(chain, (names[0], names[-1]))
    return StreetMap(streets, groups, lanes_at, tuple(links))


def _find_continuations(
    graph: LaneGraph, pieces: Sequence[tuple[Piece, ...]], paths: Sequence[LanePath]
) -> dict[PieceKey, PieceKey]:
    """Find the piece behind each with the same lanes, limits and name."""
    leaving: dict[PieceKey, list[LanePath]] = defaultdict(list)
    entering: dict[PieceKey, list[LanePath]] = defaultdict(list)
    for path in paths:
        leaving[path.origin[0]].append(path)
        entering[path.target[0]].append(path)
    found = {
        origin: own[0].target[0]
        for origin, own in leaving.items()
        if _continues(graph, own, entering[own[0].target[0]])
    }

    def is_kept(origin: PieceKey, target: PieceKey) -> bool:
        # Opposite directions of a street are cut at the same places.
        before, behind = (graph.opposite.get(key.section) for key in (origin, target))
        if before is None or behind is None:
            return before is behind
        last = PieceKey(behind, len(pieces[behind]) - 1)
        return found.get(last) == PieceKey(before, 0)

    return {origin: target for origin, target in found.items() if is_kept(origin, target)}


def _continues(graph: LaneGraph, leaving: Sequence[LanePath], entering: Sequence[LanePath]) -> bool:
    first, second = (
        graph.sections[key.section].lanelets for key in (leaving[0].origin[0], leaving[0].target[0])
    )
    lanes = [(path.origin[1], path.target[1]) for path in leaving]
    return (
        leaving[0].origin[0] != leaving[0].target[0]
        and len(leaving) == len(entering) == len(first) == len(second)
        and not any(path.inside for path in leaving)
        and lanes == [(lane, lane) for lane in range(len(first))]
        and all(
            (one.use, one.speed_m_s, one.name) == (other.use, other.speed_m_s, other.name)
            for one, other in zip(first, second, strict=True)
        )
    )


def _group_ends(
    graph: LaneGraph,
    pieces: Sequence[tuple[Piece, ...]],
    paths: Iterable[LanePath],
    overlaps: Iterable[Overlap],
) -> EndGroups:
    groups = EndGroups()
    for path in paths:
        for key, _ in path.inside:
            groups.join((INSIDE, key), (END, path.origin[0]))
        groups.join((END, path.origin[0]), (BEGIN, path.target[0]))
    inner = {
        section: (INSIDE, PieceKey(section, index))
        for section, parts in enumerate(pieces)
        for index, part in enumerate(parts)
        if part.is_inside
    }
    for overlap in overlaps:
        first, second = (inner.get(section) for section in overlap.sections)
        if first is not None and second is not None:
            groups.join(first, second)
    for section, other in graph.opposite.items():
        if not (pieces[section][-1].is_inside or pieces[other][0].is_inside):
            last = PieceKey(section, len(pieces[section]) - 1)
            groups.join((END, last), (BEGIN, PieceKey(other, 0)))
    return groups


def _build_streets(
    graph: LaneGraph,
    pieces: Sequence[tuple[Piece, ...]],
    chain: Sequence[PieceKey],
    groups: EndGroups,
) -> Iterator[Street]:
    parts = [
        (graph.sections[key.section], piece.begins, piece.ends)
        for key in chain
        for piece in (pieces[key.section][key.piece],)
    ]
    begins, ends = (BEGIN, chain[0]), (END, chain[-1])
    if groups.find(begins) != groups.find(ends):
        yield Street(tuple(parts), begins, ends)
        return
    if len(parts) == 1:
        section, first, last = parts[0]
        parts = [(section, first, (first + last) / 2), (section, (first + last) / 2, last)]
    half, middle = len(parts) // 2, (MIDDLE, chain[0])
    yield Street(tuple(parts[:half]), begins, middle)
    yield Street(tuple(parts[half:]), middle, ends)
