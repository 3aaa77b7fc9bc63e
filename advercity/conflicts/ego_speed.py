"""Draw the speed at which the ego meets an actor, within the limits of road and reaction."""

import math
from dataclasses import replace

from advercity_dsl.distribution import compute_bounds
from advercity_dsl.units import KM_H_PER_M_S

from advercity.conflicts.case import ActorPlacement, ConflictCase, UnsolvableError
from advercity.conflicts.resolution import ONSET_S
from advercity.conflicts.trajectories import find_stop_station
from advercity.geometry.polyline import StationedPolyline

AROUND_CROSSING_M = 20.0
"""Length of the ego's path before the crossing, and of the actor's around it, to consider."""
BRAKING_DELAY_S = 0.75 * ONSET_S
"""Extra lead time of braking whose deceleration builds up instead of starting at once."""


def fit_ego_speed(case: ConflictCase, place: ActorPlacement) -> ConflictCase:
    """Draw the speed of the ego within its range and the limits of the road.

    An ego that brakes for the actor is fast enough to do so within the declared time to
    collision. If no such speed is possible, the actor resolves the conflict.

    Raises:
        UnsolvableError: The conflict does not let the actor resolve it.
    """
    _, high_km_h = compute_bounds(case.conflict.parameters.ego_speed_km_h.draw)
    free_km_h = case.drive.motion.find_top_speed_m_s(place.station_m) * KM_H_PER_M_S
    lowest_km_h = compute_lowest_speed_m_s(case, place) * KM_H_PER_M_S
    highest_km_h = min(high_km_h, free_km_h)
    if lowest_km_h > highest_km_h:
        if case.conflict.resolved_by.actor == 0:
            raise UnsolvableError(
                f"the ego drives at most {highest_km_h:.1f} km/h there, too slow to"
                " brake within the declared time to collision; let the actor resolve it"
                " (resolved_by: {actor: 1})"
            )
        case, lowest_km_h = replace(case, resolved_by="actor"), 0.0
    lowest_km_h = max(lowest_km_h, case.least_speed_share * highest_km_h)
    return case.draw_ego_speed(place.station_m, lowest_km_h, free_km_h)


def compute_lowest_speed_m_s(case: ConflictCase, place: ActorPlacement) -> float:
    """Compute the lowest speed from which the ego brakes within the declared time to collision.

    The ego stops `d` before the crossing, so at the speed v and the deceleration b it begins to
    brake `v / 2b + d / v` before its undisturbed arrival. Returns infinity if no speed will do,
    0 if the ego does not brake for the actor.
    """
    braking_m_s2 = case.parameters.get("ego_braking_m_s2")
    brakes = case.resolved_by in ("ego", "both") and case.conflict.actor.behaviour == "stops_short"
    if not brakes or braking_m_s2 is None:
        return 0.0
    time_s = case.conflict.outcome.time_to_collision_below_s - BRAKING_DELAY_S
    square = time_s**2 - 2 * _compute_stop_gap_m(case, place) / braking_m_s2
    return braking_m_s2 * (time_s - math.sqrt(square)) if square > 0 else math.inf


def _compute_stop_gap_m(case: ConflictCase, place: ActorPlacement) -> float:
    """Compute how far before the meeting the centre of the ego stops, clear of the actor's path."""
    drive, at_m = case.drive, place.station_m
    path = drive.path.line.cut(max(at_m - AROUND_CROSSING_M, 0.0), at_m)
    crossed = _build_actor_path(case, place)
    meets_m, _ = crossed.project_point(drive.path.point_at(at_m))
    begin_m, end_m = meets_m - AROUND_CROSSING_M / 2, meets_m + AROUND_CROSSING_M / 2
    near = crossed.cut(max(begin_m, 0.0), min(end_m, crossed.length_m))
    swept = near.line.buffer(case.actor.width_m / 2, cap_style="flat")
    size = case.ego.length_m, case.ego.width_m
    return path.length_m - find_stop_station(path, size, swept, path.length_m)


def _build_actor_path(case: ConflictCase, place: ActorPlacement) -> StationedPolyline:
    if place.path is not None:
        return StationedPolyline.from_points(place.path)
    return case.drive.planner.build_path(place.route, place.lane).line
