"""The motion of people, who walk as SUMO's do, but neither hop nor spin."""

from collections.abc import Callable
from functools import partial

import numpy as np
import shapely
from advercity_dsl import Road
from numpy.typing import NDArray

from advercity.geometry.plane import compute_directions, compute_headings, compute_lengths
from advercity.roads.road_meshes import KERB_HEIGHT_M
from advercity.roads.road_network import build_road
from advercity.traffic.body_states import CATCH_UP_FACTOR, BodyCurves, build_states
from advercity.traffic.motion_spline import MotionSpline

KerbHeight = Callable[[NDArray[np.complex128]], NDArray[np.float64]]
"""Returns heights (n,) in m at points (n,), east + i north."""
WALKING_SMOOTHING_TICKS = 14
"""Ticks over which people turn, set out and stop.

A half turn takes 1.7 s, at 129 degrees/s at most; a turn by 90 degrees is half as fast. In daily
life healthy people turn at 43 degrees/s on average (Mancini et al., NeuroRehabilitation 37, 2015).
"""
STAGED_WALKING_SMOOTHING_TICKS = 8
"""Ticks for staged people, who stop short of vehicles."""
MAX_SIDESTEP_FRACTION = 0.5
"""Maximum sideways step of SUMO's people as a fraction of a step; more is a hop."""
MAX_SLOWING_FRACTION = 0.6
"""Fraction of its speed by which a person ahead of its place in SUMO slows down."""
CATCH_UP_TIME_S = 0.3
"""Time constant with which a person returns to its place in SUMO."""
MIN_CATCH_UP_FRACTION = 0.1
"""Minimum speed of the return as a fraction of the walking speed, so it comes to an end."""
MIN_HEADING_SPEED_M_S = 0.3
"""Speed below which a person keeps its heading."""


def compute_walker_states(
    track: NDArray[np.void],
    length_m: float,
    *,
    speed_m_s: float,
    tick_s: float,
    kerb_height: KerbHeight,
    smoothing_ticks: int = WALKING_SMOOTHING_TICKS,
) -> NDArray[np.void]:
    """Compute the states of one person, who stays upright and faces the walking direction.

    Half of a turn happens before the path turns, since people look ahead.

    Args:
        track: (n,) of `FRONT_DTYPE`, sorted by tick.
        length_m: Length of the body.
        speed_m_s: Walking speed.
        tick_s: Length of a tick.
        kerb_height: Height in m of the ground above SUMO's lanes at points (n,), east + i north.
        smoothing_ticks: Ticks over which it turns, sets out and stops.

    Returns:
        (n,) of `STATE_DTYPE`, with `actor` left at 0.
    """
    path = _walk_after(track, length_m, speed_m_s, tick_s)
    smooth = partial(MotionSpline.from_samples, tick_s=tick_s, ticks=smoothing_ticks)
    # People walking at either end of their track have walked before and walk on.
    steps = np.diff(path, prepend=path[0])
    plan = smooth(path, first_step=steps[:2][-1], last_step=steps[-1])
    height = smooth(_find_heights_along(path, track) + kerb_height(plan.values))
    yaw = smooth(_find_walking_headings(path, track, tick_s))
    upright = np.zeros((2, len(track)))
    motion = BodyCurves(plan.derivatives, height.derivatives, yaw.derivatives[:2], upright, upright)
    return build_states(track["tick"], track["lamps"], motion)


def _walk_after(
    track: NDArray[np.void], length_m: float, speed_m_s: float, tick_s: float
) -> NDArray[np.complex128]:
    """Compute the centres (n,) of a person who walks as SUMO's does, without hops.

    When SUMO's person hops, this one follows, or if it is ahead, lets the other come.
    """
    # SUMO turns waiting people hither and thither.
    walks = np.maximum.accumulate(np.where(track["speed"] > 0, np.arange(len(track)), 0))
    ahead = compute_directions(track["yaw"][walks])
    targets = track["x"] + 1j * track["y"] - length_m / 2 * ahead
    walk_m, limit_m = speed_m_s * tick_s, CATCH_UP_FACTOR * speed_m_s * tick_s
    steps, forward = np.diff(targets), (track["speed"] * tick_s * ahead)[1:]
    steps = np.where(
        compute_lengths(steps - forward) > MAX_SIDESTEP_FRACTION * walk_m, forward, steps
    )
    position = complex(targets[0])
    path = [position]
    for target, step in zip(targets[1:].tolist(), steps.tolist(), strict=True):
        gap, pace = target - position - step, abs(step)
        if pace > 0:
            gap_ahead = (gap * step.conjugate()).real / pace
            gap += step / pace * max(-MAX_SLOWING_FRACTION * pace - gap_ahead, 0.0)
        part = max(tick_s / CATCH_UP_TIME_S, MIN_CATCH_UP_FRACTION * walk_m / max(abs(gap), 1e-9))
        move = step + gap * min(1.0, part)
        position += move * min(1.0, limit_m / max(abs(move), 1e-9))
        path.append(position)
    return np.array(path)


def _find_heights_along(
    path: NDArray[np.complex128], track: NDArray[np.void]
) -> NDArray[np.float64]:
    """Find the heights (n,) of SUMO's lanes at a path (n,) behind or ahead of its front."""
    fronts = track["x"] + 1j * track["y"]
    stations = np.cumsum(compute_lengths(np.diff(fronts, prepend=fronts[0])))
    ahead_m = ((path - fronts) * compute_directions(-track["yaw"])).real
    return np.interp(stations + ahead_m, stations, track["z"])


def _find_walking_headings(
    path: NDArray[np.complex128], track: NDArray[np.void], tick_s: float
) -> NDArray[np.float64]:
    """Find the headings (n,) of a path (n,); at rest and in side steps the last one is kept."""
    moves = np.diff(path, prepend=path[0])
    walks = (compute_lengths(moves) > MIN_HEADING_SPEED_M_S * tick_s) & (track["speed"] > 0)
    return np.unwrap(np.concatenate([track["yaw"][:1], compute_headings(moves[walks])]))[
        np.cumsum(walks)
    ]


def build_kerb_height(road: Road) -> KerbHeight:
    """Build a function for the height of the ground above SUMO's lanes, 0 on the roadway.

    SUMO's sidewalks lie at the height of the roadway; ours lie on a kerb.
    """
    roadway = build_road(road).roadway_level_area
    shapely.prepare(roadway)
    return lambda places: np.where(
        shapely.contains_xy(roadway, places.real, places.imag), 0.0, KERB_HEIGHT_M
    )
