"""Plane curves of roads: reference lines of lines and arcs, and curves between two poses."""

from collections.abc import Iterable

import numpy as np
from advercity_dsl.road import AxisArc, AxisHeight, AxisLine, AxisPoints
from numpy.typing import NDArray

from advercity.geometry.polyline import (
    Points,
    drop_repeated_points,
    left_normals,
    polyline_stations,
    unit_vectors,
)

MAX_ARC_STEP_M = 2.0
"""Between samples of an arc, however flat it is."""
MAX_CHORD_ERROR_M = 0.01
"""Largest distance between an arc and its chords."""
VERTICAL_CURVE_LENGTH_M = 4.0
"""Length over which the grade changes where two slopes meet."""


def sample_reference_line(
    start: tuple[float, float],
    heading: float,
    path: Iterable[AxisLine | AxisArc | AxisPoints],
    *,
    line_step_m: float,
) -> tuple[Points, NDArray[np.float64], NDArray[np.float64]]:
    """Sample lines and arcs, each of which continues from the end of the one before.

    `heading` is the direction at `start`, radians counter-clockwise from east; corners of
    `AxisPoints` are not rounded. Returns points (n, 2), headings (n,) and arc lengths (n,); the
    ends of the pieces are among them.
    """
    points, headings, along = [np.array([start])], [np.array([heading])], [np.zeros(1)]
    for piece in path:
        here, direction, travelled = points[-1][-1], headings[-1][-1], along[-1][-1]
        match piece:
            case AxisLine():
                s = _even_stations(piece.line_m, line_step_m)
                points.append(here + s[:, None] * unit_vectors(direction))
                headings.append(np.full(len(s), direction))
            case AxisArc():
                chord_m = np.sqrt(8 * piece.radius_m * MAX_CHORD_ERROR_M)
                s = _even_stations(piece.arc_m, min(MAX_ARC_STEP_M, chord_m))
                side = 1.0 if piece.turn == "left" else -1.0
                turned = direction + side * s / piece.radius_m
                centre = here + side * piece.radius_m * left_normals(unit_vectors(direction))
                points.append(centre - side * piece.radius_m * left_normals(unit_vectors(turned)))
                headings.append(turned)
            case AxisPoints():
                corners = np.vstack([here, piece.points_m])
                s = polyline_stations(corners)[1:]
                points.append(corners[1:])
                headings.append(np.arctan2(*np.diff(corners, axis=0).T[::-1]))
        along.append(travelled + s)
    return np.concatenate(points), np.concatenate(headings), np.concatenate(along)


def _even_stations(total: float, step: float) -> NDArray[np.float64]:
    # Without the tolerance, rounding adds a sample to lengths of whole steps.
    count = int(np.ceil(total / step - 1e-9))
    return np.linspace(0.0, total, count + 1)[1:]


def sample_elevation(
    along: NDArray[np.float64], declared: tuple[AxisHeight, ...]
) -> NDArray[np.float64]:
    """Compute heights (n,) at distances along an axis: straight grades, rounded where they meet.

    A height is the mean over `VERTICAL_CURVE_LENGTH_M`, which makes the parabola of a vertical
    curve. The length falls to 0 towards both ends, where heights stay as declared.
    """
    if not declared:
        return np.zeros_like(along)
    at = np.array([item.at_m for item in declared])
    z = np.array([item.z_m for item in declared])
    half_m = np.minimum(VERTICAL_CURVE_LENGTH_M / 2, np.minimum(along, along[-1] - along))
    window = along[:, None] + half_m[:, None] * np.linspace(-1.0, 1.0, 17)
    return np.interp(window, at, z).mean(axis=1)


def build_connecting_curve(
    start: Points,
    start_direction: Points,
    end: Points,
    end_direction: Points,
    *,
    radius_m: float = np.inf,
) -> Points:
    """Build a smooth curve (n, 2) from one pose (point and unit direction) to another.

    Where the tangents meet in front of the start and behind the end, it is a line, an arc of at
    most `radius_m` and a line, with points 1 m apart at most; otherwise a cubic Bézier curve.
    """
    cross = float(start_direction[0] * end_direction[1] - start_direction[1] * end_direction[0])
    gap = end - start
    if abs(cross) > 0.05:
        before = float(gap[0] * end_direction[1] - gap[1] * end_direction[0]) / cross
        after = float(start_direction[0] * gap[1] - start_direction[1] * gap[0]) / cross
        if min(before, after) > 0.05:
            turn = float(np.arctan2(cross, start_direction @ end_direction))
            radius = min(radius_m, min(before, after) / np.tan(abs(turn) / 2))
            return _rounded_corner(start, start_direction, end, turn, before, radius)
    elif abs(float(start_direction @ left_normals(gap))) < 0.02:
        return np.stack([start, end])
    # 0.4 of the distance makes the cubic close to an arc for turns of up to a right angle.
    handle = 0.4 * float(np.linalg.norm(gap))
    s = np.linspace(0.0, 1.0, max(3, int(np.ceil(np.linalg.norm(gap)))) + 1)[:, None]
    return (
        (1 - s) ** 3 * start
        + 3 * (1 - s) ** 2 * s * (start + handle * start_direction)
        + 3 * (1 - s) * s**2 * (end - handle * end_direction)
        + s**3 * end
    )


def _rounded_corner(
    start: Points, out: Points, end: Points, turn: float, before: float, radius: float
) -> Points:
    """Build a line, an arc with a turn of `turn` radians and a line to `end`.

    `before` is the distance in metres from the start to the point where both tangents meet.
    """
    side = np.sign(turn)
    first = start + (before - radius * np.tan(abs(turn) / 2)) * out
    centre = first + side * radius * left_normals(out)
    count = max(3, int(np.ceil(max(abs(turn) * radius, abs(turn) * 6))))
    heading = np.arctan2(out[1], out[0]) + np.linspace(0.0, turn, count + 1)
    arc = centre - side * radius * left_normals(unit_vectors(heading))
    return drop_repeated_points(np.vstack([start, arc, end]))
