"""Whether a solved conflict can happen: speeds, room, bodies, timing, place and sight."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain

import numpy as np
from advercity_dsl import Conflict, Density, Road, StagedActor, StagedConflict

from advercity.conflicts.case import compute_bounds
from advercity.conflicts.ego_motion import compute_nominal_motion
from advercity.roads.routes import RoutePlanner, build_ego_path

MIN_SPEED_RANGE_KM_H = 5.0
MAX_SPEED_KM_H = {"pedestrian": 12.0, "bicycle": 40.0}
MAX_LATERAL_M_S2 = {"drifts": 2.4, "overtakes": 1.5}
"""Most a driver leaves the lane with; a lane change of Euro NCAP has up to 1.5."""
QUINTIC_PEAK_ACCELERATION = 5.7735
"""Largest second derivative of the quintic from 0 to 1."""
MAX_PATH_GAP_M = 1.0


@dataclass(frozen=True)
class Finding:
    """A reason why a solved conflict cannot happen.

    Attributes:
        field: Path of the conflict's field that has to change.
        message: What is wrong.
        hint: What to do about it.
    """

    field: tuple[str, ...]
    message: str
    hint: str


def find_infeasibility(
    conflict: Conflict, road: Road, density: Density, staged: StagedConflict
) -> Finding | None:
    """Return the first reason why a solved conflict cannot happen; None if it can."""
    case = _ConflictChecks(conflict, road, density, staged)
    checks = (
        case.check_ego_speed,
        case.check_approach,
        case.check_actor_speed,
        case.check_lateral_acceleration,
        case.check_arrival,
        case.check_braking,
        case.check_location,
        case.check_occlusion,
        case.check_walkers,
    )
    return next(chain.from_iterable(check() for check in checks), None)


Findings = Iterator[Finding]


@dataclass(frozen=True)
class _ConflictChecks:
    conflict: Conflict
    road: Road
    density: Density
    staged: StagedConflict

    @property
    def actor(self) -> StagedActor:
        return self.staged.actors[0]

    def check_ego_speed(self) -> Findings:
        low, high = compute_bounds(self.conflict.parameters.ego_speed_km_h.draw)
        cap = self.road.ego.max_speed_km_h
        left = min(high, cap) - low
        if left < MIN_SPEED_RANGE_KM_H:
            message = (
                f"{low:g} to {high:g} km/h leave {max(left, 0):g} km/h below the ego's"
                f" {cap:g} km/h on '{self.road.id}'; at least {MIN_SPEED_RANGE_KM_H:g} are needed"
            )
            yield Finding(
                ("parameters", "ego_speed_km_h"), message, "widen the range or leave the road out"
            )

    def check_approach(self) -> Findings:
        low, _ = compute_bounds(self.conflict.parameters.actor_speed_km_h.draw)
        speed = self.staged.parameters["actor_speed_km_h"]
        if speed < 0.6 * low:
            message = (
                f"on '{self.road.id}' there is room to reach {speed:.1f} km/h and stop again, not"
                f" the {low:g} km/h asked for"
            )
            yield Finding(
                ("parameters", "actor_speed_km_h"), message, "lower it, or start farther away"
            )

    def check_actor_speed(self) -> Findings:
        most = MAX_SPEED_KM_H.get(self.actor.actor_class)
        _, high = compute_bounds(self.conflict.parameters.actor_speed_km_h.draw)
        if most is not None and high > most:
            who = "a pedestrian" if self.actor.actor_class == "pedestrian" else "a cyclist"
            message = f"up to {high:g} km/h, but {who} goes no faster than {most:g} km/h"
            yield Finding(("parameters", "actor_speed_km_h"), message, "lower it")

    def check_lateral_acceleration(self) -> Findings:
        verb, given = self.actor.behaviour, self.staged.parameters
        if verb in MAX_LATERAL_M_S2:
            shift = given["encroachment_m"] + 0.7
            found = QUINTIC_PEAK_ACCELERATION * shift / given["drift_time_s"] ** 2
            if found > MAX_LATERAL_M_S2[verb]:
                most = f"nobody who {verb} exceeds {MAX_LATERAL_M_S2[verb]:g}"
                message = f"{verb} with {found:.1f} m/s2; {most}"
                yield Finding(("parameters", "drift_time_s"), message, "lengthen it")

    def check_arrival(self) -> Findings:
        speed, middle = self.actor.speed_m_s, sum(self.staged.window_s) / 2
        if self.actor.behaviour == "stops_short" and self.actor.route:
            gaining = speed / (2 * self.actor.acceleration_m_s2)
            least = gaining + self.staged.parameters["approach_m"] / speed
            if least > middle:
                message = (
                    f"the actor needs {least:.1f} s to the point, but the ego is there after"
                    f" {middle:.1f} s on '{self.road.id}'"
                )
                hint = "let it start nearer or go faster"
                yield Finding(("parameters", "actor_speed_km_h"), message, hint)

    def check_braking(self) -> Findings:
        most = self.staged.outcome.time_to_collision_below_s
        nearest = self.actor.speed_m_s / (2 * self.actor.braking_m_s2)
        if self.actor.behaviour == "stops_short" and nearest > most:
            message = (
                f"an actor that brakes as late as it can is {nearest:.1f} s away then, on"
                f" '{self.road.id}'; that is never below {most:g} s"
            )
            yield Finding(
                ("outcome", "time_to_collision_below_s"), message, "raise it, or brake harder"
            )

    def check_location(self) -> Findings:
        ways = RoutePlanner(self.road)
        way, start, end = build_ego_path(ways, self.road.ego)
        station = way.find_nearest_station(self.staged.point_m)
        gap = float(np.linalg.norm(way.point_at(station) - np.array(self.staged.point_m)))
        if gap > MAX_PATH_GAP_M:
            message = (
                f"the conflict point lies {gap:.1f} m beside the ego's way on '{self.road.id}'"
            )
            yield Finding(("actor", "comes"), message, "choose another side")
        if (
            station > end - 10.0
            or compute_nominal_motion(self.road, ways, way, start).time_at(station) < 0
        ):
            message = f"the conflict point on '{self.road.id}' lies beyond where the scenario ends"
            yield Finding(("actor", "comes"), message, "move the ego's destination on")

    def check_occlusion(self) -> Findings:
        given = self.staged.parameters
        if "obstruction_gap_m" in given and "occlusion_m" not in given:
            message = (
                f"on '{self.road.id}' the ego sees the actor all the time: parked cars that end"
                f" {given['obstruction_gap_m']:.1f} m before it hide nothing"
            )
            yield Finding(("parameters", "obstruction_gap_m"), message, "let them end nearer")

    def check_walkers(self) -> Findings:
        if self.actor.actor_class == "pedestrian" and self.road.traffic.walkers == 0:
            message = (
                f"'{self.road.id}' has no walkers, whose number '{self.density.id}' could change"
            )
            yield Finding(("actor", "classes"), message, "give the road walkers or leave it out")
