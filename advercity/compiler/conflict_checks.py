"""Whether a solved conflict can happen: speeds, room, bodies, timing, place and sight."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain

import numpy as np
from advercity_dsl import Conflict, Density, Road, StagedActor, StagedConflict

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
    case = _Case(conflict, road, density, staged)
    checks = (
        case.envelope,
        case.room,
        case.bodies,
        case.sideways,
        case.arrival,
        case.braking,
        case.place,
        case.sight,
        case.walkers,
    )
    for where, message, hint in chain.from_iterable(check() for check in checks):
        return library.problem(conflict, *where, message=message, hint=hint)
    return None


Complaints = Iterator[tuple[tuple[str, ...], str, str]]
"""Which field, what is wrong, and the way out."""


@dataclass(frozen=True)
class _Case:
    conflict: Conflict
    road: Road
    density: Density
    staged: StagedConflict

    @property
    def actor(self) -> StagedActor:
        return self.staged.actors[0]

    def envelope(self) -> Complaints:
        low, high = ends(self.conflict.parameters.ego_speed_km_h.draw)
        cap = ego_of(self.road).max_speed_km_h
        left = min(high, cap) - low
        if left < SPEED_LEFT_KM_H:
            message = (
                f"{low:g} to {high:g} km/h leave {max(left, 0):g} km/h below the ego's"
                f" {cap:g} km/h on '{self.road.id}'; at least {SPEED_LEFT_KM_H:g} are needed"
            )
            yield ("parameters", "ego_speed_km_h"), message, "widen the range or leave the road out"

    def room(self) -> Complaints:
        low, _ = ends(self.conflict.parameters.actor_speed_km_h.draw)
        speed = self.staged.parameters["actor_speed_km_h"]
        if speed < 0.6 * low:
            message = (
                f"on '{self.road.id}' there is room to reach {speed:.1f} km/h and stop again, not"
                f" the {low:g} km/h asked for"
            )
            yield ("parameters", "actor_speed_km_h"), message, "lower it, or start farther away"

    def bodies(self) -> Complaints:
        most = FASTEST_KM_H.get(self.actor.actor_class)
        _, high = ends(self.conflict.parameters.actor_speed_km_h.draw)
        if most is not None and high > most:
            who = "a pedestrian" if self.actor.actor_class == "pedestrian" else "a cyclist"
            message = f"up to {high:g} km/h, but {who} goes no faster than {most:g} km/h"
            yield ("parameters", "actor_speed_km_h"), message, "lower it"

    def sideways(self) -> Complaints:
        verb, given = self.actor.behaviour, self.staged.parameters
        if verb in SIDEWAYS_M_S2:
            shift = given["encroachment_m"] + 0.7
            found = QUINTIC_PEAK * shift / given["drift_time_s"] ** 2
            if found > SIDEWAYS_M_S2[verb]:
                most = f"nobody who {verb} exceeds {SIDEWAYS_M_S2[verb]:g}"
                message = f"{verb} with {found:.1f} m/s2; {most}"
                yield ("parameters", "drift_time_s"), message, "lengthen it"

    def arrival(self) -> Complaints:
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
                yield ("parameters", "actor_speed_km_h"), message, hint

    def braking(self) -> Complaints:
        most = self.staged.outcome.time_to_collision_below_s
        nearest = self.actor.speed_m_s / (2 * self.actor.braking_m_s2)
        if self.actor.behaviour == "stops_short" and nearest > most:
            message = (
                f"an actor that brakes as late as it can is {nearest:.1f} s away then, on"
                f" '{self.road.id}'; that is never below {most:g} s"
            )
            yield ("outcome", "time_to_collision_below_s"), message, "raise it, or brake harder"

    def place(self) -> Complaints:
        ways = RoadWays(self.road)
        way, start, end = ego_way(ways, ego_of(self.road))
        station = way.nearest(self.staged.point_m)
        gap = float(np.linalg.norm(way.at(station) - np.array(self.staged.point_m)))
        if gap > OFF_THE_WAY_M:
            message = (
                f"the conflict point lies {gap:.1f} m beside the ego's way on '{self.road.id}'"
            )
            yield ("actor", "comes"), message, "choose another side"
        if station > end - 10.0 or nominal(self.road, ways, way, start).time(station) < 0:
            message = f"the conflict point on '{self.road.id}' lies beyond where the scenario ends"
            yield ("actor", "comes"), message, "move the ego's destination on"

    def sight(self) -> Complaints:
        given = self.staged.parameters
        if "obstruction_gap_m" in given and "occlusion_m" not in given:
            message = (
                f"on '{self.road.id}' the ego sees the actor all the time: parked cars that end"
                f" {given['obstruction_gap_m']:.1f} m before it hide nothing"
            )
            yield ("parameters", "obstruction_gap_m"), message, "let them end nearer"

    def walkers(self) -> Complaints:
        if self.actor.actor_class == "pedestrian" and self.road.traffic.walkers == 0:
            message = (
                f"'{self.road.id}' has no walkers, whose number '{self.density.id}' could change"
            )
            yield ("actor", "classes"), message, "give the road walkers or leave it out"
