"""Place an actor in the opposite lane that drifts into the ego's, or overtakes a cyclist.

Stations are metres on the ego's path.
"""

import numpy as np
from advercity_dsl.units import KM_H_PER_M_S

from advercity.conflicts.case import ActorPlacement, ConflictCase, UnsolvableError
from advercity.conflicts.ego_motion import EgoDrive
from advercity.conflicts.run_ups import (
    WAITING_MARGIN_S,
    compute_run_m,
    find_free_station,
    find_last_free_station,
)
from advercity.conflicts.trajectories import DRIFT_HOLD_S, DRIFT_RETURN_MARGIN_S
from advercity.roads.bend_speed import BEND_STEP_M, compute_bend_speeds
from advercity.roads.routes import RoutePath

MEETING_FRACTIONS = (0.25, 0.62)
"""Fractions of the ego's drive between which it meets an oncoming actor."""
APPROACH_S = 4.0
"""Time before the meeting over which the actor's speed counts."""
STREET_END_MARGIN_M = 8.0
"""Minimum distance of a start from either end of a street."""


def place_opposite(case: ConflictCase, station_m: float) -> ActorPlacement:
    """Place an actor in the opposite lane; it meets the ego at a station."""
    run_m = compute_run_m(case, station_m)
    if case.conflict.actor.behaviour == "overtakes":
        run_m = min(run_m, _compute_free_run_m(case, station_m))
    else:
        _, back = _build_oncoming_path(case.drive)
        meeting_m = back.find_nearest_station(case.drive.path.point_at(station_m))
        run_m = meeting_m - find_free_station(case, back, meeting_m - run_m)
    return place_oncoming(case.drive, station_m, run_m)


def compute_drift_limit_m_s(case: ConflictCase, station_m: float) -> float:
    """Compute the highest speed of a drifting actor: the ego's top speed, and less in bends.

    The actor comes to the station from ahead of the ego.
    """
    top_m_s, path = case.drive.road.ego.max_speed_km_h / KM_H_PER_M_S, case.drive.path.line
    ahead_m = min(station_m + top_m_s * APPROACH_S, path.length_m)
    driven = path.points_at(np.arange(station_m, ahead_m, BEND_STEP_M))[:, :2]
    return min(top_m_s, float(compute_bend_speeds(driven).min(initial=np.inf)))


def place_oncoming(drive: EgoDrive, station_m: float, run_m: float) -> ActorPlacement:
    """Place an actor driving against the ego, `run_m` before a station on the ego's path."""
    route, back = _build_oncoming_path(drive)
    meeting_m = back.find_nearest_station(drive.path.point_at(station_m))
    start_m = max(meeting_m - run_m, STREET_END_MARGIN_M)
    index, segment = next(
        (number, item)
        for number, item in enumerate(back.segments)
        if start_m < item.end_m - STREET_END_MARGIN_M
    )
    start_m = max(start_m, segment.start_m + STREET_END_MARGIN_M)
    return ActorPlacement(
        station_m, meeting_m - start_m, route=route[index:], start_m=segment.end_m - start_m
    )


def _build_oncoming_path(drive: EgoDrive) -> tuple[tuple[str, ...], RoutePath]:
    """Build the streets and the path of traffic against the ego."""
    route = tuple(reversed(drive.route))
    route = (*route, *_find_next_street(drive, route[-1]))
    return route, drive.planner.build_path(route)


def _compute_free_run_m(case: ConflictCase, station_m: float) -> float:
    """Compute the actor's longest run, from ahead of connected vehicles behind the cyclist."""
    _, back = _build_oncoming_path(case.drive)
    meeting_m = back.find_nearest_station(case.drive.path.point_at(station_m))
    cyclist_m = meeting_m - place_passed_cyclist(case, station_m).approach_m
    return meeting_m - find_last_free_station(case, back, cyclist_m)


def find_straightest_station(case: ConflictCase) -> float:
    """Find the straightest station near the middle of the ego's drive.

    On a bend, velocity alone cannot tell a drift from following the lane.

    Raises:
        UnsolvableError: The ego passes the middle before the first permitted critical event.
    """
    drive, earliest_s = case.drive, case.not_before_s + DRIFT_HOLD_S + _compute_return_s(case)
    candidates = drive.start_m + np.linspace(*MEETING_FRACTIONS, 41) * (drive.end_m - drive.start_m)
    stations = [at for at in candidates.tolist() if drive.motion.time_at(at) >= earliest_s]
    if not stations:
        raise UnsolvableError(
            f"the ego is past the middle of its drive {earliest_s:.1f} s after the start; raise"
            " its waits_s"
        )
    turns = [
        np.ptp(np.unwrap(drive.path.headings_at(np.arange(at - 5.0, at + 32.0, 4.0))))
        for at in stations
    ]
    # Rounded, so every machine picks the first of nearly equal places.
    return stations[int(np.argmin(np.round(turns, 2)))]


