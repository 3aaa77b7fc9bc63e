"""One who overtakes a cyclist in the ego's lane and comes back just before meeting the ego."""

from advercity.compiler.solving.case import Case, Placed
from advercity.compiler.solving.errors import UnsolvableError
from advercity.compiler.solving.opposite import WAITS_S, against

PASSED_WAITS_S = 1.0
"""The cyclist starts so near that it can wait this long, to be in time."""
BACK_BEFORE_S = 0.15
"""The actor is back in its lane this long before it is beside the ego."""
CYCLIST_M_S2 = (1.0, 2.0)
"""With which a cyclist sets out and brakes."""


def soonest_m(case: Case) -> float:
    """The first station of the ego where one who overtakes can have done so."""
    sets_out_s = case.speed_m_s / case.drawn["acceleration_m_s2"]
    beside_s = _beside_s(case)
    after_s = WAITS_S + sets_out_s + case.drawn["drift_time_s"] + beside_s + _back_s(case)
    return case.drive.pace.station(after_s)


def passed(case: Case, station_m: float) -> Placed:
    """The cyclist whom the actor passes as it begins to come back into its lane.

    Args:
        case: The conflict.
        station_m: Where the actor meets the ego.
    """
    pace = passed_speed_m_s(case)
    back_s = _back_s(case)
    before = case.speed_m_s * back_s + (case.actor.length_m + case.casting.cyclist().length_m) / 2
    before += case.drawn["passing_gap_m"]
    rides_s = case.drive.pace.time(station_m) - back_s - PASSED_WAITS_S
    rode = pace * (rides_s - pace / (2 * CYCLIST_M_S2[0]))
    return against(case.drive, station_m, before + rode)


def passed_speed_m_s(case: Case) -> float:
    """Of the cyclist."""
    return case.drawn["passed_speed_km_h"] / 3.6


def _back_s(case: Case) -> float:
    """From when it begins to come back to when it is beside the ego."""
    return case.drawn["return_time_s"] + BACK_BEFORE_S


def _beside_s(case: Case) -> float:
    """How long it drives beside its lane."""
    lengths = case.actor.length_m + case.casting.cyclist().length_m
    closing = (case.drawn["actor_speed_km_h"] - case.drawn["passed_speed_km_h"]) / 3.6
    if closing <= 0:
        raise UnsolvableError("whom it overtakes is not slower")
    return (lengths + 2 * case.drawn["passing_gap_m"]) / closing
