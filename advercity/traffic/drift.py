"""Leaving one's lane to the left and coming back, over what SUMO records of a vehicle."""

import numpy as np
from numpy.typing import NDArray

from advercity.traffic.encounters import Track

BACK_BEFORE_S = 0.15
"""The drifting vehicle is back in its lane this long before both fronts meet."""


def nearest_tick(ego: Track, other: Track) -> tuple[int, float]:
    """The tick at which the middles of two tracks are nearest, and their distance there."""
    ticks = np.intersect1d(ego.rows["tick"], other.rows["tick"])
    gaps = np.linalg.norm(ego.at(ticks).middles - other.at(ticks).middles, axis=1)
    least = int(np.argmin(gaps))
    return int(ticks[least]), float(gaps[least])


def excursion(
    times_s: NDArray[np.float64],
    *,
    shift_m: float,
    out_s: float,
    beside_s: float,
    back_s: float,
    ends_s: float,
) -> NDArray[np.float64]:
    """Offsets (n,) to the left at times (n,): out, beside the lane for a while, and back by an end.

    Both are quintic, so that lateral speed and acceleration begin and end at zero.
    """
    turns_s = ends_s - back_s
    out = _quintic((times_s - turns_s + beside_s + out_s) / out_s)
    back = _quintic((times_s - turns_s) / back_s)
    return shift_m * (out - back)


def _quintic(share: NDArray[np.float64]) -> NDArray[np.float64]:
    u = np.clip(share, 0.0, 1.0)
    return u**3 * (10 - 15 * u + 6 * u**2)


def shifted(
    track: NDArray[np.void], offsets: NDArray[np.float64], tick_s: float
) -> NDArray[np.void]:
    """`FRONT` rows moved to the left by offsets (n,), with the yaw that this takes."""
    rows = track.copy()
    rows["x"] -= offsets * np.sin(track["yaw"])
    rows["y"] += offsets * np.cos(track["yaw"])
    sideways = np.gradient(offsets, tick_s)
    rows["yaw"] += np.where(
        track["speed"] > 1.0, np.arctan2(sideways, np.maximum(track["speed"], 1.0)), 0.0
    )
    return rows
