"""Build the states of a body: position, motion, turning, lamps and steering.

The motion of an actor is one smooth curve; position, velocity, acceleration and turning are its
values and exact derivatives. Positions in the plan are complex numbers here and in the modules of
motion, east + i north: the argument is a heading, and one function smooths positions and plain
numbers alike.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from advercity.frames import STATE_COLUMNS, STATE_DTYPE, Lamp
from advercity.geometry.plane import compute_directions, compute_headings, compute_lengths
from advercity.physics.constants import MAX_STEERING_RAD

CATCH_UP_FACTOR = 1.1
"""Maximum speed of an actor on its way to its position in SUMO, as a multiple of its speed: SUMO's
people hop onto crossings and its vehicles slide sideways at standstill."""
STANDSTILL_M_S = 0.1
"""Speed below which a vehicle is held by its brakes and keeps its steering angle."""


COASTING_M_S2 = 0.3
"""Deceleration above which the brakes are in use."""
STATE_DECIMALS = 9
"""Decimals of a trace's numbers: nanometres and nanoradians.

Processors differ in the last bit of sines and cosines, 1e-16 of a value. Two such values round to
different decimals only if one in ten million lies between them, by chance."""
_MOTION_COLUMNS = ("x", "y", "z"), ("vx", "vy", "vz"), ("ax", "ay", "az")


@dataclass(frozen=True, eq=False)
class BodyCurves:
    """Position of a body's origin at the ticks of its track, with first and second derivatives.

    Attributes:
        plan: (3, n) position east + i north in m, velocity and acceleration.
        height: (3, n) its height in m, with first and second derivatives.
        yaw: (2, n) yaw in rad and its rate.
        pitch: (2, n) pitch in rad and its rate.
        roll: (2, n) roll in rad and its rate.
    """

    plan: NDArray[np.complex128]
    height: NDArray[np.float64]
    yaw: NDArray[np.float64]
    pitch: NDArray[np.float64]
    roll: NDArray[np.float64]


def build_states(
    ticks: NDArray[np.integer], lamps: NDArray[np.uint8], motion: BodyCurves
) -> NDArray[np.void]:
    """Build `STATE_DTYPE` rows (n,) of one body, with `actor` and `steering` left at 0."""
    states = np.zeros(len(ticks), dtype=STATE_DTYPE)
    states["tick"], states["lamps"] = ticks, lamps
    for names, plan, height in zip(_MOTION_COLUMNS, motion.plan, motion.height, strict=True):
        for name, column in zip(names, (plan.real, plan.imag, height), strict=True):
            states[name] = column
    states["yaw"], states["yaw_rate"] = motion.yaw
    states["pitch"], states["pitch_rate"] = motion.pitch
    states["roll"], states["roll_rate"] = motion.roll
    places, velocities, accelerations = (
        np.stack([states[name] for name in names]) for names in _MOTION_COLUMNS
    )
    facing, nose = (compute_directions(states[name]) for name in ("yaw", "pitch"))
    ahead = facing.real * nose.real, facing.imag * nose.real, -nose.imag
    states["speed"] = _norm(velocities)
    states["acceleration"] = sum(axis * a for axis, a in zip(ahead, accelerations, strict=True))
    states["travelled"][1:] = np.cumsum(_norm(np.diff(places)))
    return states


def apply_brake_lamps(states: NDArray[np.void]) -> None:
    """Light the brake lamps in a vehicle's states (n,) while it slows down or is held."""
    held = (states["speed"] < STANDSTILL_M_S) & (states["acceleration"] <= COASTING_M_S2)
    braking = held | (states["acceleration"] < -COASTING_M_S2)
    states["lamps"] |= np.where(braking, Lamp.BRAKE, 0).astype(np.uint8)


def compute_steering(
    velocity: NDArray[np.complex128], directions: NDArray[np.complex128]
) -> NDArray[np.float64]:
    """Compute steering angles (n,) from the direction of the front axle; kept at standstill."""
    moves = compute_lengths(velocity) > STANDSTILL_M_S
    wanted = compute_headings(velocity * directions.conj())
    last = np.maximum.accumulate(np.where(moves, np.arange(len(velocity)), 0))
    return np.clip(np.where(moves[last], wanted[last], 0.0), -MAX_STEERING_RAD, MAX_STEERING_RAD)


def round_states(states: NDArray[np.void]) -> NDArray[np.void]:
    """Round the states of a trace, so every processor stores the same bytes."""
    rounded = states.copy()
    for name in STATE_COLUMNS:
        if STATE_DTYPE[name].kind == "f":
            rounded[name] = np.round(states[name], STATE_DECIMALS) + 0.0  # -0.0 becomes 0.0
    return rounded


def _norm(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Compute the lengths (n,) of vectors (3, n)."""
    x, y, z = vectors
    return np.sqrt(x * x + y * y + z * z)
