"""Position and clock of a receiver from ranges to satellites, and the dilution of precision."""

import math
from dataclasses import dataclass

import numpy as np

from advercity.geometry.arrays import Float64Array

_ITERATIONS = 8
"""Newton's steps from the site's origin; each doubles the digits."""


@dataclass(frozen=True)
class Dilution:
    """Dilution of precision: standard deviations of a fix over the ranges' standard deviation."""

    position: float
    horizontal: float
    vertical: float


def solve_position(
    satellites: Float64Array, ranges_m: Float64Array, sd_m: Float64Array
) -> Float64Array | None:
    """Solve for the position (3,) by weighted least squares over pseudoranges.

    The unknowns are x, y, z and the clock, as in Kaplan and Hegarty, Understanding GPS/GNSS, 11.2.

    Args:
        satellites: (n, 3) in the world frame, metres.
        ranges_m: (n,) pseudoranges, all with the same error of the clock.
        sd_m: (n,) standard deviations assumed by the receiver.

    Returns:
        The position in the world frame; None if the satellites do not determine it.
    """
    if len(satellites) < 4:
        return None
    position, clock_m = np.zeros(3), 0.0
    for _ in range(_ITERATIONS):
        away = position - satellites
        distances = np.linalg.norm(away, axis=1)
        design = np.column_stack([away / distances[:, None], np.ones(len(away))]) / sd_m[:, None]
        residual = (ranges_m - distances - clock_m) / sd_m
        normal = design.T @ design
        if np.linalg.cond(normal) > 1e12:
            return None
        step = np.linalg.solve(normal, design.T @ residual)
        position, clock_m = position + step[:3], clock_m + float(step[3])
    return position


def compute_dilution(directions: Float64Array) -> Dilution:
    """Compute the dilution of precision of four or more directions (n, 3), up along z."""
    design = np.column_stack([directions, np.ones(len(directions))])
    east, north, up, _ = np.diag(np.linalg.inv(design.T @ design)).tolist()
    return Dilution(
        position=math.sqrt(east + north + up),
        horizontal=math.sqrt(east + north),
        vertical=math.sqrt(up),
    )
