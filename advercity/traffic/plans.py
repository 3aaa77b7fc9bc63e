"""What a connected vehicle is about to drive."""

import numpy as np
from numpy.typing import NDArray

from advercity.traffic.trace import Trace


def planned(
    trace: Trace, actor_id: int, index: int, *, points: int = 9, step_s: float = 0.2
) -> NDArray[np.float64]:
    """The plan of an actor at a kept tick: what the trace says it will do.

    Beyond its last tick the actor is taken to go straight on at its last speed.

    Returns:
        (points, 3): world x and y in metres and speed in m/s, `step_s` apart, the first one
        `step_s` ahead.

    Raises:
        KeyError: The actor is not there at that tick.
    """
    number = next((at for at, actor in enumerate(trace.actors) if actor.id == actor_id), None)
    track = trace.states[(trace.states["actor"] == number) & (trace.states["tick"] >= index)]
    if len(track) == 0 or track["tick"][0] != index:
        raise KeyError(actor_id)
    ahead_s = step_s * np.arange(1, points + 1)
    times_s = (track["tick"] - index) * trace.tick_s
    beyond_m = np.maximum(ahead_s - times_s[-1], 0) * track["speed"][-1]
    return np.column_stack(
        [
            np.interp(ahead_s, times_s, track["x"]) + beyond_m * np.cos(track["yaw"][-1]),
            np.interp(ahead_s, times_s, track["y"]) + beyond_m * np.sin(track["yaw"][-1]),
            np.interp(ahead_s, times_s, track["speed"]),
        ]
    )
