"""Speed of vehicles in bends, limited by lateral acceleration and its change."""

from math import cbrt, inf

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

LATERAL_ACCELERATION_M_S2 = 3.5
"""Brisk but comfortable; the original's planner allowed 5."""
LATERAL_JERK_M_S3 = 5.5
"""Along the lane; the smooth motion of a vehicle has four fifths of it, at most 5."""
CURVATURE_CHANGE_M = 9.0
"""Length over which the change of curvature counts: a part of the distance driven in a second."""
BEND_STEP_M = 1.0
"""Distance of the points of a path."""
CURVATURE_CHORD_M = 4.0
"""Distance of the three points for a curvature: corners of polylines vanish."""
SMOOTHING_WINDOW_M = 6.0
"""Half width of the window in which drivers keep to the lowest speed."""
MAX_BEND_SPEED_M_S = 50.0


def compute_bend_speeds(
    path: NDArray[np.float64], max_lateral_m_s2: float = inf
) -> NDArray[np.float64]:
    """Compute the highest speeds (n,) in m/s on a path (n, 2) of points every `BEND_STEP_M`."""
    lateral = min(LATERAL_ACCELERATION_M_S2, max_lateral_m_s2)
    curvature = _compute_curvature(path)
    by_acceleration = np.sqrt(lateral / np.maximum(np.abs(curvature), 1e-9))
    changes = np.maximum(_compute_curvature_change(curvature), 1e-9)
    # Not by NumPy's root: its last bit differs with AVX-512, and SUMO would drive otherwise.
    by_jerk = [cbrt(LATERAL_JERK_M_S3 / change) for change in changes.tolist()]
    limit = np.minimum(by_acceleration, by_jerk)
    return _smooth_speeds(np.minimum(limit, MAX_BEND_SPEED_M_S))


def _compute_curvature(path: NDArray[np.float64]) -> NDArray[np.float64]:
    """Compute the curvature (n,) in 1/m of a path (n, 2): of the circle through three points.

    It is positive to the left.
    """
    step = round(CURVATURE_CHORD_M / BEND_STEP_M)
    curvature = np.zeros(len(path))
    if len(path) <= 2 * step:
        return curvature
    before, here, after = path[: -2 * step], path[step:-step], path[2 * step :]
    first, second, chord = here - before, after - here, after - before
    area = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    sides = np.prod([np.linalg.norm(side, axis=1) for side in (first, second, chord)], axis=0)
    curvature[step:-step] = 2 * area / np.maximum(sides, 1e-9)
    return curvature


def _compute_curvature_change(curvature: NDArray[np.float64]) -> NDArray[np.float64]:
    """Compute the change of curvature (n,) per metre, in 1/m²."""
    half_width = round(CURVATURE_CHANGE_M / BEND_STEP_M / 2 - 0.5)
    smooth = _build_windows(curvature, half_width).mean(axis=1)
    return np.abs(np.gradient(smooth, BEND_STEP_M))


def _smooth_speeds(limit: NDArray[np.float64]) -> NDArray[np.float64]:
    """Smooth speeds (n,) without exceeding the limit: the mean of the windows' minima."""
    half_width = round(SMOOTHING_WINDOW_M / BEND_STEP_M)
    lowest = _build_windows(limit, half_width).min(axis=1)
    return _build_windows(lowest, half_width).mean(axis=1)


def _build_windows(values: NDArray[np.float64], half_width: int) -> NDArray[np.float64]:
    """View the neighbourhood of each of the values (n,): (n, 2 half_width + 1)."""
    return sliding_window_view(np.pad(values, half_width, mode="edge"), 2 * half_width + 1)
