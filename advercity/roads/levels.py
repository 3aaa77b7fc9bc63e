"""Split an imported network into levels: streets over others are paved apart."""

from dataclasses import replace

import numpy as np

from advercity.roads.imported_network import ImportedNetwork
from advercity.roads.network_file import SumoEdge, SumoLane
from advercity.roads.overpasses import LaneBands, find_overpasses

MAX_LEVELS = 8
"""Bound on levels: streets over themselves would have no end of them."""
STUB_M = 15.0
"""Length of a street paved with its junction on another level, for corners and kerbs."""


def split_levels(net: ImportedNetwork) -> list[ImportedNetwork]:
    """Split a network into levels from the ground up; without an overpass it stays whole."""
    inner = {edge.id: edge for edge in net.internal_edges}
    lanes = [lane for edge in (net.edges | inner).values() for lane in edge.lanes]
    found = find_overpasses(
        LaneBands.from_borders([(lane.left_border, lane.right_border) for lane in lanes])
    )
    pairs = {
        (lanes[over].edge, lanes[under].edge)
        for over, under in zip(found.over, found.under, strict=True)
    }
    levels = _count_levels(pairs)
    by_junction = _find_junction_levels(net, levels)
    return [_select_level(net, levels, by_junction, level) for level in _list_levels(levels)]


def _list_levels(levels: dict[str, int]) -> range:
    return range(max(levels.values(), default=0) + 1)


def _count_levels(pairs: set[tuple[str, str]]) -> dict[str, int]:
    """Count the levels below each edge over another."""
    levels: dict[str, int] = {}
    for _ in range(MAX_LEVELS):
        for over, under in sorted(pairs):
            if over != under:
                levels[over] = max(levels.get(over, 0), levels.get(under, 0) + 1)
    return {edge: min(level, MAX_LEVELS) for edge, level in levels.items()}


def _find_junction_levels(net: ImportedNetwork, levels: dict[str, int]) -> dict[str, int]:
    """Find the level of each junction: the lowest of its streets, or its path's."""
    found: dict[str, list[int]] = {}
    for edge in net.edges.values():
        for junction in (edge.from_junction, edge.to_junction):
            found.setdefault(junction, []).append(levels.get(edge.id, 0))
    lowest = {junction: min(own) for junction, own in found.items()}
    for edge in net.internal_edges:
        if edge.id in levels:
            lowest[edge.junction] = max(lowest.get(edge.junction, 0), levels[edge.id])
    return lowest


def _select_level(
    net: ImportedNetwork, levels: dict[str, int], by_junction: dict[str, int], level: int
) -> ImportedNetwork:
    if not levels:
        return net

    def is_here(junction: str) -> bool:
        return by_junction.get(junction, 0) == level

    edges: dict[str, SumoEdge] = {}
    for name, edge in net.edges.items():
        if levels.get(name, 0) == level:
            edges[name] = edge
        elif is_here(edge.from_junction) or is_here(edge.to_junction):
            edges[name] = _cut_stub(edge, at_end=is_here(edge.to_junction))
    return replace(
        net,
        edges=edges,
        internal_edges=tuple(edge for edge in net.internal_edges if is_here(edge.junction)),
        crossings=tuple(edge for edge in net.crossings if is_here(edge.junction)),
        walking_areas=tuple(edge for edge in net.walking_areas if is_here(edge.junction)),
        junctions={name: item for name, item in net.junctions.items() if is_here(name)},
        outlines=net.outlines if level == 0 else (),
    )


def _cut_stub(edge: SumoEdge, *, at_end: bool) -> SumoEdge:
    return replace(edge, lanes=tuple(_cut_lane(lane, at_end=at_end) for lane in edge.lanes))


def _cut_lane(lane: SumoLane, *, at_end: bool) -> SumoLane:
    length_m = lane.line.length_m
    kept_m = min(STUB_M, length_m)
    first = length_m - kept_m if at_end else 0.0
    shape = np.asarray(lane.line.cut(first, first + kept_m).points)
    return replace(lane, shape=shape, length_m=kept_m)
