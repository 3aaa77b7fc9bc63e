"""Who holds up an umbrella: the weather tells, the trace stays the same."""

import math
from dataclasses import replace

from advercity.randomness import generator
from advercity.traffic.trace import Frame

HALF_MM_H = 1.5
"""Rain under which every second person who has an umbrella puts it up; a plausible figure."""


def sheltered(frame: Frame, rain_mm_h: float, *, seed: int) -> Frame:
    """The frame with umbrellas up, the more of them the harder it rains.

    Who puts one up in some rain also does so in a harder one.

    Args:
        frame: Who is there.
        rain_mm_h: Rain rate.
        seed: Of the traffic.
    """
    share = 1.0 - math.pow(2.0, -rain_mm_h / HALF_MM_H)
    if share <= 0.0:
        return frame
    return replace(
        frame,
        states=tuple(
            replace(state, umbrella=_minds_rain(seed, state.actor.id) < share)
            if state.actor.actor_class == "pedestrian"
            else state
            for state in frame.states
        ),
    )


def _minds_rain(seed: int, actor_id: int) -> float:
    """Below which share of umbrellas that are up somebody's is one."""
    return float(generator(seed, "umbrella", actor_id).random())
