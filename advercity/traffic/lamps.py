"""Which lamps are lit: what the driver does is in the trace, what the weather calls for is not."""

from dataclasses import replace

from advercity_dsl.weather import Lamps

from advercity.traffic.trace import ActorState, Frame, Lamp

BLINKS_PER_S = 1.5
"""UN R48 asks for 90 +- 30 flashes a minute."""
_GOLDEN = 0.618034
_INDICATORS = Lamp.LEFT | Lamp.RIGHT


def lit(frame: Frame, lamps: Lamps) -> Frame:
    """The frame with low beams and fog lamps as the weather calls for, and indicators that blink.

    In the trace an indicator is switched on; here it is lit for half of the time, everybody's to
    their own beat. Two-wheelers have no fog lamps, bicycles no indicators; people carry no lamps.
    """
    return replace(frame, states=tuple(_lit(state, lamps, frame.time_s) for state in frame.states))


def _lit(state: ActorState, lamps: Lamps, time_s: float) -> ActorState:
    kind = state.actor.actor_class
    if kind == "pedestrian":
        return state
    shining = state.lamps
    if kind == "bicycle" or (BLINKS_PER_S * time_s + _GOLDEN * state.actor.id) % 1.0 >= 0.5:
        shining &= ~_INDICATORS
    if lamps.low_beam:
        shining |= Lamp.LOW_BEAM
    if lamps.fog and kind not in ("bicycle", "motorcycle"):
        shining |= Lamp.FOG
    return replace(state, lamps=shining)
