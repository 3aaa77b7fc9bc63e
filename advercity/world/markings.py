"""Paint on the road: lines along streets, stop lines and zebra crossings.

Dimensions follow the Manual on Uniform Traffic Control Devices (2009): normal lines 10 to 15 cm,
broken lines 3 m with gaps of 9 m, stop lines 30 to 60 cm, bars of crossings 30 to 60 cm.
"""

from collections.abc import Callable, Iterator, Sequence

import numpy as np
import shapely
from advercity_dsl.road import Paint
from numpy.typing import NDArray
from shapely.affinity import rotate, translate

from advercity.curves import Points
from advercity.semantics import Semantic
from advercity.streets import Band, StreetLayout
from advercity.world.junctions import Arm, JunctionLayout
from advercity.world.layout import Layout
from advercity.world.meshing import Piece, filled, mesh, ribbon
from advercity.world.scene import Mesh

LIFT = np.array([0.0, 0.0, 0.007])
LINE_WIDTH_M = 0.12
DOUBLE_GAP_M = 0.12
DASH_M = 3.0
GAP_M = 9.0
STOP_LINE_M = 0.4
STOP_LINE_SETBACK_M = 0.2
GIVE_WAY_BLOCKS = 5
_BLOCKS = [
    (2 * index / (2 * GIVE_WAY_BLOCKS - 1), (2 * index + 1) / (2 * GIVE_WAY_BLOCKS - 1))
    for index in range(GIVE_WAY_BLOCKS)
]
"""A give-way line: as many blocks as that, and gaps as wide between them."""
BAR_M = 0.5
ARROW_FROM_END_M = 4.0
"""From the end of a lane to the middle of the last arrow on it."""
ARROW_SPACING_M = 9.4
ARROW_REACH_M = 1.5
STRAIGHT_RAD = np.radians(30)
"""Those who turn by less go straight on."""

WHITE, YELLOW = "paint_white", "paint_yellow"
COLOURS = {
    Paint.SOLID_WHITE: WHITE,
    Paint.BROKEN_WHITE: WHITE,
    Paint.SOLID_YELLOW: YELLOW,
    Paint.BROKEN_YELLOW: YELLOW,
    Paint.DOUBLE_YELLOW: YELLOW,
}
BROKEN = (Paint.BROKEN_WHITE, Paint.BROKEN_YELLOW)
SOLID: dict[Paint | None, str] = {Paint.SOLID_WHITE: WHITE, Paint.SOLID_YELLOW: YELLOW}


def meshes(layout: Layout) -> list[Mesh]:
    """All paint, a mesh per colour."""
    pieces: dict[str, list[Piece]] = {WHITE: [], YELLOW: []}
    for street in layout.streets.values():
        for colour, piece in _lines(street):
            pieces[colour].append(piece)
    for junction in layout.junctions.values():
        pieces[WHITE] += [*_stop_lines(junction), *_arrows(junction)]
        for crossing in junction.crossings:
            start, end = crossing.centre[:, :2]
            pieces[WHITE] += zebra(start, end, width_m=crossing.width_m, height=junction.height)
        if junction.declared.control == "none":
            for colour, piece in _lines_through(junction):
                pieces[colour].append(piece)
    return [
        mesh(colour, found, colour, Semantic.ROAD_LINE) for colour, found in pieces.items() if found
    ]


def _lines(street: StreetLayout) -> Iterator[tuple[str, Piece]]:
    for band in (*street.left, *street.right):
        for line in _bay_lines(street, band):
            yield WHITE, line
    for centre_t, paint in _painted(street):
        for first, last in (
            dashes(float(street.stations[-1])) if paint in BROKEN else [(0.0, np.inf)]
        ):
            yield COLOURS[paint], _stripe(street, centre_t, LINE_WIDTH_M, first, last)


def _painted(street: StreetLayout) -> Iterator[tuple[float, Paint]]:
    """Offset of the middle of every line along a street, and its paint."""
    borders = [(band.outer_t, band.paint) for band in (*street.left, *street.right)]
    for t, paint in (*borders, (0.0, street.axis_paint)):
        if paint is not None:
            shift = (LINE_WIDTH_M + DOUBLE_GAP_M) / 2 if paint is Paint.DOUBLE_YELLOW else 0.0
            yield from ((centre_t, paint) for centre_t in sorted({t - shift, t + shift}))


def line_edges(street: StreetLayout) -> list[float]:
    """Offsets of both edges of all lines, where the road's facets divide, so as to bear them."""
    half = LINE_WIDTH_M / 2
    return [t + side for t, _ in _painted(street) for side in (-half, half)]


def _bay_lines(street: StreetLayout, band: Band) -> Iterator[Piece]:
    if band.bay_m is None:
        return
    for at in np.arange(LINE_WIDTH_M, street.stations[-1], band.bay_m):
        half = LINE_WIDTH_M / 2
        yield _stripe(street, band.centre_t, band.width_m, at - half, at + half)


def _lines_through(junction: JunctionLayout) -> Iterator[tuple[str, Piece]]:
    """Solid lines of two streets that go on into each other."""
    for path in junction.paths:
        movement = path.movement
        source, target = junction.arm(movement.from_street), junction.arm(movement.to_street)
        leaving = source.street.lane(movement.from_lane, along=source.at_end)
        entering = target.street.lane(movement.to_lane, along=not target.at_end)
        centred = source.at_end and leaving.inner_t == entering.inner_t == 0
        bordering = entering.number == max(band.number for band in target.leaving())
        if centred and (colour := SOLID.get(source.street.axis_paint)):
            yield colour, _line_along(path.left, path.right)
        if bordering and (colour := SOLID.get(leaving.paint)):
            yield colour, _line_along(path.right[::-1], path.left[::-1])


