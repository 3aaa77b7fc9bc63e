"""Cross-sections, cut into streets and insides of junctions, and their order.

Lanelet2 knows no junctions. They are where driven lanelets overlap others that are no neighbours.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

from advercity.roads.lanelet2.lanelets import Lanelet
from advercity.roads.lanelet2.overlaps import Overlap
from advercity.roads.lanelet2.sections import CrossSection

MIN_STREET_M = 25.0
"""Length from which a street does not belong to the junction at its end."""
MIN_INNER_M = 6.0
"""Shorter cross-sections between the insides of junctions are inside, too."""
STUB_M = 5.0
"""Length of a street cut off by the map inside a junction."""


class SectionLane(NamedTuple):
    """A lane of a cross-section, by the index of both."""

    section: int
    lane: int


class PieceKey(NamedTuple):
    """A piece of a cross-section, by the index of both."""

    section: int
    piece: int


LanePiece = tuple[PieceKey, int]
"""A piece of a cross-section, and the index of a lane in it."""


@dataclass(frozen=True)
class Piece:
    """A part of a cross-section, between fractions of the lengths of its bounds."""

    begins: float
    ends: float
    is_inside: bool


class LaneGraph:
    """Which lanes lead into each other."""

    def __init__(self, sections: Sequence[CrossSection]) -> None:
        self.sections = sections
        begins: dict[tuple[bool, tuple[str, str]], list[SectionLane]] = {}
        for key, lane in self._list_lanes():
            begins.setdefault((lane.is_driven, lane.begins), []).append(key)
        self.following: dict[SectionLane, list[SectionLane]] = {
            key: begins.get((lane.is_driven, lane.ends), []) for key, lane in self._list_lanes()
        }
        self.preceding: dict[SectionLane, list[SectionLane]] = {key: [] for key in self.following}
        for key, found in self.following.items():
            for other in found:
                self.preceding[other].append(key)
        axes = {item.lanelets[0].left.nodes: index for index, item in enumerate(sections)}
        self.opposite: dict[int, int] = {
            index: other
            for index, item in enumerate(sections)
            if (other := axes.get(item.lanelets[0].left.nodes[::-1])) is not None
        }

    def list_neighbours(self, section: int, ahead: bool) -> set[int]:
        """List the cross-sections ahead of, or behind, the driven lanes of one."""
        links = self.following if ahead else self.preceding
        return {
            other.section
            for lane, item in enumerate(self.sections[section].lanelets)
            if item.is_driven
            for other in links[SectionLane(section, lane)]
        }

    def _list_lanes(self) -> Iterator[tuple[SectionLane, Lanelet]]:
        for index, section in enumerate(self.sections):
            for lane, item in enumerate(section.lanelets):
                yield SectionLane(index, lane), item


def cut_sections(graph: LaneGraph, overlaps: Sequence[Overlap]) -> list[tuple[Piece, ...]]:
    """Cut every cross-section into pieces, in the direction of travel."""
    spans: dict[int, list[tuple[float, float]]] = {}
    for overlap in overlaps:
        for section, span in zip(overlap.sections, overlap.spans, strict=True):
            spans.setdefault(section, []).append(span)
    pieces = [
        _cut(graph, section, spans.get(section, ())) for section in range(len(graph.sections))
    ]
    for section, item in enumerate(graph.sections):
        if item.length_m < MIN_INNER_M and all(
            any(pieces[other][index].is_inside for other in graph.list_neighbours(section, ahead))
            for ahead, index in ((False, -1), (True, 0))
        ):
            pieces[section] = (Piece(0.0, 1.0, is_inside=True),)
    return pieces


def _cut(graph: LaneGraph, section: int, spans: Sequence[tuple[float, float]]) -> tuple[Piece, ...]:
    if not spans:
        return (Piece(0.0, 1.0, is_inside=False),)
    length_m = graph.sections[section].length_m
    begins, ends = min(span[0] for span in spans), max(span[1] for span in spans)
    stub = min(STUB_M / length_m, 0.3)
    # The stop line is where lanelets diverge; the rest before it is a street if it is long.
    if not graph.list_neighbours(section, False):
        begins = max(begins, stub)
    elif begins * length_m < MIN_STREET_M:
        begins = 0.0
    if not graph.list_neighbours(section, True):
        ends = min(ends, 1 - stub)
    elif (1 - ends) * length_m < MIN_STREET_M:
        ends = 1.0
    cuts = [0.0, begins, max(begins, ends), 1.0]
    parts = [Piece(a, b, is_inside=k == 1) for k, (a, b) in enumerate(pairwise(cuts))]
    return tuple(part for part in parts if part.ends > part.begins)


def mark_inside(
    pieces: Sequence[tuple[Piece, ...]], keys: Collection[PieceKey]
) -> list[tuple[Piece, ...]]:
    """Put more pieces inside junctions."""
    return [
        tuple(
            replace(part, is_inside=part.is_inside or PieceKey(section, index) in keys)
            for index, part in enumerate(parts)
        )
        for section, parts in enumerate(pieces)
    ]


@dataclass(frozen=True)
class LanePath:
    """A way from a lane of a street into another's.

    Attributes:
        origin: Piece and lane at its start.
        target: Piece and lane at its end.
        inside: Pieces and lanes inside a junction on the way; none if streets touch.
    """

    origin: LanePiece
    target: LanePiece
    inside: tuple[LanePiece, ...]


class PathFinder:
    """Finds the ways from street to street."""

    def __init__(self, graph: LaneGraph, pieces: Sequence[tuple[Piece, ...]]) -> None:
        self._graph = graph
        self._pieces = pieces

    def list_paths(self) -> Iterator[LanePath]:
        """List the ways between all streets, over the fewest lanelets, each once."""
        for section, parts in enumerate(self._pieces):
            for index, part in enumerate(parts):
                for lane in range(len(self._graph.sections[section].lanelets)):
                    if not part.is_inside:
                        yield from self._follow((PieceKey(section, index), lane))

    def _follow(self, origin: LanePiece) -> Iterator[LanePath]:
        came_from = {origin: origin}
        pending = [origin]
        while pending:
            here = pending.pop(0)
            for following in self._list_following(*here):
                if following in came_from:
                    continue
                came_from[following] = here
                (section, index), _ = following
                if self._pieces[section][index].is_inside:
                    pending.append(following)
                else:
                    yield LanePath(origin, following, _trace(came_from, origin, here))

    def _list_following(self, key: PieceKey, lane: int) -> Iterator[LanePiece]:
        if key.piece + 1 < len(self._pieces[key.section]):
            yield PieceKey(key.section, key.piece + 1), lane
            return
        for other in self._graph.following[SectionLane(key.section, lane)]:
            yield PieceKey(other.section, 0), other.lane


def _trace(
    came_from: Mapping[LanePiece, LanePiece],
    origin: LanePiece,
    last: LanePiece,
) -> tuple[LanePiece, ...]:
    way: list[LanePiece] = []
    while last != origin:
        way.append(last)
        last = came_from[last]
    return tuple(reversed(way))
