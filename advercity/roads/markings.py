"""Paint on the road: lines along streets, stop lines and zebra crossings.

Dimensions follow the Manual on Uniform Traffic Control Devices (2009): normal lines 10 to 15 cm,
broken lines 3 m with gaps of 9 m, dotted ones 0.6 m with gaps of 1.8 m, stop lines 30 to 60 cm,
bars of crossings 30 to 60 cm.
"""

from collections.abc import Callable, Iterator, Sequence

import numpy as np
import shapely
from advercity_dsl.road import RoadMark
from numpy.typing import NDArray
from shapely.affinity import rotate, translate

from advercity.geometry import polyline
from advercity.geometry.mesh import (
    Mesh,
    TriangleSurface,
    build_ribbon,
    merge_surfaces,
    triangulate_polygon,
)
from advercity.geometry.polyline import Points, StationedPolyline
from advercity.roads.arms import JunctionArm
from advercity.roads.layout import JunctionLayout, RoadLayout
from advercity.roads.streets import StreetLayout, StripLayout
from advercity.semantics import Semantic

MARKING_LIFT = np.array([0.0, 0.0, 0.009])
"""Height of paint over the roadway, and half of it over inlays: enough for a depth buffer, too
little to be seen."""
LINE_WIDTH_M = 0.12
DOUBLE_GAP_M = 0.12
DASH_LENGTH_M = 3.0
DASH_GAP_M = 9.0
STOP_LINE_M = 0.4
STOP_LINE_SETBACK_M = 0.2
GIVE_WAY_BLOCKS = 5
_GIVE_WAY_FRACTIONS = [
    (2 * index / (2 * GIVE_WAY_BLOCKS - 1), (2 * index + 1) / (2 * GIVE_WAY_BLOCKS - 1))
    for index in range(GIVE_WAY_BLOCKS)
]
"""Blocks of a give-way line across its width, with gaps of the same width between them."""
ZEBRA_BAR_M = 0.5
ARROW_FROM_END_M = 4.0
"""Distance from the end of a lane to the middle of its last arrow."""
ARROW_SPACING_M = 9.4
ARROW_HALF_LENGTH_M, MAX_ARROWS = 1.5, 3
"""Half the length of an arrow, and the most arrows in a row in a lane."""
DOT_LENGTH_M, DOT_GAP_M = 0.6, 1.8
"""Dotted lines, which guide through a junction."""
LONG_PATH_M, MIN_GUIDED_RAD = 16.0, np.radians(50)
"""Left turns before signals are guided if they are longer and turn by more."""
MAX_STRAIGHT_RAD = np.radians(30)
"""Movements with a smaller turn get a straight arrow."""

WHITE, YELLOW = "paint_white", "paint_yellow"
MARKING_MATERIALS = {
    RoadMark.SOLID_WHITE: WHITE,
    RoadMark.BROKEN_WHITE: WHITE,
    RoadMark.SOLID_YELLOW: YELLOW,
    RoadMark.BROKEN_YELLOW: YELLOW,
    RoadMark.DOUBLE_YELLOW: YELLOW,
}
BROKEN_PAINTS = (RoadMark.BROKEN_WHITE, RoadMark.BROKEN_YELLOW)
SOLID_MATERIALS: dict[RoadMark | None, str] = {
    RoadMark.SOLID_WHITE: WHITE,
    RoadMark.SOLID_YELLOW: YELLOW,
}


PAINT_KINDS = {name: (name, Semantic.ROAD_LINE) for name in (WHITE, YELLOW)}


def build_marking_meshes(layout: RoadLayout) -> list[Mesh]:
    """Build all paint, a mesh per colour."""
    pieces: dict[str, list[TriangleSurface]] = {WHITE: [], YELLOW: []}
    for street in layout.streets.values():
        for colour, piece in _street_lines(street):
            pieces[colour].append(piece)
    for junction in layout.junctions.values():
        pieces[WHITE] += [*_stop_lines(junction), *_arrows(junction), *_guide_lines(junction)]
        for crossing in junction.crossings:
            start, end = crossing.centre[:, :2]
            pieces[WHITE] += build_zebra_bars(
                start, end, width_m=crossing.width_m, height=junction.height_at
            )
        if junction.declared.control == "none":
            for colour, piece in _junction_lines(junction):
                pieces[colour].append(piece)
    return merge_surfaces(pieces, PAINT_KINDS)


def _street_lines(street: StreetLayout) -> Iterator[tuple[str, TriangleSurface]]:
    for strip in (*street.left_strips, *street.right_strips):
        for line in _parking_bay_lines(street, strip):
            yield WHITE, line
    for centre_t, paint in _line_offsets(street):
        length_m = float(street.stations[-1])
        broken = paint in BROKEN_PAINTS
        for first, last in dash_intervals(length_m) if broken else [(0.0, np.inf)]:
            yield MARKING_MATERIALS[paint], _stripe(street, centre_t, LINE_WIDTH_M, first, last)


