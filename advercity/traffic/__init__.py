"""Traffic: who drives and walks where, tick by tick, recorded as a trace."""

from advercity.traffic.lamps import lit
from advercity.traffic.plans import planned
from advercity.traffic.simulation import simulate
from advercity.traffic.trace import Actor, ActorState, Frame, Lamp, Signal, Trace

__all__ = [
    "Actor",
    "ActorState",
    "Frame",
    "Lamp",
    "Signal",
    "Trace",
    "lit",
    "planned",
    "simulate",
]
