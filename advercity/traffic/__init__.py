"""Traffic: who drives and walks where, tick by tick, recorded as a trace."""

from advercity.frames import (
    Actor,
    ActorState,
    Frame,
    Lamp,
    Signal,
    Trace,
    extract_planned_trajectory,
)
from advercity.traffic.simulation import simulate_in_subprocess
from advercity.traffic.weather_effects import apply_lamp_state

__all__ = [
    "Actor",
    "ActorState",
    "Frame",
    "Lamp",
    "Signal",
    "Trace",
    "apply_lamp_state",
    "extract_planned_trajectory",
    "simulate_in_subprocess",
]
