"""Time approaches to a junction: both arrive moving, and actors run lights just after red."""

from dataclasses import replace

from advercity_dsl.road import Signals

from advercity.conflicts.approaches import STOP_LINE_GAP_M, find_ego_intersection
from advercity.conflicts.case import CALM_S, ActorPlacement, ConflictCase
from advercity.roads.signals import find_declared_green_s

GREEN_AHEAD_S = 3.0
"""Time before the ego's arrival at a stop line by which it has green, to pass without braking."""
RESTARTED_M = 15.0
"""Distance after a stop line at which an ego that waited there is fast again."""
SHORT_WAIT_S = 3.0
"""Longest wait at red for which the lights change instead."""


def find_run_lights(case: ConflictCase, place: ActorPlacement) -> Signals | None:
    """Find the declared program of the actor's light; None if both have green together."""
    intersection = case.drive.intersection
    if "since_red_s" not in case.parameters or place.approach_street is None or not intersection:
        return None
    junction, before, _ = intersection
    declared = case.drive.road.junctions.get(junction)
    streets = {before.street.id, place.approach_street}
    if declared is None or case.drive.planner.have_green_together(junction, streets):
        return None
    return declared.signals


def ignore_lights(case: ConflictCase) -> ConflictCase:
    """Return the case with an ego that ignores the lights at its junction."""
    junction, _, _ = find_ego_intersection(case.drive)
    return replace(case, drive=case.drive.with_lights(junction, None))


def time_lights(case: ConflictCase, place: ActorPlacement, lights: Signals) -> ConflictCase:
    """Return the case with a program that turns red for the actor just before both come.

    The actor's approach has green just before the ego's.

    Args:
        case: A conflict whose actor runs a light, and whose ego ignores the lights.
        place: Where the actor comes from.
        lights: Declared program of the junction.
    """
    junction, before, _ = find_ego_intersection(case.drive)
    own, other = (
        next(at for at, phase in enumerate(lights.phases) if street in phase)
        for street in (before.street.id, place.approach_street)
    )
    cycle = list(lights.cycle)
    cycle[own - 1], cycle[other] = cycle[other], cycle[own - 1]
    slot_s = lights.green_s + lights.yellow_s + lights.all_red_s
    meets_s = case.drive.motion.time_at(place.station_m) + case.parameters["arrival_offset_s"]
    at_line_s = meets_s - place.beyond_line_m / case.speed_m_s
    green_s = at_line_s - case.parameters["since_red_s"] + lights.all_red_s
    elapsed_s = round((own * slot_s - green_s) % (slot_s * len(cycle)), 1)
    timed = lights.model_copy(update={"cycle": tuple(cycle), "elapsed_s": elapsed_s})
    return replace(case, drive=case.drive.with_lights(junction, timed))


def advance_green(case: ConflictCase, place: ActorPlacement) -> ConflictCase:
    """Return the case with green in time for an ego that would brake for red, or wait shortly.

    Otherwise it would be slower than drawn at a meeting soon after the stop line.
    """
    if case.drive.intersection is None:
        return case
    junction, before, _ = case.drive.intersection
    declared = case.drive.road.junctions.get(junction)
    is_near = place.station_m - before.end_m < RESTARTED_M
    if declared is None or declared.signals is None or not is_near:
        return case
    lights, free = declared.signals, case.drive.with_lights(junction, None).motion
    line_m = before.end_m - STOP_LINE_GAP_M - case.ego.length_m / 2
    needed_s = free.time_at(line_m) - GREEN_AHEAD_S
    late_s = find_declared_green_s(lights, before.street.id, needed_s) - needed_s
    if not 0 < late_s < GREEN_AHEAD_S + SHORT_WAIT_S:
        return case
    slots_s = len(lights.cycle) * (lights.green_s + lights.yellow_s + lights.all_red_s)
    elapsed_s = round((lights.elapsed_s + late_s) % slots_s, 1)
    timed = lights.model_copy(update={"elapsed_s": elapsed_s})
    return replace(case, drive=case.drive.with_lights(junction, timed))


def shorten_wait(case: ConflictCase, place: ActorPlacement) -> ConflictCase:
    """Return the case with a shorter wait of the ego at its start, if the actor would stand.

    An actor through the junction sets out before the recording begins, if it can.
    """
    if place.approach_street is None:
        return case
    meets_s = case.drive.motion.time_at(place.station_m)
    acceleration = case.parameters["acceleration_m_s2"]
    drives_s = place.approach_m / case.speed_m_s + case.speed_m_s / (2 * acceleration)
    stands_s = meets_s - drives_s - (case.not_before_s - CALM_S)
    earlier_s = min(stands_s, meets_s - case.not_before_s, case.drive.road.ego.waits_s)
    if earlier_s <= 0:
        return case
    waits_s = round(case.drive.road.ego.waits_s - earlier_s, 1)
    return replace(case, drive=case.drive.with_waits(waits_s))
