"""Which lamps are lit: what the driver does is in the trace, what the weather calls for is not."""

from dataclasses import replace

from advercity_dsl.weather import Lamps

from advercity.traffic.trace import ActorState, Frame, Lamp


def lit(frame: Frame, lamps: Lamps) -> Frame:
    """The frame with low beams and fog lamps as the weather calls for.

    Two-wheelers have no fog lamps; people carry no lamps.
    """
    return replace(frame, states=tuple(_lit(state, lamps) for state in frame.states))


def _lit(state: ActorState, lamps: Lamps) -> ActorState:
    kind = state.actor.actor_class
    if kind == "pedestrian":
        return state
    added = Lamp(0)
    if lamps.low_beam:
        added |= Lamp.LOW_BEAM
    if lamps.fog and kind not in ("bicycle", "motorcycle"):
        added |= Lamp.FOG
    return replace(state, lamps=state.lamps | added)
