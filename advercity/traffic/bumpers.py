"""From where SUMO has the front bumpers to where the bodies are."""

from collections.abc import Callable
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from advercity.traffic.trace import STATE, Lamp

Number = TypeVar("Number", np.float64, np.complex128)
FRONT = np.dtype(
    [
        ("tick", "<i4"),
        ("id", "<i4"),
        ("x", "<f8"),
        ("y", "<f8"),
        ("z", "<f8"),
        ("yaw", "<f8"),
        ("slope", "<f8"),
        ("speed", "<f8"),
        ("acceleration", "<f8"),
        ("lamps", "<u1"),
    ]
)
"""An actor at one tick: middle of its front, heading and slope of its lane (rad), m/s, m/s²."""

CATCH_UP = 1.3
"""SUMO's people hop onto crossings and its vehicles slide aside while they stand; here everybody
gets there by moving on, no faster than this times their speed."""
EASING_TICKS = 5
"""SUMO's people start and stop at once and its drivers dab at the pedals; here it takes them this
long."""
STROLL_TICKS = 9
"""People take this long to turn round."""
COASTING_M_S2 = 0.3
"""Slowing down more than this takes the brakes."""
STANDING_M_S = 0.1
WHEELBASE_SHARE = 0.6
"""Of a vehicle's length."""
MOST_STEERING = np.radians(40.0)
TURN_RATE_RAD_S = np.pi
WALKING_M_S = 0.3
"""Slower than this a person keeps looking the same way."""


def vehicle_states(track: NDArray[np.void], length_m: float, *, tick_s: float) -> NDArray[np.void]:
    """States of one vehicle from its fronts, both sorted by tick.

    The front axle goes where the front bumper went and draws the rear axle behind it, which rolls
    and never slides: so the body cuts corners as real ones do. An axle is as high as the front was
    when it passed there; before the first tick the lane is taken to go on at its slope. Brake
    lamps are lit while it slows down and while it is held standing.
    """
    fronts = _followed(track["x"] + 1j * track["y"], CATCH_UP * track["speed"] * tick_s)
    steps = np.abs(np.diff(fronts, prepend=fronts[0]))
    along = np.cumsum(steps)
    wheelbase = WHEELBASE_SHARE * length_m
    overhang = (length_m - wheelbase) / 2
    first_yaw, slope = track["yaw"][0], track["slope"][0]
    axle = _behind(fronts, along, overhang, fronts[0] - overhang * np.exp(1j * first_yaw))
    yaw = _drawn(axle, wheelbase, first_yaw)
    front_z, rear_z = (
        _behind(track["z"], along, back, track["z"][0] - back * np.sin(slope))
        for back in (overhang, overhang + wheelbase)
    )
    climb = np.arcsin(np.clip((front_z - rear_z) / wheelbase, -1, 1))
    states = _states(
        track,
        axle - wheelbase / 2 * np.cos(climb) * np.exp(1j * yaw),
        z=(front_z + rear_z) / 2,
        yaw=yaw,
        pitch=-climb,
    )
    states["acceleration"] = _eased(track["acceleration"])
    states["yaw_rate"] = _rate(yaw, tick_s)
    states["steering"] = _steered(states["yaw_rate"], steps / tick_s, wheelbase)
    states["travelled"] = along
    held = (track["speed"] < STANDING_M_S) & (states["acceleration"] <= COASTING_M_S2)
    braking = held | (states["acceleration"] < -COASTING_M_S2)
    states["lamps"] |= np.where(braking, Lamp.BRAKE, 0).astype(np.uint8)
    return states


def walker_states(
    track: NDArray[np.void],
    length_m: float,
    *,
    speed_m_s: float,
    tick_s: float,
    kerb: Callable[[NDArray[np.complex128]], NDArray[np.float64]],
) -> NDArray[np.void]:
    """States of one person, who stays upright, walks without hops and looks where they go.

    Args:
        track: Fronts of the person, sorted by tick.
        length_m: Of the body.
        speed_m_s: At which the person walks.
        tick_s: Length of a tick.
        kerb: How high above SUMO's lanes the ground is at places (n,), east + i north.
    """
    middles = track["x"] + 1j * track["y"] - length_m / 2 * np.exp(1j * track["yaw"])
    path = _followed(middles, np.full(len(track), CATCH_UP * speed_m_s * tick_s))
    path = _eased(path, STROLL_TICKS)
    z = _eased(track["z"] + kerb(path))
    steps = np.diff(path, prepend=path[0])
    speed = np.abs(steps) / tick_s
    speed[0] = track["speed"][0]
    track = track.copy()
    track["speed"], track["acceleration"] = speed, np.gradient(speed, tick_s)
    moves = np.gradient(path, tick_s) if len(path) > 1 else np.zeros(1, complex)
    looked = np.where(np.abs(moves) > WALKING_M_S, np.angle(moves), np.nan)
    yaw = _turned(looked, track["yaw"][0], TURN_RATE_RAD_S * tick_s)
    states = _states(track, path, z=z, yaw=yaw, pitch=np.zeros(len(track)))
    states["yaw_rate"], states["travelled"] = _rate(yaw, tick_s), np.cumsum(np.abs(steps))
    return states


