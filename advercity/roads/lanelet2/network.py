"""The SUMO network of a Lanelet2 map, as plain XML for netconvert."""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from xml.etree.ElementTree import Element

import numpy as np
from advercity_dsl.road import RoadMark

from advercity.errors import InputError
from advercity.geometry.polyline import Points
from advercity.roads.lanelet2.lanelets import Lanelet
from advercity.roads.lanelet2.overlaps import find_overlaps
from advercity.roads.lanelet2.pieces import (
    LaneGraph,
    LanePath,
    PathFinder,
    Piece,
    PieceKey,
    cut_sections,
    mark_inside,
)
from advercity.roads.lanelet2.rules import Approach, RightOfWay, find_node_type
from advercity.roads.lanelet2.sections import CrossSection, join_sections
from advercity.roads.lanelet2.streets import StreetMap, build_streets
from advercity.roads.plain_edges import (
    LaneKey,
    PlainLane,
    add_edge,
    add_node,
    build_connections,
    list_lane_lines,
)
from advercity.roads.plain_network import PlainNetwork

APPROACH_M = 25.0
"""Distance before a junction within which rules of lanelets are its own."""
MAX_STREETS_M = 500_000.0
"""Total length of the streets of a map; a larger one would fill the memory."""
MIN_STEP_M = 1.0
"""Least assumed length of a lanelet: tiny ones need an end, too."""
OUTLINE_KINDS = {"driving": "roadway", "shoulder": "roadway", "sidewalk": "sidewalk"}
"""Kinds of outlines by paving of a lane."""


@dataclass(frozen=True, eq=False)
class LaneletTopology:
    """Cross-sections of a map, their pieces, the ways between them, and the streets they make."""

    graph: LaneGraph
    pieces: Sequence[tuple[Piece, ...]]
    paths: Sequence[LanePath]
    map: StreetMap

    @staticmethod
    def of_lanelets(lanelets: Sequence[Lanelet]) -> "LaneletTopology":
        """Find the streets and junctions of lanelets."""
        sections = join_sections(lanelets)
        graph = LaneGraph(sections)
        overlaps = tuple(find_overlaps(sections))
        pieces = cut_sections(graph, overlaps)
        while True:
            paths = tuple(PathFinder(graph, pieces).list_paths())
            found = build_streets(graph, pieces, paths, overlaps)
            inner = found.find_inner_pieces()
            if not inner:
                return LaneletTopology(graph, pieces, paths, found)
            pieces = mark_inside(pieces, inner)

    @cached_property
    def _paths_into(self) -> dict[str, list[LanePath]]:
        found: dict[str, list[LanePath]] = defaultdict(list)
        for path in self.paths:
            found[self.map.lanes_at[path.target[0]][0]].append(path)
        return found

    @cached_property
    def _paths_out_of(self) -> dict[str, list[LanePath]]:
        found: dict[str, list[LanePath]] = defaultdict(list)
        for path in self.paths:
            found[self.map.lanes_at[path.origin[0]][1]].append(path)
        return found

    @cached_property
    def crossed(self) -> set[object]:
        """Nodes at which ways cross a junction."""
        return {self.map.groups.find(("end", path.origin[0])) for path in self.paths if path.inside}

    def list_lanelets_before(self, name: str, reach_m: float) -> Iterator[Lanelet]:
        """List the lanelets within a distance from the end of a street, also of those before it."""
        for section, begins, ends in reversed(self.map.streets[name].parts):
            if reach_m <= 0:
                return
            yield from section.lanelets
            reach_m -= max(section.length_m * (ends - begins), MIN_STEP_M)
        for path in self._paths_into.get(name, ()) if reach_m > 0 else ():
            before = self.map.lanes_at[path.origin[0]][1]
            if not path.inside and before != name:
                yield from self.list_lanelets_before(before, reach_m)

    def list_ways(self, name: str) -> Iterator[list[Lanelet]]:
        """List the lanelets of every way through the junction at the end of a street."""
        for path in self._paths_out_of.get(name, ()):
            if path.inside:
                keys = [(self.graph.sections[key.section], lane) for key, lane in path.inside]
                yield [section.lanelets[lane] for section, lane in keys]

    def list_apart(self, lanelets: Iterable[Lanelet]) -> Iterator[Lanelet]:
        """List the lanelets, without motor traffic, that share no bound with a street."""
        used = {item.id for section in self.graph.sections for item in section.lanelets}
        return (item for item in lanelets if item.id not in used)

    def list_unused(self) -> Iterator[Lanelet]:
        """List the driven lanelets inside junctions without a way over them."""
        used = {(key.section, lane) for path in self.paths for key, lane in path.inside}
        for section, parts in enumerate(self.pieces):
            is_inside = any(part.is_inside for part in parts)
            for lane, item in enumerate(self.graph.sections[section].lanelets):
                if is_inside and item.is_driven and (section, lane) not in used:
                    yield item


def find_approaches(topology: LaneletTopology, rules: RightOfWay) -> dict[str, Approach]:
    """Find the rules at the end of every street."""
    return {
        name: rules.find(
            topology.list_lanelets_before(name, APPROACH_M), [*topology.list_ways(name)]
        )
        for name in topology.map.streets
    }


