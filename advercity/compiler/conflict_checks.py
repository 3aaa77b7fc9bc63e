"""Whether a solved conflict can happen: speeds, room, bodies, timing, place and senses."""

import numpy as np
from advercity_dsl import Conflict, Density, Road, StagedConflict

from advercity.compiler.library import Library
from advercity.compiler.nominal import nominal
from advercity.compiler.problems import Problem
from advercity.compiler.sampling import ends
from advercity.compiler.ways import RoadWays, ego_of, ego_way

SPEED_LEFT_KM_H = 5.0
FASTEST_KM_H = {"pedestrian": 12.0, "bicycle": 40.0}
SIDEWAYS_M_S2 = {"drifts": 2.4, "overtakes": 1.5}
"""Most a driver leaves the lane with; a lane change of Euro NCAP has up to 1.5."""
QUINTIC_PEAK = 5.7735
"""Largest second derivative of the quintic from 0 to 1."""
OFF_THE_WAY_M = 1.0


def misfit(
    library: Library, conflict: Conflict, road: Road, density: Density, staged: StagedConflict
) -> Problem | None:
    """The first thing that keeps a solved conflict from happening; None if nothing does."""
    checks = (_envelope, _room, _bodies, _timing, _place, _sight, _senses)
    for check in checks:
        found = check(conflict, road, density, staged)
        if found is not None:
            where, message, hint = found
            return library.problem(conflict, *where, message=message, hint=hint)
    return None


Found = tuple[tuple[str, ...], str, str] | None


def _envelope(conflict: Conflict, road: Road, density: Density, staged: StagedConflict) -> Found:
    low, high = ends(conflict.parameters.ego_speed_km_h.draw)
    cap = ego_of(road).max_speed_km_h
    left = min(high, cap) - low
    if left < SPEED_LEFT_KM_H:
        message = (
            f"{low:g} to {high:g} km/h leave {max(left, 0):g} km/h below the ego's {cap:g} km/h on"
            f" '{road.id}'; at least {SPEED_LEFT_KM_H:g} are needed"
        )
        return ("parameters", "ego_speed_km_h"), message, "widen the range or leave the road out"
    return None


def _room(conflict: Conflict, road: Road, density: Density, staged: StagedConflict) -> Found:
    low, _ = ends(conflict.parameters.actor_speed_km_h.draw)
    speed = staged.parameters["actor_speed_km_h"]
    if speed < 0.6 * low:
        message = (
            f"on '{road.id}' there is room to reach {speed:.1f} km/h and stop again, not the"
            f" {low:g} km/h asked for"
        )
        return ("parameters", "actor_speed_km_h"), message, "lower it, or start farther away"
    return None


def _bodies(conflict: Conflict, road: Road, density: Density, staged: StagedConflict) -> Found:
    actor = staged.actors[0]
    most = FASTEST_KM_H.get(actor.actor_class)
    _, high = ends(conflict.parameters.actor_speed_km_h.draw)
    if most is not None and high > most:
        who = "a pedestrian" if actor.actor_class == "pedestrian" else "a cyclist"
        message = f"up to {high:g} km/h, but {who} goes no faster than {most:g} km/h"
        return ("parameters", "actor_speed_km_h"), message, "lower it"
    if actor.behaviour in SIDEWAYS_M_S2:
        verb, most = actor.behaviour, SIDEWAYS_M_S2[actor.behaviour]
        shift = staged.parameters["encroachment_m"] + 0.7
        sideways = QUINTIC_PEAK * shift / staged.parameters["drift_time_s"] ** 2
        if sideways > most:
            message = f"{verb} with {sideways:.1f} m/s2; nobody who {verb} exceeds {most:g}"
            return ("parameters", "drift_time_s"), message, "lengthen it"
    return None


def _timing(conflict: Conflict, road: Road, density: Density, staged: StagedConflict) -> Found:
    actor = staged.actors[0]
    middle = sum(staged.window_s) / 2
    if actor.behaviour != "stops_short":
        return None
    speed, gains, loses = actor.speed_m_s, actor.acceleration_m_s2, actor.braking_m_s2
    least = speed / (2 * gains) + staged.parameters["approach_m"] / speed
    if actor.route and least > middle:
        message = (
            f"the actor needs {least:.1f} s to the point, but the ego is there after"
            f" {middle:.1f} s on '{road.id}'"
        )
        return ("parameters", "actor_speed_km_h"), message, "let it start nearer or go faster"
    nearest = speed / (2 * loses)
    if nearest > staged.outcome.time_to_collision_below_s:
        message = (
            f"an actor that brakes as late as it can is {nearest:.1f} s away then, on '{road.id}';"
            f" that is never below {staged.outcome.time_to_collision_below_s:g} s"
        )
        return ("outcome", "time_to_collision_below_s"), message, "raise it, or brake harder"
    return None


def _place(conflict: Conflict, road: Road, density: Density, staged: StagedConflict) -> Found:
    ways = RoadWays(road)
    way, start, end = ego_way(ways, ego_of(road))
    station = way.nearest(staged.point_m)
    gap = float(np.linalg.norm(way.at(station) - np.array(staged.point_m)))
    if gap > OFF_THE_WAY_M:
        message = f"the conflict point lies {gap:.1f} m beside the ego's way on '{road.id}'"
        return ("actor", "comes"), message, "choose another side"
    kept_s = nominal(road, ways, way, start).time(station)
    if station > end - 10.0 or kept_s < 0:
        message = f"the conflict point on '{road.id}' lies beyond where the scenario ends"
        return ("actor", "comes"), message, "move the ego's destination on"
    return None


def _sight(conflict: Conflict, road: Road, density: Density, staged: StagedConflict) -> Found:
    if "obstruction_gap_m" in staged.parameters and "occlusion_m" not in staged.parameters:
        message = (
            f"on '{road.id}' the ego sees the actor all the time: parked cars that end"
            f" {staged.parameters['obstruction_gap_m']:.1f} m before it hide nothing"
        )
        return ("parameters", "obstruction_gap_m"), message, "let them end nearer"
    return None


def _senses(conflict: Conflict, road: Road, density: Density, staged: StagedConflict) -> Found:
    if staged.actors[0].actor_class == "pedestrian" and road.traffic.walkers == 0:
        message = f"'{road.id}' has no walkers, whose number '{density.id}' could change"
        return ("actor", "classes"), message, "give the road walkers or leave it out"
    return None