def _line_offsets(street: StreetLayout) -> Iterator[tuple[float, RoadMark]]:
    """Yield the offset of the middle of every line along a street, and its paint."""
    borders = [
        (strip.outer_t, strip.paint) for strip in (*street.left_strips, *street.right_strips)
    ]
    for t, paint in (*borders, (0.0, street.axis_paint)):
        if paint is not None:
            shift = (LINE_WIDTH_M + DOUBLE_GAP_M) / 2 if paint is RoadMark.DOUBLE_YELLOW else 0.0
            yield from ((centre_t, paint) for centre_t in sorted({t - shift, t + shift}))


def marking_edge_offsets(street: StreetLayout) -> list[float]:
    """List offsets of both edges of all lines, where the road has edges of facets too.

    Paint over the inside of a facet of a bend would sink into it.
    """
    half = LINE_WIDTH_M / 2
    return [t + side for t, _ in _line_offsets(street) for side in (-half, half)]


def _parking_bay_lines(street: StreetLayout, strip: StripLayout) -> Iterator[TriangleSurface]:
    if strip.bay_width_m is None:
        return
    for at in np.arange(LINE_WIDTH_M, street.stations[-1], strip.bay_width_m):
        half = LINE_WIDTH_M / 2
        yield _stripe(street, strip.centre_t, strip.width_m, at - half, at + half)


def _junction_lines(junction: JunctionLayout) -> Iterator[tuple[str, TriangleSurface]]:
    """Continue solid lines through junctions where only a street's name or section changes."""
    for path in junction.connecting_paths:
        movement = path.movement
        source = junction.find_arm(movement.from_street)
        target = junction.find_arm(movement.to_street)
        leaving = source.street.find_lane(movement.from_lane, along=source.is_street_end)
        entering = target.street.find_lane(movement.to_lane, along=not target.is_street_end)
        centred = source.is_street_end and leaving.inner_t == entering.inner_t == 0
        last_lane = max(strip.lane_number for strip in target.outbound_strips())
        bordering = entering.lane_number == last_lane
        if centred and (colour := SOLID_MATERIALS.get(source.street.axis_paint)):
            yield colour, _border_line(path.left, path.right)
        if bordering and (colour := SOLID_MATERIALS.get(leaving.paint)):
            yield colour, _border_line(path.right[::-1], path.left[::-1])


def _border_line(border: Points, other: Points) -> TriangleSurface:
    """Build a line on one border of a path; the other border gives the direction across."""
    across = (border - other) / np.linalg.norm(border - other, axis=1, keepdims=True)
    outer, inner = border + across * LINE_WIDTH_M / 2, border - across * LINE_WIDTH_M / 2
    return build_paint(outer, inner)


def dash_intervals(length_m: float) -> list[tuple[float, float]]:
    """Compute the stations where dashes of a broken line begin and end."""
    starts = np.arange(DASH_GAP_M / 2, length_m - DASH_LENGTH_M, DASH_LENGTH_M + DASH_GAP_M)
    return [(float(start), float(start) + DASH_LENGTH_M) for start in starts]


def _stripe(
    street: StreetLayout, t: float, width_m: float, first: float, last: float
) -> TriangleSurface:
    """Build paint between two distances along the axis, on the facets of the road."""
    last = min(last, float(street.stations[-1]))
    left, right = (
        StationedPolyline(street.offset_line(edge), street.stations).cut(first, last).points
        for edge in (t + width_m / 2, t - width_m / 2)
    )
    return build_paint(left, right)


def build_paint(left: Points, right: Points) -> TriangleSurface:
    """Build paint between two lines (n, 3) on the roadway."""
    return build_ribbon(left + MARKING_LIFT, right + MARKING_LIFT)


def _stop_lines(junction: JunctionLayout) -> Iterator[TriangleSurface]:
    """Build bars across arriving lanes with a stop, and blocks across lanes that give way."""
    signs = {sign.street: sign.kind for sign in junction.declared.signs}
    for arm in junction.arms:
        kind = signs.get(arm.street.id)
        if junction.declared.control == "signals" or kind == "stop":
            yield from _stop_bar(arm, [(0.0, 1.0)])
        elif kind == "yield":
            yield from _stop_bar(arm, _GIVE_WAY_FRACTIONS)


def _stop_bar(
    arm: JunctionArm, fractions: Sequence[tuple[float, float]]
) -> Iterator[TriangleSurface]:
    """Build pieces of a bar between fractions of the arriving lanes' width."""
    lanes = [strip for strip in arm.inbound_strips() if strip.lane_number]
    if not lanes:
        return
    inner, outer = lanes[0].inner_t, lanes[-1].outer_t
    near, far = STOP_LINE_SETBACK_M, STOP_LINE_SETBACK_M + STOP_LINE_M
    end = float(arm.street.stations[-1])
    first, last = (end - far, end - near) if arm.is_street_end else (near, far)
    for begins, ends in fractions:
        edges = inner + begins * (outer - inner), inner + ends * (outer - inner)
        yield _stripe(arm.street, sum(edges) / 2, abs(edges[1] - edges[0]), first, last)


