"""Traffic of the plan frame in the world of a left-hand road, and back; see `plan_frame`."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from advercity.frames import ActorState, Lamp, Trace
from advercity.geometry.poses import mirror_pose

_NEGATED = ("y", "yaw", "vy", "ay", "yaw_rate", "roll", "roll_rate", "steering")
"""Columns of a trace's states whose sign changes in a mirror at the x axis."""


def mirror_trace(trace: Trace) -> Trace:
    """Mirror a trace at the x axis; vehicles indicate the other way, signals stay."""
    states = trace.states.copy()
    for name in _NEGATED:
        states[name] = 0.0 - states[name]  # never a negative zero, which has other bytes
    states["lamps"] = _swap_indicators(states["lamps"])
    return replace(trace, states=states)


def _swap_indicators(lamps: NDArray[np.uint8]) -> NDArray[np.uint8]:
    left, right = (lamps & lamp > 0 for lamp in (Lamp.LEFT, Lamp.RIGHT))
    others = lamps & ~np.uint8(Lamp.LEFT | Lamp.RIGHT)
    return others | Lamp.LEFT * right.astype(np.uint8) | Lamp.RIGHT * left.astype(np.uint8)


def mirror_at_rest(state: ActorState) -> ActorState:
    """Mirror the state of an actor at rest with its lamps off, such as a parked car."""
    return replace(state, world_from_body=mirror_pose(state.world_from_body))