def build_plain_network(
    topology: LaneletTopology,
    lanelets: Sequence[Lanelet],
    approaches: Mapping[str, Approach],
    crosswalks: Sequence[Points],
    stripes: Sequence[tuple[RoadMark, Points]],
) -> PlainNetwork:
    """Build the network of a topology, with the paving of all lanelets.

    Raises:
        InputError: Its streets are too long together.
    """
    total_m = sum(street.length_m for street in topology.map.streets.values())
    if total_m > MAX_STREETS_M:
        raise InputError(f"its streets are longer than {MAX_STREETS_M / 1000:g} km together")
    lanes = {name: street.lanes for name, street in topology.map.streets.items()}
    nodes = _Nodes(topology, lanes, approaches)
    return PlainNetwork(
        nodes=nodes.build(),
        edges=_build_edges(topology, lanes, nodes, approaches),
        connections=build_connections(
            _list_connections(topology), topology.map.streets, nodes.list_uncrossed()
        ),
        names={
            name: _name_street(item.first_lanelets) for name, item in topology.map.streets.items()
        },
        lanes={
            key: lines for name, own in lanes.items() for key, lines in list_lane_lines(name, own)
        },
        paths={},
        outlines=list(_list_outlines(topology, lanelets)),
        crosswalks=[(float(x), float(y)) for x, y, _ in crosswalks],
        stripes=stripes,
    )


class _Nodes:
    """Names and writes the nodes at the ends of streets."""

    def __init__(
        self,
        topology: LaneletTopology,
        lanes: Mapping[str, Sequence[PlainLane]],
        approaches: Mapping[str, Approach],
    ) -> None:
        self._groups = topology.map.groups
        self._corners: dict[object, list[Points]] = {}
        self._approaches: dict[object, dict[str, Approach]] = defaultdict(dict)
        self._crossed = topology.crossed
        for name, street in topology.map.streets.items():
            for end, index in ((street.begins, 0), (street.ends, -1)):
                corners = self._corners.setdefault(self._groups.find(end), [])
                corners += [line[index] for it in lanes[name] for line in (it.left, it.right)]
            self._approaches[self._groups.find(street.ends)][name] = approaches[name]
        self._names = {
            group: f"{number}.{int(group in self._crossed)}"
            for number, group in enumerate(self._corners)
        }

    def get_name(self, end: object) -> str:
        """Return the name of the node at an end of a street."""
        return self._names[self._groups.find(end)]

    def list_uncrossed(self) -> Iterator[str]:
        """List the nodes without paths to cross."""
        return (name for group, name in self._names.items() if group not in self._crossed)

    def build(self) -> Element:
        """Build the document of nodes."""
        root = Element("nodes")
        for group, corners in self._corners.items():
            is_crossed = group in self._crossed
            kind = find_node_type(self._approaches[group]) if is_crossed else "priority"
            item = add_node(root, self._names[group], kind, corners, is_crossed=is_crossed)
            if len({it.priority for it in self._approaches[group].values()}) > 1:
                item.set("rightOfWay", "edgePriority")
        return root


def _build_edges(
    topology: LaneletTopology,
    lanes: Mapping[str, Sequence[PlainLane]],
    nodes: _Nodes,
    approaches: Mapping[str, Approach],
) -> Element:
    root = Element("edges")
    for name, street in topology.map.streets.items():
        ends = nodes.get_name(street.begins), nodes.get_name(street.ends)
        add_edge(root, name, ends, lanes[name], approaches[name].priority)
    return root


def _list_connections(
    topology: LaneletTopology,
) -> Iterator[tuple[LaneKey, LaneKey, Points | None]]:
    for path in topology.paths:
        (origin, out_of), (target, into) = path.origin, path.target
        sections = (topology.graph.sections[key.section] for key in (origin, target))
        first, second = sections
        if not (first.lanelets[out_of].is_driven and second.lanelets[into].is_driven):
            continue
        yield (
            (topology.map.lanes_at[origin][1], len(first.lanelets) - 1 - out_of),
            (topology.map.lanes_at[target][0], len(second.lanelets) - 1 - into),
            _build_middle(topology, path),
        )
    for one, other in topology.map.links:
        for index in range(len(topology.map.streets[one].first_lanelets)):
            yield (one, index), (other, index), None


def _build_middle(topology: LaneletTopology, path: LanePath) -> Points | None:
    """Build the middle (n, 3) of a way through a junction; None where streets touch."""
    lines = [_cut_inside(topology, key, lane).centre for key, lane in path.inside]
    return np.concatenate(lines) if lines else None


def _cut_inside(topology: LaneletTopology, key: PieceKey, lane: int) -> PlainLane:
    piece = topology.pieces[key.section][key.piece]
    section = CrossSection((topology.graph.sections[key.section].lanelets[lane],))
    return section.cut(piece.begins, piece.ends)[0]


def _list_outlines(
    topology: LaneletTopology, lanelets: Sequence[Lanelet]
) -> Iterator[tuple[str, Points]]:
    """List the paving of junctions, and of lanelets without a street."""
    for section, parts in zip(topology.graph.sections, topology.pieces, strict=True):
        for part in parts:
            if part.is_inside:
                yield from map(_outline, section.cut(part.begins, part.ends))
    for item in topology.list_apart(lanelets):
        yield _outline(CrossSection((item,)).cut(0.0, 1.0)[0])


def _outline(lane: PlainLane) -> tuple[str, Points]:
    return OUTLINE_KINDS[lane.use.paving], np.vstack([lane.left, lane.right[::-1]])


def _name_street(lanelets: Sequence[Lanelet]) -> str:
    return lanelets[-1].name or f"lanelet {lanelets[-1].id}"
