"""What the weather changes in a frame: lamps that it calls for, and umbrellas.

The trace holds what drivers do, so that all weathers share it; these functions add the rest.
"""

import math
from dataclasses import replace

from advercity_dsl.weather_components import Lamps

from advercity.frames import ActorState, Frame, Lamp
from advercity.physics.constants import GOLDEN_FRACTION
from advercity.randomness import create_generator

INDICATOR_FREQUENCY_HZ = 1.5
"""UN R48 asks for 90 +- 30 flashes a minute."""
_INDICATORS = Lamp.LEFT | Lamp.RIGHT


def apply_lamp_state(frame: Frame, lamps: Lamps) -> Frame:
    """Light low beams and fog lamps as the weather calls for, and let indicators blink.

    In the trace an indicator is switched on; here it is lit for half of the time, with a phase of
    its own for each vehicle. Two-wheelers have no fog lamps, bicycles no indicators, people no
    lamps.
    """
    states = tuple(_apply_lamps(state, lamps, frame.time_s) for state in frame.states)
    return replace(frame, states=states)


def _apply_lamps(state: ActorState, lamps: Lamps, time_s: float) -> ActorState:
    actor_class = state.actor.actor_class
    if actor_class == "pedestrian":
        return state
    lit = state.lamps
    phase = (INDICATOR_FREQUENCY_HZ * time_s + GOLDEN_FRACTION * state.actor.id) % 1.0
    if actor_class == "bicycle" or phase >= 0.5:
        lit &= ~_INDICATORS
    if lamps.low_beam:
        lit |= Lamp.LOW_BEAM
    if lamps.fog and actor_class not in ("bicycle", "motorcycle"):
        lit |= Lamp.FOG
    return replace(state, lamps=lit)


HALF_UMBRELLAS_MM_H = 1.5
"""Rain rate at which half of the people with an umbrella hold it up; a plausible figure."""


def raise_umbrellas(frame: Frame, rain_mm_h: float, *, seed: int) -> Frame:
    """Raise umbrellas, the more of them the harder it rains.

    A person that raises one in some rain also does so in harder rain.

    Args:
        frame: Without umbrellas.
        rain_mm_h: Rain rate.
        seed: Seed of the traffic.
    """
    fraction = 1.0 - math.pow(2.0, -rain_mm_h / HALF_UMBRELLAS_MM_H)
    if fraction <= 0.0:
        return frame
    states = tuple(
        replace(state, umbrella=_draw_threshold(seed, state.actor.id) < fraction)
        if state.actor.actor_class == "pedestrian"
        else state
        for state in frame.states
    )
    return replace(frame, states=states)


def _draw_threshold(seed: int, actor_id: int) -> float:
    """Draw the fraction of raised umbrellas from which on a person's is one of them."""
    return float(create_generator(seed, "umbrella", actor_id).random())