def _arrows(junction: JunctionLayout) -> Iterator[TriangleSurface]:
    """Build arrows on lanes; they point where the lane's movements lead."""
    for name, number in _list_lanes_with_arrows(junction):
        arm = junction.find_arm(name)
        lane = arm.street.find_lane(number, along=arm.is_street_end)
        turns = [
            junction.turn_angle(name, path.movement.to_street)
            for path in junction.connecting_paths
            if (path.movement.from_street, path.movement.from_lane) == (name, number)
        ]
        corners, triangles = triangulate_polygon(_arrow_outline(turns))
        length = float(arm.street.stations[-1])
        places = np.arange(ARROW_FROM_END_M, length - ARROW_HALF_LENGTH_M, ARROW_SPACING_M)
        for place in places[:MAX_ARROWS]:
            ahead = 1.0 if arm.is_street_end else -1.0
            middle = length - place if arm.is_street_end else place
            station, t = middle + ahead * corners[:, 0], lane.centre_t + ahead * corners[:, 1]
            yield TriangleSurface(arm.street.points_at(station, t) + MARKING_LIFT, triangles)


def _list_lanes_with_arrows(junction: JunctionLayout) -> list[tuple[str, int]]:
    """List streets and lanes: the declared ones, and before signals lanes side by side."""
    declared = [text.partition(".") for text in junction.declared.arrows]
    found = {(name, int(number)) for name, _, number in declared}
    return sorted(found | set(_list_lanes_side_by_side(junction)))


def _list_lanes_side_by_side(junction: JunctionLayout) -> Iterator[tuple[str, int]]:
    """List streets and lanes before signals on arms with several arriving lanes."""
    for arm in junction.arms if junction.declared.control == "signals" else ():
        lanes = [strip.lane_number for strip in arm.inbound_strips() if strip.lane_number]
        if len(lanes) > 1:
            yield from ((arm.street.id, number) for number in lanes)


def _guide_lines(junction: JunctionLayout) -> Iterator[TriangleSurface]:
    """Build dotted lines on the right of long left turns out of one of several lanes."""
    guided = set(_list_lanes_side_by_side(junction))
    crossings = [
        shapely.buffer(shapely.LineString(one.centre[:, :2]), one.width_m / 2 + DOT_LENGTH_M)
        for one in junction.crossings
    ]
    crossed = shapely.union_all(crossings)
    for path in junction.connecting_paths:
        turn = junction.turn_angle(path.movement.from_street, path.movement.to_street)
        border = StationedPolyline.from_points(path.right[:, :2])
        is_guided = (path.movement.from_street, path.movement.from_lane) in guided
        if not is_guided or turn < MIN_GUIDED_RAD or border.length_m < LONG_PATH_M:
            continue
        step = DOT_LENGTH_M + DOT_GAP_M
        for start in np.arange(DOT_GAP_M, border.length_m - DOT_LENGTH_M, step):
            dot = border.points_at([start, start + DOT_LENGTH_M])
            if shapely.intersects(crossed, shapely.LineString(dot)):
                continue  # pedestrians' bars have the road there
            across = LINE_WIDTH_M / 2 * polyline.left_normals(dot[1] - dot[0]) / DOT_LENGTH_M
            sides = (dot + across, dot - across)
            yield build_paint(
                *(np.column_stack([line, junction.height_at(line)]) for line in sides)
            )


def _arrow_outline(turns: Sequence[float]) -> shapely.Polygon:
    """Build an arrow with a head for each turn (radians); x is along the lane, y to its left."""
    shaft = shapely.box(-ARROW_HALF_LENGTH_M, -0.08, 0.3, 0.08)
    head = shapely.Polygon([(0.0, -0.35), (0.75, 0.0), (0.0, 0.35)])
    parts = [shaft]
    for turn in turns:
        if abs(turn) < MAX_STRAIGHT_RAD:
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


def build_zebra_bars(
    start: Points,
    end: Points,
    *,
    width_m: float,
    height: Callable[[Points], NDArray[np.float64]],
) -> Iterator[TriangleSurface]:
    """Build the bars of `place_zebra_bars`; `height` gives heights (n,) at points (n, 2)."""
    for bar in place_zebra_bars(start, end, width_m=width_m):
        yield build_paint(*(np.column_stack([line, height(line)]) for line in bar))


def place_zebra_bars(
    start: Points, end: Points, *, width_m: float
) -> Iterator[tuple[Points, Points]]:
    """Place bars of a crossing between points (2,) on both kerbs, across the walking direction.

    Each has a left and a right side (2, 2), `width_m` long.
    """
    across = float(np.linalg.norm(end - start))
    walking = (end - start) / across
    driving = np.array([walking[1], -walking[0]]) * width_m / 2
    count = int(across / (2 * ZEBRA_BAR_M))
    margin = (across - (2 * count - 1) * ZEBRA_BAR_M) / 2
    for bar in range(count):
        middle = start + (margin + (2 * bar + 0.5) * ZEBRA_BAR_M) * walking
        side = walking * ZEBRA_BAR_M / 2
        yield (
            np.stack([middle + side - driving, middle + side + driving]),
            np.stack([middle - side - driving, middle - side + driving]),
        )
