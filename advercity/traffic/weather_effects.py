"""Which lamps are lit: what the driver does is in the trace, what the weather calls for is not.

Who holds up an umbrella: the weather tells, the trace stays the same.
"""

import math
from dataclasses import replace

from advercity_dsl.weather import Lamps

from advercity.frames import ActorState, Frame, Lamp
from advercity.physics.constants import GOLDEN_FRACTION
from advercity.randomness import create_generator

INDICATOR_FREQUENCY_HZ = 1.5
"""UN R48 asks for 90 +- 30 flashes a minute."""
_INDICATORS = Lamp.LEFT | Lamp.RIGHT


def apply_lamp_state(frame: Frame, lamps: Lamps) -> Frame:
    """The frame with low beams and fog lamps as the weather calls for, and indicators that blink.

    In the trace an indicator is switched on; here it is lit for half of the time, everybody's to
    their own beat. Two-wheelers have no fog lamps, bicycles no indicators; people carry no lamps.
    """
    return replace(
        frame,
        states=tuple(
            _apply_lamp_state_to_actor(state, lamps, frame.time_s) for state in frame.states
        ),
    )


def _apply_lamp_state_to_actor(state: ActorState, lamps: Lamps, time_s: float) -> ActorState:
    kind = state.actor.actor_class
    if kind == "pedestrian":
        return state
    shining = state.lamps
    if (
        kind == "bicycle"
        or (INDICATOR_FREQUENCY_HZ * time_s + GOLDEN_FRACTION * state.actor.id) % 1.0 >= 0.5
    ):
        shining &= ~_INDICATORS
    if lamps.low_beam:
        shining |= Lamp.LOW_BEAM
    if lamps.fog and kind not in ("bicycle", "motorcycle"):
        shining |= Lamp.FOG
    return replace(state, lamps=shining)


HALF_UMBRELLAS_MM_H = 1.5
"""Rain under which every second person who has an umbrella puts it up; a plausible figure."""


def raise_umbrellas(frame: Frame, rain_mm_h: float, *, seed: int) -> Frame:
    """The frame with umbrellas up, the more of them the harder it rains.

    Who puts one up in some rain also does so in a harder one.

    Args:
        frame: Who is there.
        rain_mm_h: Rain rate.
        seed: Of the traffic.
    """
    share = 1.0 - math.pow(2.0, -rain_mm_h / HALF_UMBRELLAS_MM_H)
    if share <= 0.0:
        return frame
    return replace(
        frame,
        states=tuple(
            replace(state, umbrella=_compute_umbrella_threshold(seed, state.actor.id) < share)
            if state.actor.actor_class == "pedestrian"
            else state
            for state in frame.states
        ),
    )


def _compute_umbrella_threshold(seed: int, actor_id: int) -> float:
    """Below which share of umbrellas that are up somebody's is one."""
    return float(create_generator(seed, "umbrella", actor_id).random())
