"""Plane curves that roads are drawn with: lines and arcs in a row, and links between two poses."""

from collections.abc import Iterable

import numpy as np
from advercity_dsl.road import Arc, Height, Line, Polyline
from numpy.typing import ArrayLike, NDArray

Points = NDArray[np.float64]
"""(n, 2) or (n, 3) points in metres."""

SAG_M = 0.01
"""How far a chord may run beside its arc."""
GRADE_CHANGE_M = 4.0
"""Length over which the grade changes where two slopes meet."""


def unit(heading: ArrayLike) -> Points:
    """Unit vectors (..., 2) of headings in radians."""
    heading = np.asarray(heading, dtype=np.float64)
    return np.stack([np.cos(heading), np.sin(heading)], axis=-1)


def left_of(direction: Points) -> Points:
    """Vectors (..., 2) turned left by a right angle."""
    return np.stack([-direction[..., 1], direction[..., 0]], axis=-1)


def length(points: Points) -> float:
    """Length of a polyline (n, d)."""
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def stations(points: Points) -> NDArray[np.float64]:
    """Distance (n,) of every point of a polyline (n, d) from its start."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def resampled(points: Points, count: int) -> Points:
    """`count` points (count, d) spread evenly along a polyline (n, d), ends kept."""
    at = stations(points)
    wanted = np.linspace(0.0, at[-1], count)
    return np.stack([np.interp(wanted, at, column) for column in points.T], axis=1)


def axis(
    start: tuple[float, float],
    heading: float,
    path: Iterable[Line | Arc | Polyline],
    *,
    line_step_m: float,
) -> tuple[Points, NDArray[np.float64], NDArray[np.float64]]:
    """Sample lines and arcs that follow each other smoothly.

    Args:
        start: First point.
        heading: Direction there, radians counter-clockwise from east.
        path: Pieces in order.
        line_step_m: Largest distance between samples on lines; on arcs it is at most 2 m.

    Returns:
        Points (n, 2), headings (n,) and distances along the curve (n,); piece ends are among them.
    """
    points, headings, along = [np.array([start])], [np.array([heading])], [np.zeros(1)]
    for piece in path:
        here, direction, travelled = points[-1][-1], headings[-1][-1], along[-1][-1]
        match piece:
            case Line():
                s = _steps(piece.line_m, line_step_m)
                points.append(here + s[:, None] * unit(direction))
                headings.append(np.full(len(s), direction))
            case Arc():
                s = _steps(piece.arc_m, min(2.0, np.sqrt(8 * piece.radius_m * SAG_M)))
                side = 1.0 if piece.turn == "left" else -1.0
                turned = direction + side * s / piece.radius_m
                centre = here + side * piece.radius_m * left_of(unit(direction))
                points.append(centre - side * piece.radius_m * left_of(unit(turned)))
                headings.append(turned)
            case Polyline():
                corners = np.vstack([here, piece.points_m])
                s = stations(corners)[1:]
                points.append(corners[1:])
                headings.append(np.arctan2(*np.diff(corners, axis=0).T[::-1]))
        along.append(travelled + s)
    return np.concatenate(points), np.concatenate(headings), np.concatenate(along)


def _steps(total: float, step: float) -> NDArray[np.float64]:
    count = int(np.ceil(total / step - 1e-9))
    return np.linspace(0.0, total, count + 1)[1:]


def heights(along: NDArray[np.float64], declared: tuple[Height, ...]) -> NDArray[np.float64]:
    """Height (n,) at distances along an axis: straight grades, rounded where they meet.

    Rounding is the mean over `GRADE_CHANGE_M`, which makes the parabola of a vertical curve. It
    fades towards both ends, whose heights stay as declared.
    """
    if not declared:
        return np.zeros_like(along)
    at = np.array([item.at_m for item in declared])
    z = np.array([item.z_m for item in declared])
    reach = np.minimum(GRADE_CHANGE_M / 2, np.minimum(along, along[-1] - along))
    window = along[:, None] + reach[:, None] * np.linspace(-1.0, 1.0, 17)
    return np.interp(window, at, z).mean(axis=1)


def offset(points: Points, headings: NDArray[np.float64], t: ArrayLike) -> Points:
    """Points (..., 2) moved by `t` metres to the left of the direction of travel."""
    return points + np.asarray(t, dtype=np.float64)[..., None] * left_of(unit(headings))


def link(
    start: Points, out: Points, end: Points, into: Points, *, radius_m: float = np.inf
) -> Points:
    """Smooth curve from one pose to another.

    Where the tangents meet ahead of both, it is straight, an arc of at most `radius_m`, straight;
    otherwise a cubic Bézier curve.

    Args:
        start: (2,) first point.
        out: (2,) unit direction there.
        end: (2,) last point.
        into: (2,) unit direction there.
        radius_m: Largest radius of the arc.

    Returns:
        (n, 2) points, no more than 1 m apart on the bend.
    """
    cross = float(out[0] * into[1] - out[1] * into[0])
    gap = end - start
    if abs(cross) > 0.05:
        before = float(gap[0] * into[1] - gap[1] * into[0]) / cross
        after = float(out[0] * gap[1] - out[1] * gap[0]) / cross
        if min(before, after) > 0.05:
            turn = float(np.arctan2(cross, out @ into))
            radius = min(radius_m, min(before, after) / np.tan(abs(turn) / 2))
            return _rounded_corner(start, out, end, turn, before, radius)
    elif abs(float(out @ left_of(gap))) < 0.02:
        return np.stack([start, end])
    reach = 0.4 * float(np.linalg.norm(gap))
    s = np.linspace(0.0, 1.0, max(3, int(np.ceil(np.linalg.norm(gap)))) + 1)[:, None]
    return (
        (1 - s) ** 3 * start
        + 3 * (1 - s) ** 2 * s * (start + reach * out)
        + 3 * (1 - s) * s**2 * (end - reach * into)
        + s**3 * end
    )


def _rounded_corner(
    start: Points, out: Points, end: Points, turn: float, before: float, radius: float
) -> Points:
    """Straight on, an arc that turns by `turn`, straight on to `end`."""
    side = np.sign(turn)
    first = start + (before - radius * np.tan(abs(turn) / 2)) * out
    centre = first + side * radius * left_of(out)
    count = max(3, int(np.ceil(max(abs(turn) * radius, abs(turn) * 6))))
    heading = np.arctan2(out[1], out[0]) + np.linspace(0.0, turn, count + 1)
    arc = centre - side * radius * left_of(unit(heading))
    return without_repeats(np.vstack([start, arc, end]))


def without_repeats(points: Points) -> Points:
    """A polyline (n, d) without points that only repeat the one before."""
    keep = np.linalg.norm(np.diff(points, axis=0), axis=1) > 1e-6
    return points[np.concatenate([[True], keep])]
