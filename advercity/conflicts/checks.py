"""Check whether a solved conflict can happen: speeds, distances, timing, location and sight."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from advercity_dsl import Conflict, Density, Road, StagedActor, StagedConflict, Timing
from advercity_dsl.distribution import compute_bounds
from advercity_dsl.units import KM_H_PER_M_S

from advercity.conflicts.case import CALM_S
from advercity.conflicts.ego_motion import EgoDrive
from advercity.conflicts.trajectories import QUINTIC_PEAK_ACCELERATION

MIN_SPEED_RANGE_KM_H = 5.0
SPEED_ROUNDING_KM_H = 0.01
"""Rounding error: conflicts declare km/h with four digits, specs m/s with three decimals."""
MAX_SPEED_KM_H = {"pedestrian": 12.0, "bicycle": 40.0}
MAX_LATERAL_M_S2 = {"drifts": 2.4, "overtakes": 1.5}
"""Maximum lateral acceleration when leaving the lane; Euro NCAP's lane changes reach 1.5."""
DRIFT_EXTRA_M = 0.7
"""Estimate of an actor's lateral shift beyond its encroachment, up to the edge of its lane."""
MAX_PATH_GAP_M = 1.0


@dataclass(frozen=True)
class Finding:
    """A reason that rules out a solved conflict.

    Attributes:
        field: Path of the conflict's field to change.
        message: The error.
        hint: How to correct it.
        comes_too_soon: Whether a later start of the ego would make the conflict possible.
    """

    field: tuple[str, ...]
    message: str
    hint: str
    comes_too_soon: bool = False


@dataclass(frozen=True)
class _Solution:
    conflict: Conflict
    drive: EgoDrive
    density: Density
    staged: StagedConflict

    @property
    def road(self) -> Road:
        return self.drive.road

    @property
    def actor(self) -> StagedActor:
        return self.staged.actors[0]


def find_infeasibility(
    conflict: Conflict, drive: EgoDrive, density: Density, staged: StagedConflict
) -> Finding | None:
    """Return the first reason that rules out a solved conflict; None if it can happen."""
    solution = _Solution(conflict, drive, density, staged)
    checks = (
        _check_ego_speed,
        _check_approach,
        _check_actor_speed,
        _check_lateral_acceleration,
        _check_arrival,
        _check_braking,
        _check_resolver,
        _check_location,
        _check_occlusion,
        _check_walkers,
    )
    findings = (check(solution) for check in checks)
    return next((finding for finding in findings if finding is not None), None)


def compute_first_event_s(timing: Timing) -> float:
    """Compute the time from the scenario's start to the first permitted critical event."""
    return timing.warm_up_ticks * timing.tick_s + CALM_S


def find_crowding(
    staged: StagedConflict, earlier: Sequence[StagedConflict], timing: Timing
) -> Finding | None:
    """Return why a conflict comes too soon after the start or after another; None if it does not.

    The recording shows both parties before they meet, and a reaction ends before the next event.
    """
    meets_s, first_s = compute_meeting_s(staged), compute_first_event_s(timing)
    previous = max(earlier, key=compute_meeting_s, default=None)
    if meets_s < first_s:
        after, left_s = "the recording begins", meets_s - first_s + CALM_S
        hint = "raise waits_s of the road's ego, or lower timing.warm_up_ticks of the suite"
    elif previous is not None and meets_s - compute_meeting_s(previous) < CALM_S:
        after, left_s = f"'{previous.conflict}'", meets_s - compute_meeting_s(previous)
        hint = "stage fewer in one scenario: lower staged_at_once, or leave one out"
    else:
        return None
    message = f"comes {left_s:.1f} s after {after}; at least {CALM_S:g} s are needed"
    return Finding(("id",), message, hint, comes_too_soon=meets_s < first_s)


def compute_meeting_s(staged: StagedConflict) -> float:
    """Compute the expected time of a meeting from the scenario's start."""
    return sum(staged.window_s) / 2


def _check_ego_speed(solution: _Solution) -> Finding | None:
    low, high = compute_bounds(solution.conflict.parameters.ego_speed_km_h.draw)
    drive = solution.drive
    station = drive.path.find_nearest_station(solution.staged.point_m)
    limit = drive.motion.find_top_speed_m_s(station) * KM_H_PER_M_S
    left = min(high, limit) - low
    if left >= MIN_SPEED_RANGE_KM_H:
        return None
    message = (
        f"{low:g} to {high:g} km/h leave {max(left, 0):.1f} km/h below the {limit:.1f} km/h that"
        f" the ego drives there on '{solution.road.id}'; {MIN_SPEED_RANGE_KM_H:g} are needed"
    )
    hint = "widen the range or leave the road out"
    return Finding(("parameters", "ego_speed_km_h"), message, hint)


def _check_approach(solution: _Solution) -> Finding | None:
    low, high = compute_bounds(solution.conflict.parameters.actor_speed_km_h.draw)
    speed = solution.staged.parameters["actor_speed_km_h"]
    if speed >= low - SPEED_ROUNDING_KM_H:
        return None
    asked = f"{low:g}" if low == high else f"{low:g} to {high:g}"
    message = (
        f"on '{solution.road.id}' there is room to reach {speed:.1f} km/h and stop again, not the"
        f" {asked} km/h asked for"
    )
    hint = "lower it, or start farther away"
    return Finding(("parameters", "actor_speed_km_h"), message, hint, comes_too_soon=True)


