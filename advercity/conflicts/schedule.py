"""The parts that staged actors play, timed by when the ego came by in a rehearsal."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import shapely
from advercity_dsl import Spec, StagedActor, StagedConflict
from numpy.typing import NDArray

from advercity.conflicts.metrics import ActorTrack
from advercity.conflicts.trajectories import (
    DRIFT_RETURN_MARGIN_S,
    ActorPath,
    compute_lateral_offsets,
    compute_path_crossing,
    compute_stop_stations,
    find_nearest_tick,
    find_passing,
    shift_laterally,
)
from advercity.frames import Trace
from advercity.roads.lane_graph import LaneGraph
from advercity.traffic.demand import TrafficDemand, VehicleTrip
from advercity.traffic.kinematics import SumoRecording, build_trace
from advercity.traffic.speed_profile import list_route_lanes


@dataclass(frozen=True, eq=False)
class ActorSchedule:
    """What an actor is to do.

    Attributes:
        speed_commands_m_s: Speed in every tick for SUMO, NaN leaves it to the driver; None if it
            is not there.
        trigger_s: The time that the cue is about.
        track: `FRONT` rows in place of what SUMO records; None keeps those.
        is_untriggered: Whether it only waits, since the ego never came by.
    """

    speed_commands_m_s: NDArray[np.float64] | None = None
    trigger_s: float = 0.0
    track: NDArray[np.void] | None = None
    is_untriggered: bool = False


def schedule_actors(
    spec: Spec,
    demand: TrafficDemand,
    graph: LaneGraph,
    recording: SumoRecording,
    previous: Mapping[int, ActorSchedule],
) -> dict[int, ActorSchedule]:
    """What every staged actor is to do, given how the last rehearsal went."""
    rehearsal = build_trace(spec, demand, recording, first_tick=0)
    ego = ActorTrack.from_trace(rehearsal, spec.ego.number)
    stage = _Scheduler(spec, demand, graph, recording, rehearsal, ego, previous)
    return {
        actor.number: stage.schedule(conflict, actor)
        for conflict in spec.conflicts
        for actor in conflict.actors
    }


@dataclass(frozen=True)
class _Scheduler:
    spec: Spec
    demand: TrafficDemand
    graph: LaneGraph
    recording: SumoRecording
    rehearsal: Trace
    ego: ActorTrack
    previous: Mapping[int, ActorSchedule]

    def schedule(self, conflict: StagedConflict, actor: StagedActor) -> ActorSchedule:
        match actor.behaviour:
            case "stops_short":
                return self._schedule_stop(conflict, actor)
            case "drifts" | "overtakes":
                return self._schedule_drift(conflict, actor)
            case "drives" if conflict.actors[0].behaviour == "overtakes":
                return self._schedule_passed(conflict, actor)
            case "steers_clear":
                return self._schedule_evasion(conflict, actor)
            case "stands":
                path = ActorPath(np.array(actor.path_m))
                middle = np.full(len(self.recording), path.length_m / 2)
                return ActorSchedule(track=self._build_track(path, middle, actor, conflict))
            case _:
                return ActorSchedule(speed_commands_m_s=np.array([np.nan]))

    def _schedule_stop(self, conflict: StagedConflict, actor: StagedActor) -> ActorSchedule:
        tick_s, size = self.spec.timing.tick_s, self._find_size(actor)
        path = self._build_path(actor)
        met = compute_path_crossing(path, size, self.ego, conflict.point_m, tick_s)
        if met is None and actor.route:
            return ActorSchedule(speed_commands_m_s=np.zeros(1), is_untriggered=True)
        if met is None:
            stays = np.zeros(len(self.recording))
            return ActorSchedule(
                track=self._build_track(path, stays, actor, conflict), is_untriggered=True
            )
        stations, go_s = compute_stop_stations(
            met,
            actor,
            path.length_m,
            offset_s=conflict.parameters["arrival_offset_s"],
            post_encroachment_s=conflict.parameters["post_encroachment_s"],
            tick_s=tick_s,
            ticks=len(self.recording),
        )
        if not actor.route:
            return ActorSchedule(track=self._build_track(path, stations, actor, conflict))
        speeds = np.diff(stations, prepend=stations[0]) / tick_s
        speeds[round(go_s / tick_s) :] = np.nan
        return ActorSchedule(speed_commands_m_s=speeds, trigger_s=met.ego_s)

    def _schedule_evasion(self, conflict: StagedConflict, actor: StagedActor) -> ActorSchedule:
        tick_s, path = self.spec.timing.tick_s, self._build_path(actor)
        ego_s, distance = find_passing(path, self.ego, conflict.point_m, tick_s)
        start = distance - actor.speed_m_s * (ego_s + conflict.parameters["arrival_offset_s"])
        stations = start + actor.speed_m_s * tick_s * np.arange(len(self.recording))
        stations = np.clip(stations, 0.0, path.length_m).astype(np.float64)
        return ActorSchedule(track=self._build_track(path, stations, actor, conflict))

    def _schedule_drift(self, conflict: StagedConflict, actor: StagedActor) -> ActorSchedule:
        if actor.number not in self.previous:
            return ActorSchedule(speed_commands_m_s=np.array([actor.speed_m_s]))
        tick_s, given = self.spec.timing.tick_s, conflict.parameters
        other = ActorTrack.from_trace(self.rehearsal, actor.number)
        ego_s = _find_passing_tick(self.ego, conflict.point_m) * tick_s
        late_s = (
            _find_passing_tick(other, conflict.point_m) * tick_s - ego_s - given["arrival_offset_s"]
        )
        wait_s = max(self.previous[actor.number].trigger_s - late_s, 0.0)
        tick, apart_m = find_nearest_tick(self.ego, other)
        here, there = self.ego.at_ticks(np.array([tick])), other.at_ticks(np.array([tick]))
        closing = float((here.rows["speed"] + there.rows["speed"])[0])
        track = self.recording.tracks[actor.number]
        offsets = compute_lateral_offsets(
            track["tick"] * tick_s,
            shift_m=given["encroachment_m"] + apart_m / 2 - other.size[1] / 2,
            out_s=given["drift_time_s"],
            hold_s=self._compute_hold_s(conflict),
            return_s=given["return_time_s"],
            end_s=tick * tick_s
            - (self.ego.size[0] + other.size[0]) / 2 / closing
            - DRIFT_RETURN_MARGIN_S,
        )
        return ActorSchedule(
            speed_commands_m_s=_build_speed_commands(actor, wait_s, tick * tick_s, tick_s),
            trigger_s=wait_s,
            track=shift_laterally(track, offsets, tick_s),
        )

    def _compute_hold_s(self, conflict: StagedConflict) -> float:
        """How long the actor drives beside its lane: as long as it takes to pass somebody."""
        actor = conflict.actors[0]
        if actor.behaviour != "overtakes":
            return 0.0
        passed = conflict.actors[1]
        lengths = self._find_size(actor)[0] + self._find_size(passed)[0]
        gaps = 2 * conflict.parameters["passing_gap_m"]
        return (lengths + gaps) / (actor.speed_m_s - passed.speed_m_s)

    def _schedule_passed(self, conflict: StagedConflict, passed: StagedActor) -> ActorSchedule:
        """Rides so that the actor is ahead of it by the gap as it begins to come back."""
        if passed.number not in self.previous:
            return ActorSchedule(speed_commands_m_s=np.array([passed.speed_m_s]))
        actor, given, tick_s = conflict.actors[0], conflict.parameters, self.spec.timing.tick_s
        ego_s = _find_passing_tick(self.ego, conflict.point_m) * tick_s
        back_s = given["return_time_s"] + DRIFT_RETURN_MARGIN_S
        lengths = self._find_size(actor)[0] + self._find_size(passed)[0]
        before_m = actor.speed_m_s * back_s + lengths / 2 + given["passing_gap_m"]
        path = self._build_path(actor)
        there = path.points_at(
            np.array([path.line.project(shapely.Point(conflict.point_m)) - before_m])
        )
        track = ActorTrack.from_trace(self.rehearsal, passed.number)
        late_s = _find_passing_tick(track, tuple(there[0])) * tick_s - (ego_s - back_s)
        wait_s = max(self.previous[passed.number].trigger_s - late_s, 0.0)
        return ActorSchedule(
            speed_commands_m_s=_build_speed_commands(passed, wait_s, ego_s, tick_s),
            trigger_s=wait_s,
        )

    def _build_path(self, actor: StagedActor) -> ActorPath:
        if not actor.route:
            return ActorPath(np.array(actor.path_m))
        ride = self._find_trip(actor)
        lanes = list_route_lanes(ride, self.graph)
        return ActorPath.from_lanes(lanes, (ride.front_position_m or 0.0) - ride.actor.size[0] / 2)

    def _find_trip(self, actor: StagedActor) -> VehicleTrip:
        return next(ride for ride in self.demand.staged if ride.actor.id == actor.number)

    def _find_size(self, actor: StagedActor) -> tuple[float, float, float]:
        return next(one.size for one in self.demand.actors if one.id == actor.number)

    def _build_track(
        self,
        path: ActorPath,
        stations: NDArray[np.float64],
        actor: StagedActor,
        conflict: StagedConflict,
    ) -> NDArray[np.void]:
        nearest = np.argmin(np.linalg.norm(self.ego.centres - conflict.point_m, axis=1))
        return path.build_front_rows(
            stations,
            actor.number,
            self._find_size(actor)[0],
            float(self.ego.rows["z"][nearest]),
            self.spec.timing.tick_s,
        )


def _find_passing_tick(track: ActorTrack, point: tuple[float, float]) -> float:
    """The tick at which a track is nearest to a point."""
    nearest = np.argmin(np.linalg.norm(track.centres - point, axis=1))
    return float(track.rows["tick"][nearest])


def _build_speed_commands(
    actor: StagedActor, wait_s: float, until_s: float, tick_s: float
) -> NDArray[np.float64]:
    """The speeds of one who waits, then drives at its speed up to a time, then as it likes."""
    waits, drives = round(wait_s / tick_s), max(round((until_s - wait_s) / tick_s), 0)
    return np.concatenate([np.zeros(waits), np.full(drives, actor.speed_m_s), [np.nan]])