def _followed(
    targets: NDArray[np.complex128], reach: NDArray[np.float64]
) -> NDArray[np.complex128]:
    """Places (n,), east + i north, that approach the targets by `reach` (n,) at most."""
    here = complex(targets[0])
    path: list[complex] = []
    for target, most in zip(targets.tolist(), reach.tolist(), strict=True):
        gap = target - here
        here = target if abs(gap) <= most else here + gap / abs(gap) * most
        path.append(here)
    return np.array(path)


def _eased(values: NDArray[Number], ticks: int = EASING_TICKS) -> NDArray[Number]:
    """Values (n,), each the mean of the (odd) `ticks` around it."""
    kernel = np.full(ticks, 1 / ticks)
    return np.convolve(np.pad(values, ticks // 2, mode="edge"), kernel, mode="valid")


def _behind(
    values: NDArray[Number], along: NDArray[np.float64], back_m: float, before: Number
) -> NDArray[Number]:
    """Values (n,) `back_m` further back on the way, whose value was `before` that far before it."""
    way, known = np.concatenate([[-back_m], along]), np.concatenate([[before], values])
    return np.asarray(np.interp(along - back_m, way, known), dtype=values.dtype)


def _drawn(axle: NDArray[np.complex128], wheelbase_m: float, first: float) -> NDArray[np.float64]:
    """Headings (n,) of a body whose rear axle is drawn by its front axle (a tractrix)."""
    rear = complex(axle[0]) - wheelbase_m * np.exp(1j * first)
    directions: list[complex] = []
    for front in axle.tolist():
        pull = front - rear
        directions.append(pull / abs(pull))
        rear = front - wheelbase_m * directions[-1]
    return np.unwrap(np.angle(directions))


def _turned(wanted: NDArray[np.float64], first: float, reach: float) -> NDArray[np.float64]:
    """Headings (n,) that turn towards the wanted ones by `reach` at most; NaN wants none.

    Half of a turn comes before it is called for: one looks where one will go.
    """
    known = np.concatenate([[first], wanted[~np.isnan(wanted)]])
    at = np.cumsum(~np.isnan(wanted))
    aims = np.unwrap(known)[at]
    late = _limited(aims, reach)
    return (late + _limited(aims[::-1], reach)[::-1]) / 2


def _limited(aims: NDArray[np.float64], reach: float) -> NDArray[np.float64]:
    here = float(aims[0])
    headings: list[float] = []
    for aim in aims.tolist():
        here += min(max(aim - here, -reach), reach)
        headings.append(here)
    return np.array(headings)


def _rate(headings: NDArray[np.float64], tick_s: float) -> NDArray[np.float64]:
    """Turn per second (n,); headings change by less than half a turn a tick."""
    return np.gradient(headings, tick_s) if len(headings) > 1 else np.zeros(1)


def _steered(
    yaw_rate: NDArray[np.float64], speed: NDArray[np.float64], wheelbase_m: float
) -> NDArray[np.float64]:
    """Angle (n,) of the front wheels by the single-track model; kept while standing."""
    moves = speed > STANDING_M_S
    wanted = np.arctan2(wheelbase_m * yaw_rate, np.where(moves, speed, 1.0))
    last = np.maximum.accumulate(np.where(moves, np.arange(len(speed)), 0))
    return np.clip(np.where(moves[last], wanted[last], 0.0), -MOST_STEERING, MOST_STEERING)


def _states(
    track: NDArray[np.void],
    middles: NDArray[np.complex128],
    *,
    z: NDArray[np.float64],
    yaw: NDArray[np.float64],
    pitch: NDArray[np.float64],
) -> NDArray[np.void]:
    states = np.zeros(len(track), dtype=STATE)
    for name in ("tick", "speed", "acceleration", "lamps"):
        states[name] = track[name]
    states["x"], states["y"], states["z"] = middles.real, middles.imag, z
    states["yaw"], states["pitch"] = yaw, pitch
    return states
