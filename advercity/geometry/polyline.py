"""advercity.geometry.polyline."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Points = NDArray[np.float64]
"""(n, 2) or (n, 3) points in metres."""


def unit_vectors(heading: ArrayLike) -> Points:
    """Unit vectors (..., 2) of headings in radians."""
    heading = np.asarray(heading, dtype=np.float64)
    return np.stack([np.cos(heading), np.sin(heading)], axis=-1)


def left_normals(direction: Points) -> Points:
    """Vectors (..., 2) turned left by a right angle."""
    return np.stack([-direction[..., 1], direction[..., 0]], axis=-1)


def polyline_length(points: Points) -> float:
    """Length of a polyline (n, d)."""
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def polyline_stations(points: Points) -> NDArray[np.float64]:
    """Distance (n,) of every point of a polyline (n, d) from its start."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def resample_polyline(points: Points, count: int) -> Points:
    """`count` points (count, d) spread evenly along a polyline (n, d), ends kept."""
    at = polyline_stations(points)
    wanted = np.linspace(0.0, at[-1], count)
    return np.stack([np.interp(wanted, at, column) for column in points.T], axis=1)


def offset_points(points: Points, headings: NDArray[np.float64], t: ArrayLike) -> Points:
    """Points (..., 2) moved by `t` metres to the left of the direction of travel."""
    return points + np.asarray(t, dtype=np.float64)[..., None] * left_normals(
        unit_vectors(headings)
    )


def drop_repeated_points(points: Points) -> Points:
    """A polyline (n, d) without points that only repeat the one before."""
    keep = np.linalg.norm(np.diff(points, axis=0), axis=1) > 1e-6
    return points[np.concatenate([[True], keep])]


MITRE_LIMIT = 2.0


def offset_polyline(line: Points, lateral_m: float) -> Points:
    """Line (n, 3) moved to the left, its corners mitred."""
    steps = np.diff(line[:, :2], axis=0)
    normals = left_normals(steps / np.linalg.norm(steps, axis=1, keepdims=True))
    before, after = np.vstack([normals[:1], normals]), np.vstack([normals, normals[-1:]])
    middle = before + after
    squared = np.maximum((middle**2).sum(axis=1, keepdims=True), 4 / MITRE_LIMIT**2)
    return np.column_stack([line[:, :2] + lateral_m * 2 * middle / squared, line[:, 2]])
