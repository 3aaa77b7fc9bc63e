"""Compute how far before the meeting an actor starts, and its highest speed from there."""

import numpy as np
from advercity_dsl.road import Vehicle

from advercity.conflicts.case import ActorPlacement, ConflictCase
from advercity.roads.routes import RoutePath

WAITING_MARGIN_S = 1.5
"""Time for which an oncoming actor can wait at its start and still arrive in time."""


def compute_run_m(case: ConflictCase, station_m: float) -> float:
    """Compute how far a vehicle drives to the meeting if it sets out at the scenario's start."""
    speed, acceleration = case.speed_m_s, case.parameters["acceleration_m_s2"]
    meets_s = case.drive.motion.time_at(station_m)
    return speed * (meets_s - speed / (2 * acceleration) - WAITING_MARGIN_S)


SAME_LANE_M = 1.5
"""Maximum distance of a vehicle's start from an actor's path in the same lane."""
CONNECTED_GAP_M = 6.0
"""Distance between the centre of a connected vehicle and the rear of an actor ahead of it."""


def find_last_free_station(case: ConflictCase, path: RoutePath, line_m: float) -> float:
    """Find the first station at which an actor can start: ahead of connected vehicles behind it."""
    taken = [station for station in _list_taken_stations(case, path) if station < line_m]
    return max([0.0, *(station + CONNECTED_GAP_M for station in taken)]) + case.actor.length_m / 2


def find_free_station(case: ConflictCase, path: RoutePath, start_m: float) -> float:
    """Find the first station from `start_m` on that is clear of connected vehicles."""
    apart_m = CONNECTED_GAP_M + case.actor.length_m / 2
    for station in sorted(_list_taken_stations(case, path)):
        if abs(station - start_m) < apart_m:
            start_m = station + apart_m
    return start_m


def _list_taken_stations(case: ConflictCase, path: RoutePath) -> list[float]:
    spawns = [
        place.spawn_m for place in case.drive.road.agents.values() if isinstance(place, Vehicle)
    ]
    return [
        station
        for spawn in spawns
        if np.linalg.norm(
            path.point_at(station := path.find_nearest_station(spawn)) - np.array(spawn)
        )
        < SAME_LANE_M
    ]


STEADY_SPEED_FRACTION = 0.88
"""Fraction of the highest speed from which it can stop, so it can keep its speed for a moment."""
STOPPING_MARGIN_M = 2.2
"""Minimum distance of its front from the crossing of both paths."""


def compute_actor_speed_m_s(case: ConflictCase, place: ActorPlacement) -> float:
    """Compute the actor's speed: as drawn, or the highest from which it can still stop short."""
    if case.conflict.actor.behaviour != "stops_short":
        return case.speed_m_s
    room = place.approach_m - case.actor.length_m / 2 - STOPPING_MARGIN_M
    highest = np.sqrt(2 * max(room, 0.0) / _sum_inverse_limits(case))
    return round(float(min(case.speed_m_s, STEADY_SPEED_FRACTION * highest)), 3)


def compute_needed_approach_m(case: ConflictCase) -> float:
    """Compute how far from the meeting an actor must start to reach its speed and stop short."""
    steady_m = (case.speed_m_s / STEADY_SPEED_FRACTION) ** 2 / 2 * _sum_inverse_limits(case)
    return steady_m + case.actor.length_m / 2 + STOPPING_MARGIN_M


def compute_timely_speed_m_s(case: ConflictCase, place: ActorPlacement) -> float:
    """Compute the highest speed at which an actor from rest completes its approach in time.

    At the speed v that takes `v / 2a + (k v^2 + c) / v`; `k v^2 + c` is the needed approach.
    """
    slope = 1 / (2 * case.parameters["acceleration_m_s2"])
    slope += _sum_inverse_limits(case) / (2 * STEADY_SPEED_FRACTION**2)
    standing_m = case.actor.length_m / 2 + STOPPING_MARGIN_M
    at_s = case.drive.motion.time_at(place.station_m)
    return float((at_s + np.sqrt(max(at_s**2 - 4 * slope * standing_m, 0.0))) / (2 * slope))


def _sum_inverse_limits(case: ConflictCase) -> float:
    parameters = case.parameters
    return 1 / parameters["acceleration_m_s2"] + 1 / parameters["braking_m_s2"]
