"""Measure the declared parameters of a staged conflict on its trace."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import shapely
from advercity_dsl.conflict import StagedConflict
from advercity_dsl.units import KM_H_PER_M_S
from numpy.typing import NDArray

from advercity.conflicts.ego_motion import TEST_CLOCK_S
from advercity.conflicts.metrics import ActorTrack
from advercity.conflicts.trajectories import find_closest_approach

APPROACH_WINDOW_S = 8.0
"""Time before the ego's arrival over which the actor's approach is measured."""
TOLERANCES = {"_km_h": 0.5, "_s": 0.05, "_m": 0.05}
"""Resolution of a measured value by the unit at the end of its name; for times, half a tick."""


@dataclass(frozen=True)
class AchievedParameter:
    """A parameter of a conflict as declared and as measured; a row of `report.json`.

    Attributes:
        name: Name with unit.
        declared: Lowest and highest declared value.
        achieved: Value on the trace.
    """

    name: str
    declared: tuple[float, float]
    achieved: float

    @property
    def is_outside(self) -> bool:
        """Whether the value is outside the declared range by more than its resolution."""
        low, high = self.declared
        tolerance = next(value for unit, value in TOLERANCES.items() if self.name.endswith(unit))
        return not low - tolerance <= self.achieved <= high + tolerance

    def __str__(self) -> str:
        """`33.4 (30 to 80)`."""
        low, high = self.declared
        return f"{self.achieved:.3g} ({low:g} to {high:g})"


@dataclass(frozen=True)
class _Meeting:
    ego: ActorTrack
    actor: ActorTrack
    ego_at_s: float
    lag_s: float
    lanes: tuple[shapely.LineString, shapely.LineString]
    since_red_s: float
    tick_s: float


def measure_parameters(
    conflict: StagedConflict,
    ego: ActorTrack,
    actor: ActorTrack,
    *,
    ego_at_s: float,
    lag_s: float,
    lanes: tuple[shapely.LineString, shapely.LineString],
    since_red_s: float,
    tick_s: float,
) -> tuple[AchievedParameter, ...]:
    """Measure the declared parameters that show in a trace.

    Args:
        conflict: The conflict.
        ego: Whole track of the ego.
        actor: Whole track of the actor.
        ego_at_s: Time from the first kept tick to the ego's arrival at the conflict point.
        lag_s: How much later the actor would have arrived at the speed of its approach.
        lanes: Paths of the ego and of the actor in their lanes.
        since_red_s: Time from the red of the actor's light to its passing of the stop line.
        tick_s: Time between ticks.
    """
    meeting = _Meeting(ego, actor, ego_at_s, lag_s, lanes, since_red_s, tick_s)
    # In a collision the actor does not reach its full distance over the line.
    hidden = ("encroachment_m",) if conflict.resolved_by == "nobody" else ()
    return tuple(
        AchievedParameter(name, conflict.declared[name], round(measure(meeting), 3))
        for name, measure in _MEASURES.items()
        if name in conflict.declared and name not in hidden
    )


def select_before(
    track: ActorTrack, at_s: float, window_s: float, tick_s: float
) -> NDArray[np.intp]:
    """Select the indices of a track's rows in the `window_s` before `at_s`."""
    times_s = track.rows["tick"] * tick_s
    return np.flatnonzero((times_s >= at_s - window_s) & (times_s <= at_s))


def _measure_ego_speed(meeting: _Meeting) -> float:
    return _find_top_speed_km_h(meeting.ego, meeting, TEST_CLOCK_S)


def _measure_actor_speed(meeting: _Meeting) -> float:
    return _find_top_speed_km_h(meeting.actor, meeting, APPROACH_WINDOW_S)


def _find_top_speed_km_h(track: ActorTrack, meeting: _Meeting, window_s: float) -> float:
    rows = select_before(track, meeting.ego_at_s, window_s, meeting.tick_s)
    return float(track.rows["speed"][rows].max(initial=0.0)) * KM_H_PER_M_S


def _measure_encroachment(meeting: _Meeting) -> float:
    """Measure the maximum reach of the actor's outline over the middle between both lanes."""
    ego_lane, actor_lane = meeting.lanes
    passing, _ = find_closest_approach(meeting.ego, meeting.actor)
    coming = meeting.actor.centres[meeting.actor.rows["tick"] <= passing]
    apart_m = np.asarray(shapely.distance(ego_lane, shapely.points(coming)))
    nearest = shapely.Point(coming[np.argmin(apart_m)])
    in_lanes_m = ego_lane.distance(actor_lane.interpolate(actor_lane.project(nearest)))
    return float(in_lanes_m / 2 + meeting.actor.size[1] / 2 - apart_m.min())


_MEASURES: Mapping[str, Callable[[_Meeting], float]] = {
    "ego_speed_km_h": _measure_ego_speed,
    "actor_speed_km_h": _measure_actor_speed,
    "arrival_offset_s": lambda meeting: meeting.lag_s,
    "encroachment_m": _measure_encroachment,
    "since_red_s": lambda meeting: meeting.since_red_s,
}
"""Measurement of each parameter that shows in a trace."""
