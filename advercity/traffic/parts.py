"""The parts that staged actors play, timed by when the ego came by in a rehearsal."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import shapely
from advercity_dsl import Spec, StagedActor, StagedConflict
from numpy.typing import NDArray

from advercity.traffic.approach import braked, meeting, passed
from advercity.traffic.bends import lanes_of
from advercity.traffic.demand import Demand, Ride
from advercity.traffic.drift import BACK_BEFORE_S, excursion, nearest_tick, shifted
from advercity.traffic.encounters import Track
from advercity.traffic.lanes import LaneGraph
from advercity.traffic.paths import Path
from advercity.traffic.recording import Recording, trace_of
from advercity.traffic.trace import Trace


@dataclass(frozen=True, eq=False)
class Play:
    """What an actor is to do.

    Attributes:
        cue: Speed in every tick for SUMO, NaN leaves it to the driver; None if it is not there.
        cued_s: The time that the cue is about.
        track: `FRONT` rows in place of what SUMO records; None keeps those.
        waits: Whether it only waits, since the ego never came by.
    """

    cue: NDArray[np.float64] | None = None
    cued_s: float = 0.0
    track: NDArray[np.void] | None = None
    waits: bool = False


def played(
    spec: Spec,
    demand: Demand,
    graph: LaneGraph,
    recording: Recording,
    before: Mapping[int, Play],
) -> dict[int, Play]:
    """What every staged actor is to do, given how the last rehearsal went."""
    rehearsal = trace_of(spec, demand, recording, first=0)
    ego = Track.of(rehearsal, spec.ego.number)
    stage = _Stage(spec, demand, graph, recording, rehearsal, ego, before)
    return {
        actor.number: stage.play(conflict, actor)
        for conflict in spec.conflicts
        for actor in conflict.actors
    }


@dataclass(frozen=True)
class _Stage:
    spec: Spec
    demand: Demand
    graph: LaneGraph
    recording: Recording
    rehearsal: Trace
    ego: Track
    before: Mapping[int, Play]

    def play(self, conflict: StagedConflict, actor: StagedActor) -> Play:
        match actor.behaviour:
            case "stops_short":
                return self._stops_short(conflict, actor)
            case "drifts" | "overtakes":
                return self._drifts(conflict, actor)
            case "drives" if conflict.actors[0].behaviour == "overtakes":
                return self._is_passed(conflict, actor)
            case "steers_clear":
                return self._steers_clear(conflict, actor)
            case "stands":
                path = Path(np.array(actor.path_m))
                middle = np.full(len(self.recording), path.length_m / 2)
                return Play(track=self._track(path, middle, actor, conflict))
            case _:
                return Play(cue=np.array([np.nan]))

    def _stops_short(self, conflict: StagedConflict, actor: StagedActor) -> Play:
        tick_s, size = self.spec.timing.tick_s, self._size(actor)
        path = self._path(actor)
        met = meeting(path, size, self.ego, conflict.point_m, tick_s)
        if met is None and actor.route:
            return Play(cue=np.zeros(1), waits=True)
        if met is None:
            stays = np.zeros(len(self.recording))
            return Play(track=self._track(path, stays, actor, conflict), waits=True)
        stations, go_s = braked(
            met,
            actor,
            path.length_m,
            offset_s=conflict.parameters["arrival_offset_s"],
            encroach_s=conflict.parameters["post_encroachment_s"],
            tick_s=tick_s,
            ticks=len(self.recording),
        )
        if not actor.route:
            return Play(track=self._track(path, stations, actor, conflict))
        speeds = np.diff(stations, prepend=stations[0]) / tick_s
        speeds[round(go_s / tick_s) :] = np.nan
        return Play(cue=speeds, cued_s=met.ego_s)

    def _steers_clear(self, conflict: StagedConflict, actor: StagedActor) -> Play:
        tick_s, path = self.spec.timing.tick_s, self._path(actor)
        ego_s, distance = passed(path, self.ego, conflict.point_m, tick_s)
        start = distance - actor.speed_m_s * (ego_s + conflict.parameters["arrival_offset_s"])
        stations = start + actor.speed_m_s * tick_s * np.arange(len(self.recording))
        stations = np.clip(stations, 0.0, path.length_m).astype(np.float64)
        return Play(track=self._track(path, stations, actor, conflict))

    def _drifts(self, conflict: StagedConflict, actor: StagedActor) -> Play:
        if actor.number not in self.before:
            return Play(cue=np.array([actor.speed_m_s]))
        tick_s, given = self.spec.timing.tick_s, conflict.parameters
        other = Track.of(self.rehearsal, actor.number)
        ego_s = _passes(self.ego, conflict.point_m) * tick_s
        late_s = _passes(other, conflict.point_m) * tick_s - ego_s - given["arrival_offset_s"]
        wait_s = max(self.before[actor.number].cued_s - late_s, 0.0)
        tick, apart_m = nearest_tick(self.ego, other)
        here, there = self.ego.at(np.array([tick])), other.at(np.array([tick]))
        closing = float((here.rows["speed"] + there.rows["speed"])[0])
        track = self.recording.tracks[actor.number]
        offsets = excursion(
            track["tick"] * tick_s,
            shift_m=given["encroachment_m"] + apart_m / 2 - other.size[1] / 2,
            out_s=given["drift_time_s"],
            beside_s=self._beside_s(conflict),
            back_s=given["return_time_s"],
            ends_s=tick * tick_s - (self.ego.size[0] + other.size[0]) / 2 / closing - BACK_BEFORE_S,
        )
        return Play(
            cue=_led(actor, wait_s, tick * tick_s, tick_s),
            cued_s=wait_s,
            track=shifted(track, offsets, tick_s),
        )

    def _beside_s(self, conflict: StagedConflict) -> float:
        """How long the actor drives beside its lane: as long as it takes to pass somebody."""
        actor = conflict.actors[0]
        if actor.behaviour != "overtakes":
            return 0.0
        passed = conflict.actors[1]
        lengths = self._size(actor)[0] + self._size(passed)[0]
        gaps = 2 * conflict.parameters["passing_gap_m"]
        return (lengths + gaps) / (actor.speed_m_s - passed.speed_m_s)

    def _is_passed(self, conflict: StagedConflict, passed: StagedActor) -> Play:
        """Rides so that the actor is ahead of it by the gap as it begins to come back."""
        if passed.number not in self.before:
            return Play(cue=np.array([passed.speed_m_s]))
        actor, given, tick_s = conflict.actors[0], conflict.parameters, self.spec.timing.tick_s
        ego_s = _passes(self.ego, conflict.point_m) * tick_s
        back_s = given["return_time_s"] + BACK_BEFORE_S
        lengths = self._size(actor)[0] + self._size(passed)[0]
        before_m = actor.speed_m_s * back_s + lengths / 2 + given["passing_gap_m"]
        path = self._path(actor)
        there = path.at(np.array([path.line.project(shapely.Point(conflict.point_m)) - before_m]))
        track = Track.of(self.rehearsal, passed.number)
        late_s = _passes(track, tuple(there[0])) * tick_s - (ego_s - back_s)
        wait_s = max(self.before[passed.number].cued_s - late_s, 0.0)
        return Play(cue=_led(passed, wait_s, ego_s, tick_s), cued_s=wait_s)

    def _path(self, actor: StagedActor) -> Path:
        if not actor.route:
            return Path(np.array(actor.path_m))
        ride = self._ride(actor)
        lanes = lanes_of(ride, self.graph)
        return Path.along(lanes, (ride.front_m or 0.0) - ride.actor.size[0] / 2)

    def _ride(self, actor: StagedActor) -> Ride:
        return next(ride for ride in self.demand.staged if ride.actor.id == actor.number)

    def _size(self, actor: StagedActor) -> tuple[float, float, float]:
        return next(one.size for one in self.demand.actors if one.id == actor.number)

    def _track(
        self,
        path: Path,
        stations: NDArray[np.float64],
        actor: StagedActor,
        conflict: StagedConflict,
    ) -> NDArray[np.void]:
        nearest = np.argmin(np.linalg.norm(self.ego.middles - conflict.point_m, axis=1))
        return path.track(
            stations,
            actor.number,
            self._size(actor)[0],
            float(self.ego.rows["z"][nearest]),
            self.spec.timing.tick_s,
        )


def _passes(track: Track, point: tuple[float, float]) -> float:
    """The tick at which a track is nearest to a point."""
    nearest = np.argmin(np.linalg.norm(track.middles - point, axis=1))
    return float(track.rows["tick"][nearest])


def _led(actor: StagedActor, wait_s: float, until_s: float, tick_s: float) -> NDArray[np.float64]:
    """The speeds of one who waits, then drives at its speed up to a time, then as it likes."""
    waits, drives = round(wait_s / tick_s), max(round((until_s - wait_s) / tick_s), 0)
    return np.concatenate([np.zeros(waits), np.full(drives, actor.speed_m_s), [np.nan]])
