"""Paint on an imported road, as its lanes and their right of way suggest it."""

from collections.abc import Iterator

import numpy as np

from advercity import curves
from advercity.curves import Points
from advercity.semantics import Semantic
from advercity.world import markings
from advercity.world.imported.net import Net, NetEdge, NetLane, beside
from advercity.world.imported.surface import Surface
from advercity.world.markings import WHITE, YELLOW
from advercity.world.meshing import Piece, mesh, ribbon
from advercity.world.scene import Mesh

INWARD_M = 0.1
"""Lines on the edge of the roadway are painted this far inside it."""
SHORTEST_M = 1.0


def meshes(net: Net, surface: Surface) -> list[Mesh]:
    """All paint, a mesh per colour."""
    pieces: dict[str, list[Piece]] = {WHITE: [], YELLOW: []}
    for edge in net.streets.values():
        for colour, piece in _lines(edge, net):
            pieces[colour].append(piece)
    for edge in _stopping(net):
        pieces[WHITE] += _stop_line(edge)
    for edge in net.crossings:
        heights = surface.height_in(edge.junction)
        for lane in edge.lanes:
            for start, end in zip(lane.centre[:-1], lane.centre[1:], strict=True):
                pieces[WHITE] += markings.zebra(
                    start[:2], end[:2], width_m=lane.width_m, height=heights.at
                )
    return [
        mesh(colour, found, colour, Semantic.ROAD_LINE) for colour, found in pieces.items() if found
    ]


def _lines(edge: NetEdge, net: Net) -> Iterator[tuple[str, Piece]]:
    lanes = edge.driving
    if not lanes or curves.length(lanes[-1].centre) < SHORTEST_M:
        return
    for lane in lanes[:-1]:
        for first, last in markings.dashes(curves.length(lane.left)):
            yield WHITE, _stripe(_between(lane.left, first, last))
    yield WHITE, _stripe(_inside(lanes[0], on_left=False))
    opposite = net.opposite(edge)
    if opposite is None:
        yield YELLOW, _stripe(_inside(lanes[-1], on_left=True))
    elif edge.id < opposite.id or net.opposite(opposite) is not edge:
        yield YELLOW, _stripe(lanes[-1].left)


def _inside(lane: NetLane, *, on_left: bool) -> Points:
    half = lane.width_m / 2 - INWARD_M
    return lane.beside(half if on_left else -half)


def _stripe(line: Points, width_m: float = markings.LINE_WIDTH_M) -> Piece:
    half = width_m / 2
    return ribbon(beside(line, half) + markings.LIFT, beside(line, -half) + markings.LIFT)


def _between(line: Points, first_m: float, last_m: float) -> Points:
    """The part of a line between two distances along it."""
    stations = curves.stations(line)
    inside = stations[(stations > first_m + SHORTEST_M / 10) & (stations < last_m - 0.1)]
    at = np.array([first_m, *inside, last_m])
    return np.stack([np.interp(at, stations, column) for column in line.T], axis=1)


def _stopping(net: Net) -> Iterator[NetEdge]:
    """Streets that end at a signal or a stop sign."""
    stopped = {link.from_edge for link in net.links if link.light or link.state in ("s", "w")}
    yield from (edge for edge in net.streets.values() if edge.id in stopped and edge.driving)


def _stop_line(edge: NetEdge) -> Iterator[Piece]:
    near, far = markings.STOP_LINE_SETBACK_M, markings.STOP_LINE_M + markings.STOP_LINE_SETBACK_M
    for lane in edge.driving:
        length = curves.length(lane.centre)
        if length > 2 * far:
            end = _between(lane.centre, length - far, length - near)
            yield _stripe(end, lane.width_m)
