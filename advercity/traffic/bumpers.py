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
COASTING_M_S2 = 0.3
"""Slowing down more than this takes the brakes."""
STANDING_M_S = 0.1
TIGHTEST_TURN_M = 2.5
"""Vehicles that SUMO turns where they stand do so here as they move on, at this radius."""
WHEELBASE_SHARE = 0.6
"""Of a vehicle's length."""
MOST_STEERING = np.radians(40.0)
TURN_RATE_RAD_S = np.pi
WALKING_M_S = 0.3
"""Slower than this a person keeps looking the same way."""


def vehicle_states(track: NDArray[np.void], length_m: float, *, tick_s: float) -> NDArray[np.void]:
    """States of one vehicle from its fronts, both sorted by tick.

    SUMO's heading is that of the chord from the rear to the front bumper, both on the lane's
    centre line, so the body hangs between them. An axle is as high as the front was when it
    passed there; before the first tick the lane is taken to go on at its slope. Brake lamps are
    lit while it slows down and while it is held standing.
    """
    fronts = _followed(track["x"] + 1j * track["y"], CATCH_UP * track["speed"] * tick_s)
    steps = np.abs(np.diff(fronts, prepend=fronts[0]))
    along = np.cumsum(steps)
    yaw = _turned(track["yaw"], track["yaw"][0], steps / TIGHTEST_TURN_M)
    behind = track["z"][0] - length_m * np.sin(track["slope"][0])
    wheelbase = WHEELBASE_SHARE * length_m
    front_axle, rear_axle = (
        np.interp(
            along - (length_m + side * wheelbase) / 2,
            np.concatenate([[-length_m], along]),
            np.concatenate([[behind], track["z"]]),
        )
        for side in (-1, 1)
    )
    climb = np.arcsin(np.clip((front_axle - rear_axle) / wheelbase, -1, 1))
    states = _states(
        track,
        fronts - length_m / 2 * np.cos(climb) * np.exp(1j * yaw),
        z=(front_axle + rear_axle) / 2,
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
    path = _eased(path)
    z = _eased(track["z"] + kerb(path))
    steps = np.diff(path, prepend=path[0])
    speed = np.abs(steps) / tick_s
    speed[0] = track["speed"][0]
    track = track.copy()
    track["speed"], track["acceleration"] = speed, np.gradient(speed, tick_s)
    looked = np.where(speed > WALKING_M_S, np.angle(steps), np.nan)
    yaw = _turned(looked, track["yaw"][0], np.full(len(track), TURN_RATE_RAD_S * tick_s))
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


def _eased(values: NDArray[Number]) -> NDArray[Number]:
    """Values (n,), each the mean of those around it."""
    kernel = np.full(EASING_TICKS, 1 / EASING_TICKS)
    return np.convolve(np.pad(values, EASING_TICKS // 2, mode="edge"), kernel, mode="valid")


def _turned(
    wanted: NDArray[np.float64], first: float, reach: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Headings (n,) that turn towards the wanted ones, by `reach` (n,) at most; NaN wants none."""
    here = first
    headings: list[float] = []
    for target, most in zip(wanted.tolist(), reach.tolist(), strict=True):
        if not np.isnan(target):
            turn = (target - here + np.pi) % (2 * np.pi) - np.pi
            here += min(max(turn, -most), most)
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