def _find_next_street(drive: EgoDrive, street: str) -> tuple[str, ...]:
    """Find the next street for traffic against the ego after its first; none at the edge."""
    along = drive.planner.is_along_axis(drive.route, 0)
    layout = drive.planner.streets[street]
    junction = layout.begins if along else layout.ends
    movements = drive.planner.movements.get(junction, ())
    options = [item for item in movements if item.from_street == street]
    straightest = sorted(options, key=lambda item: abs(drive.planner.turn_angle(item, junction)))
    return tuple(item.to_street for item in straightest[:1])


CYCLIST_WAITING_MARGIN_S = 1.0
"""Time for which the cyclist can wait at its start and still arrive in time."""
CYCLIST_STEADY_S = 1.0
"""Minimum time at steady speed before the actor leaves its lane."""
CYCLIST_LIMITS_M_S2 = (1.0, 2.0)
"""Acceleration and braking of the cyclist."""


def find_overtaking_station(case: ConflictCase) -> float:
    """Find the ego's first station by which the actor can have overtaken a cyclist at speed.

    Raises:
        UnsolvableError: A junction is too near everywhere for the cyclist to gain its speed.
    """
    sets_out_s = case.speed_m_s / case.parameters["acceleration_m_s2"]
    drifted_s = WAITING_MARGIN_S + sets_out_s + case.parameters["drift_time_s"]
    after_s = max(drifted_s, case.not_before_s) + _compute_passing_s(case) + _compute_return_s(case)
    drive = case.drive
    needed_m = _compute_passed_before_m(case) + _compute_cyclist_run_up_m(case)
    for station in np.arange(drive.motion.station_at(after_s), drive.end_m).tolist():
        if place_oncoming(drive, station, needed_m).approach_m >= needed_m:
            return station
    raise UnsolvableError(f"'{drive.road.id}' has no {needed_m:.0f} m for the cyclist")


def place_passed_cyclist(case: ConflictCase, station_m: float) -> ActorPlacement:
    """Place the cyclist; the actor has just passed it when it begins to return to its lane."""
    speed = compute_cyclist_speed_m_s(case)
    rides_s = case.drive.motion.time_at(station_m) - _compute_return_s(case)
    rides_s -= CYCLIST_WAITING_MARGIN_S
    ridden_m = speed * (rides_s - speed / (2 * CYCLIST_LIMITS_M_S2[0]))
    return place_oncoming(case.drive, station_m, _compute_passed_before_m(case) + ridden_m)


def _compute_passed_before_m(case: ConflictCase) -> float:
    """Compute how far before the meeting the cyclist is when the actor begins to return."""
    lengths_m = case.actor.length_m + case.sampler.draw_cyclist().length_m
    return (
        case.speed_m_s * _compute_return_s(case) + lengths_m / 2 + case.parameters["passing_gap_m"]
    )


def _compute_cyclist_run_up_m(case: ConflictCase) -> float:
    """Compute the minimum distance the cyclist rides before the actor begins to return."""
    speed = compute_cyclist_speed_m_s(case)
    steady_s = CYCLIST_STEADY_S + case.parameters["drift_time_s"] + _compute_passing_s(case)
    return speed * (steady_s + speed / (2 * CYCLIST_LIMITS_M_S2[0]))


def compute_cyclist_speed_m_s(case: ConflictCase) -> float:
    """Compute the speed of the overtaken cyclist."""
    return case.parameters["passed_speed_km_h"] / KM_H_PER_M_S


def _compute_return_s(case: ConflictCase) -> float:
    """Compute the time from the start of the actor's return to its passing of the ego."""
    return case.parameters["return_time_s"] + DRIFT_RETURN_MARGIN_S


def _compute_passing_s(case: ConflictCase) -> float:
    """Compute how long the actor drives in the other lane."""
    lengths_m = case.actor.length_m + case.sampler.draw_cyclist().length_m
    closing_km_h = case.parameters["actor_speed_km_h"] - case.parameters["passed_speed_km_h"]
    if closing_km_h <= 0:
        raise UnsolvableError("the cyclist is not slower than the actor that overtakes it")
    return (lengths_m + 2 * case.parameters["passing_gap_m"]) / (closing_km_h / KM_H_PER_M_S)