def _check_actor_speed(solution: _Solution) -> Finding | None:
    limit = MAX_SPEED_KM_H.get(solution.actor.actor_class)
    _, high = compute_bounds(solution.conflict.parameters.actor_speed_km_h.draw)
    if limit is None or high <= limit:
        return None
    noun = "a pedestrian" if solution.actor.actor_class == "pedestrian" else "a cyclist"
    message = f"up to {high:g} km/h, but {noun} goes no faster than {limit:g} km/h"
    return Finding(("parameters", "actor_speed_km_h"), message, "lower it")


def _check_lateral_acceleration(solution: _Solution) -> Finding | None:
    behaviour, parameters = solution.actor.behaviour, solution.staged.parameters
    if behaviour not in MAX_LATERAL_M_S2:
        return None
    shift_m = parameters["encroachment_m"] + DRIFT_EXTRA_M
    found = QUINTIC_PEAK_ACCELERATION * shift_m / parameters["drift_time_s"] ** 2
    limit = MAX_LATERAL_M_S2[behaviour]
    if found <= limit:
        return None
    message = f"{behaviour} with {found:.1f} m/s2; no driver that {behaviour} exceeds {limit:g}"
    return Finding(("parameters", "drift_time_s"), message, "lengthen it")


def _check_arrival(solution: _Solution) -> Finding | None:
    actor, expected_s = solution.actor, compute_meeting_s(solution.staged)
    # Actors with their own path may set out before the scenario begins.
    if actor.behaviour != "stops_short" or not actor.route:
        return None
    accelerating_s = actor.speed_m_s / (2 * actor.acceleration_m_s2)
    needed_s = accelerating_s + solution.staged.parameters["approach_m"] / actor.speed_m_s
    if needed_s <= expected_s:
        return None
    message = (
        f"the actor needs {needed_s:.1f} s to the point, but the ego is there after"
        f" {expected_s:.1f} s on '{solution.road.id}'"
    )
    hint = "let it start nearer or go faster"
    return Finding(("parameters", "actor_speed_km_h"), message, hint, comes_too_soon=True)


def _check_braking(solution: _Solution) -> Finding | None:
    actor, limit_s = solution.actor, solution.staged.outcome.time_to_collision_below_s
    nearest_s = actor.speed_m_s / (2 * actor.braking_m_s2)
    if actor.behaviour != "stops_short" or nearest_s <= limit_s:
        return None
    message = (
        f"an actor that brakes as late as it can is {nearest_s:.1f} s away then, on"
        f" '{solution.road.id}'; that is never below {limit_s:g} s"
    )
    hint = "raise it, or brake harder"
    return Finding(("outcome", "time_to_collision_below_s"), message, hint)


def _check_resolver(solution: _Solution) -> Finding | None:
    if solution.staged.resolved_by in ("actor", "nobody"):
        return None
    if solution.actor.behaviour in ("overtakes", "steers_clear"):
        message = f"the ego cannot avoid an actor that {solution.actor.behaviour}"
        return Finding(("resolved_by",), message, "write {actor: 1}, or nobody")
    brakes = solution.actor.behaviour == "stops_short"
    if not brakes or "ego_braking_m_s2" in solution.staged.parameters:
        return None
    message = "is missing: the ego brakes where it takes part in resolving the conflict"
    return Finding(("parameters",), f"ego_braking_m_s2 {message}", "add it, in m/s2: {draw: 5}")


def _check_location(solution: _Solution) -> Finding | None:
    road, drive, point = solution.road, solution.drive, solution.staged.point_m
    station = drive.path.find_nearest_station(point)
    gap_m = float(np.linalg.norm(drive.path.point_at(station) - np.array(point)))
    if gap_m > MAX_PATH_GAP_M:
        message = f"the conflict point is {gap_m:.1f} m off the ego's path on '{road.id}'"
        return Finding(("actor", "comes"), message, "choose another side")
    if station > drive.end_m or drive.motion.time_at(station) < 0:
        message = f"the conflict point on '{road.id}' lies beyond where the scenario ends"
        return Finding(("actor", "comes"), message, "move the ego's destination on")
    return None


def _check_occlusion(solution: _Solution) -> Finding | None:
    parameters = solution.staged.parameters
    if "obstruction_gap_m" not in parameters or "occlusion_m" in parameters:
        return None
    message = (
        f"on '{solution.road.id}' the ego sees the actor all the time: parked cars that end"
        f" {parameters['obstruction_gap_m']:.1f} m before it hide nothing"
    )
    return Finding(("parameters", "obstruction_gap_m"), message, "let them end nearer")


def _check_walkers(solution: _Solution) -> Finding | None:
    if solution.actor.actor_class != "pedestrian" or solution.road.traffic.walkers > 0:
        return None
    message = (
        f"'{solution.road.id}' has no walkers, whose number '{solution.density.id}' could change"
    )
    return Finding(("actor", "classes"), message, "give the road walkers or leave it out")