def _line_along(border: Points, other: Points) -> Piece:
    """A line on one border of a way, whose other border says which way across it goes."""
    across = (border - other) / np.linalg.norm(border - other, axis=1, keepdims=True)
    outer, inner = border + across * LINE_WIDTH_M / 2, border - across * LINE_WIDTH_M / 2
    return _lifted(outer, inner)


def dashes(length_m: float) -> list[tuple[float, float]]:
    """Where the dashes of a broken line begin and end."""
    starts = np.arange(GAP_M / 2, length_m - DASH_M, DASH_M + GAP_M)
    return [(float(start), float(start) + DASH_M) for start in starts]


def _stripe(street: StreetLayout, t: float, width_m: float, first: float, last: float) -> Piece:
    """Paint between two distances along the axis, which follows the facets of the road."""
    last = min(last, float(street.stations[-1]))
    between = street.stations[(street.stations > first) & (street.stations < last)]
    at = np.array([first, *between, last])
    left, right = (
        np.stack([np.interp(at, street.stations, column) for column in street.line(edge).T], axis=1)
        for edge in (t + width_m / 2, t - width_m / 2)
    )
    return _lifted(left, right)


def _lifted(left: Points, right: Points) -> Piece:
    return ribbon(left + LIFT, right + LIFT)


def _stop_lines(junction: JunctionLayout) -> Iterator[Piece]:
    """A bar across the arriving lanes where traffic stops, blocks where it gives way."""
    signs = {sign.street: sign.kind for sign in junction.declared.signs}
    for arm in junction.arms:
        kind = signs.get(arm.street.id)
        if junction.declared.control == "signals" or kind == "stop":
            yield from _bar_across(arm, [(0.0, 1.0)])
        elif kind == "yield":
            yield from _bar_across(arm, _BLOCKS)


def _bar_across(arm: Arm, shares: Sequence[tuple[float, float]]) -> Iterator[Piece]:
    """Pieces of a bar, each from one share of the arriving lanes' width to another."""
    lanes = [band for band in arm.arriving() if band.number]
    if not lanes:
        return
    inner, outer = lanes[0].inner_t, lanes[-1].outer_t
    near, far = STOP_LINE_SETBACK_M, STOP_LINE_SETBACK_M + STOP_LINE_M
    end = float(arm.street.stations[-1])
    first, last = (end - far, end - near) if arm.at_end else (near, far)
    for begins, ends in shares:
        edges = inner + begins * (outer - inner), inner + ends * (outer - inner)
        yield _stripe(arm.street, sum(edges) / 2, abs(edges[1] - edges[0]), first, last)


def _arrows(junction: JunctionLayout) -> Iterator[Piece]:
    """Arrows on the lanes that have them, which point where their movements lead."""
    for text in junction.declared.arrows:
        name, _, number = text.partition(".")
        arm = junction.arm(name)
        lane = arm.street.lane(int(number), along=arm.at_end)
        turns = [
            junction.turn(name, path.movement.to_street)
            for path in junction.paths
            if (path.movement.from_street, path.movement.from_lane) == (name, int(number))
        ]
        corners, triangles = filled(_arrow(turns))
        length = float(arm.street.stations[-1])
        for back in np.arange(ARROW_FROM_END_M, length - ARROW_REACH_M, ARROW_SPACING_M):
            ahead = 1.0 if arm.at_end else -1.0
            middle = length - back if arm.at_end else back
            station, t = middle + ahead * corners[:, 0], lane.centre_t + ahead * corners[:, 1]
            yield Piece(arm.street.at(station, t) + LIFT, triangles)


def _arrow(turns: Sequence[float]) -> shapely.Polygon:
    """An arrow with a head for each way, x along the lane and y to its left, metres."""
    shaft = shapely.box(-ARROW_REACH_M, -0.08, 0.3, 0.08)
    head = shapely.Polygon([(0.0, -0.35), (0.75, 0.0), (0.0, 0.35)])
    parts = [shaft]
    for turn in turns:
        if abs(turn) < STRAIGHT_RAD:
            parts += [shapely.box(0.2, -0.08, 0.8, 0.08), translate(head, 0.75, 0.0)]
        else:
            side = np.sign(turn)
            parts += [
                shapely.box(0.14, min(0.0, 0.5 * side), 0.3, max(0.0, 0.5 * side)),
                translate(rotate(head, 90 * side, origin=(0, 0)), 0.22, 0.45 * side),
            ]
    joined = shapely.union_all(parts)
    assert isinstance(joined, shapely.Polygon)
    return joined


def zebra(
    start: Points,
    end: Points,
    *,
    width_m: float,
    height: Callable[[Points], NDArray[np.float64]],
) -> Iterator[Piece]:
    """Bars of a crossing from kerb to kerb, (2,) each, on a roadway whose height is given."""
    across = float(np.linalg.norm(end - start))
    walking = (end - start) / across
    driving = np.array([walking[1], -walking[0]]) * width_m / 2
    count = int(across / (2 * BAR_M))
    margin = (across - (2 * count - 1) * BAR_M) / 2
    for bar in range(count):
        middle = start + (margin + (2 * bar + 0.5) * BAR_M) * walking
        left, right = (
            np.stack([middle + side - driving, middle + side + driving])
            for side in (walking * BAR_M / 2, -walking * BAR_M / 2)
        )
        yield _lifted(*(np.column_stack([line, height(line)]) for line in (left, right)))
