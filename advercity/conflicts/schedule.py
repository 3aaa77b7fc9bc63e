"""Schedule staged actors by the ego's passing times in the last dry run."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import shapely
from advercity_dsl import Spec, StagedActor, StagedConflict
from numpy.typing import NDArray

from advercity.conflicts.metrics import ActorTrack
from advercity.conflicts.reaction import EgoReaction, needs_plan
from advercity.conflicts.trajectories import (
    DRIFT_HOLD_S,
    DRIFT_RETURN_MARGIN_S,
    PathCrossing,
    build_front_rows,
    compute_lateral_offsets,
    compute_path_crossing,
    compute_stop_stations,
    find_closest_approach,
    find_evasion,
    go_straight_on,
    shift_laterally,
)
from advercity.frames import Trace
from advercity.geometry.polyline import StationedPolyline


@dataclass(frozen=True, eq=False)
class DryRun:
    """One run of the traffic, the basis of the next run's schedules.

    Attributes:
        trace: All its ticks, warm-up included.
        fronts: `FRONT_DTYPE` rows by actor, sorted by tick.
        lane_paths: Path of each staged vehicle in lanes, from its start, by actor.
    """

    trace: Trace
    fronts: Mapping[int, NDArray[np.void]]
    lane_paths: Mapping[int, StationedPolyline]


@dataclass(frozen=True, eq=False)
class ActorSchedule:
    """Commands for a staged actor.

    Attributes:
        speed_commands_m_s: Speed (ticks,) for SUMO, where NaN leaves it to SUMO's driver and the
            last value holds on; None for an actor that SUMO does not simulate.
        trigger_s: Time at which the actor sets out or meets the ego.
        go_s: Time from which SUMO drives it again.
        offsets_m: Offsets (ticks,) to the left of its lane; None without.
        track: `FRONT_DTYPE` rows that replace SUMO's; None keeps SUMO's.
        crossing: Where and when the actor meets the ego, if their paths cross.
        is_untriggered: Whether the actor only waits, because the ego did not pass.
    """

    speed_commands_m_s: NDArray[np.float64] | None = None
    trigger_s: float = 0.0
    go_s: float = 0.0
    offsets_m: NDArray[np.float64] | None = None
    track: NDArray[np.void] | None = None
    crossing: PathCrossing | None = None
    is_untriggered: bool = False


def schedule_actors(
    spec: Spec,
    dry_run: DryRun,
    previous: Mapping[int, ActorSchedule],
    reactions: Mapping[str, EgoReaction],
) -> dict[int, ActorSchedule]:
    """Schedule every staged actor for the next run.

    Args:
        spec: The scenario.
        dry_run: The last run.
        previous: Schedules of that run; empty before the first one.
        reactions: The ego's reactions in it, by conflict; actors come as if it did not react.
    """
    ego = ActorTrack.from_trace(dry_run.trace, spec.ego.number)
    scheduler = _Scheduler(spec, dry_run, ego, previous, reactions)
    return {
        actor.number: scheduler.schedule(conflict, actor)
        for conflict in spec.conflicts
        for actor in conflict.actors
    }


@dataclass(frozen=True)
class _Scheduler:
    spec: Spec
    dry_run: DryRun
    ego: ActorTrack
    previous: Mapping[int, ActorSchedule]
    reactions: Mapping[str, EgoReaction]

    @property
    def tick_s(self) -> float:
        return self.spec.timing.tick_s

    @property
    def tick_count(self) -> int:
        return len(self.dry_run.trace)

    def schedule(self, conflict: StagedConflict, actor: StagedActor) -> ActorSchedule:
        match actor.behaviour:
            case "stops_short":
                return self._schedule_stop(conflict, actor)
            case "drifts" | "overtakes":
                return self._schedule_drift(conflict, actor)
            case "drives" if conflict.actors[0].behaviour == "overtakes":
                return self._schedule_passed_cyclist(conflict, actor)
            case "steers_clear":
                return self._schedule_evasion(conflict, actor)
            case "stands":
                path = self._get_path(actor)
                stations = np.full(self.tick_count, path.length_m / 2)
                return ActorSchedule(track=self._build_track(path, stations, actor, conflict))
            case _:
                return ActorSchedule(speed_commands_m_s=np.array([np.nan]))

    def _schedule_stop(self, conflict: StagedConflict, actor: StagedActor) -> ActorSchedule:
        tick_s, path = self.tick_s, self._get_path(actor)
        size = self._get_size(actor)
        crossing = compute_path_crossing(path, size, self.ego, conflict.point_m, tick_s)
        if crossing is None and actor.route:
            return ActorSchedule(speed_commands_m_s=np.zeros(1), is_untriggered=True)
        if crossing is None:
            track = self._build_track(path, np.zeros(self.tick_count), actor, conflict)
            return ActorSchedule(track=track, is_untriggered=True)
        reaction = self.reactions.get(conflict.id)
        if reaction is not None and reaction.crossing is not None:
            # The actor comes as if the ego did not react, but leaves after its actual passing.
            crossing = replace(reaction.crossing, clear_s=crossing.clear_s)
        stations, go_s = compute_stop_stations(
            crossing,
            actor,
            path.length_m,
            offset_s=conflict.parameters["arrival_offset_s"],
            post_encroachment_s=conflict.parameters["post_encroachment_s"],
            brakes=self._gives_way(conflict),
            tick_s=tick_s,
            ticks=self.tick_count,
        )
        if not actor.route:
            track = self._build_track(path, stations, actor, conflict)
            return ActorSchedule(track=track, crossing=crossing)
        speeds = np.diff(stations, prepend=stations[0]) / tick_s
        speeds[round(go_s / tick_s) :] = np.nan
        return ActorSchedule(
            speed_commands_m_s=speeds, trigger_s=crossing.ego_s, go_s=go_s, crossing=crossing
        )

    def _gives_way(self, conflict: StagedConflict) -> bool:
        """Return whether an actor stops short of the ego; in a collision, only until its plan."""
        if needs_plan(conflict) and conflict.resolved_by == "nobody":
            return conflict.id not in self.reactions
        return conflict.resolved_by in ("actor", "both")

    def _schedule_evasion(self, conflict: StagedConflict, actor: StagedActor) -> ActorSchedule:
        tick_s, path = self.tick_s, self._get_path(actor)
        if conflict.resolved_by == "nobody":
            path = go_straight_on(path)
        ego_s, distance_m = find_evasion(path, self.ego, conflict.point_m, tick_s)
        start_m = distance_m - actor.speed_m_s * (ego_s + conflict.parameters["arrival_offset_s"])
        stations = start_m + actor.speed_m_s * tick_s * np.arange(self.tick_count)
        stations = np.clip(stations, 0.0, path.length_m).astype(np.float64)
        return ActorSchedule(track=self._build_track(path, stations, actor, conflict))

    def _schedule_drift(self, conflict: StagedConflict, actor: StagedActor) -> ActorSchedule:
        if actor.number not in self.previous:
            return ActorSchedule(speed_commands_m_s=np.array([actor.speed_m_s]))
        tick_s, parameters = self.tick_s, conflict.parameters
        track, length_m = self.dry_run.fronts[actor.number], self._get_size(actor)[0]
        before = self.previous[actor.number]
        if conflict.id in self.reactions and before.offsets_m is not None:
            shifted = shift_laterally(track, before.offsets_m[track["tick"]], length_m, tick_s)
            return replace(before, track=shifted)
        other = ActorTrack.from_trace(self.dry_run.trace, actor.number)
        ego_s = self.ego.find_passing_tick(conflict.point_m) * tick_s
        actor_s = other.find_passing_tick(conflict.point_m) * tick_s
        wait_s = self._correct_wait_s(actor, actor_s - ego_s - parameters["arrival_offset_s"])
        tick, apart_m = find_closest_approach(self.ego, other)
        at = np.array([tick])
        closing = float((self.ego.at_ticks(at).rows["speed"] + other.at_ticks(at).rows["speed"])[0])
        passing_s = (self.ego.size[0] + other.size[0]) / 2 / closing
        end_s, hold_s = (
            tick * tick_s - passing_s - DRIFT_RETURN_MARGIN_S,
            self._compute_hold_s(conflict),
        )
        if conflict.resolved_by in ("ego", "nobody"):
            # An actor blind to the ego returns as long after the passing as others do before it.
            stays_s = 2 * (passing_s + DRIFT_RETURN_MARGIN_S) + parameters["return_time_s"]
            end_s, hold_s = end_s + stays_s, hold_s + stays_s
        offsets = compute_lateral_offsets(
            tick_s * np.arange(self.spec.timing.max_ticks + 1, dtype=np.float64),
            shift_m=parameters["encroachment_m"] + apart_m / 2 - other.size[1] / 2,
            out_s=parameters["drift_time_s"],
            hold_s=hold_s,
            return_s=parameters["return_time_s"],
            end_s=end_s,
        )
        return ActorSchedule(
            speed_commands_m_s=_build_speed_commands(actor, wait_s, tick * tick_s, tick_s),
            trigger_s=wait_s,
            offsets_m=offsets,
            track=shift_laterally(track, offsets[track["tick"]], length_m, tick_s),
        )

    def _compute_hold_s(self, conflict: StagedConflict) -> float:
        """Compute how long the actor is in the other lane; passing a cyclist takes longer."""
        actor = conflict.actors[0]
        if actor.behaviour != "overtakes":
            return DRIFT_HOLD_S
        passed = conflict.actors[1]
        lengths_m = self._get_size(actor)[0] + self._get_size(passed)[0]
        gaps_m = 2 * conflict.parameters["passing_gap_m"]
        return (lengths_m + gaps_m) / (actor.speed_m_s - passed.speed_m_s)

    def _schedule_passed_cyclist(
        self, conflict: StagedConflict, passed: StagedActor
    ) -> ActorSchedule:
        """Schedule a cyclist to be behind by the gap when the actor begins to return."""
        if passed.number not in self.previous:
            return ActorSchedule(speed_commands_m_s=np.array([passed.speed_m_s]))
        actor, parameters, tick_s = conflict.actors[0], conflict.parameters, self.tick_s
        ego_s = self.ego.find_passing_tick(conflict.point_m) * tick_s
        back_s = parameters["return_time_s"] + DRIFT_RETURN_MARGIN_S
        lengths_m = self._get_size(actor)[0] + self._get_size(passed)[0]
        before_m = actor.speed_m_s * back_s + lengths_m / 2 + parameters["passing_gap_m"]
        path = self._get_path(actor)
        passing_m = path.line.project(shapely.Point(conflict.point_m)) - before_m
        track = ActorTrack.from_trace(self.dry_run.trace, passed.number)
        late_s = track.find_passing_tick(path.points_at(passing_m)) * tick_s - (ego_s - back_s)
        wait_s = self._correct_wait_s(passed, late_s)
        return ActorSchedule(
            speed_commands_m_s=_build_speed_commands(passed, wait_s, ego_s, tick_s),
            trigger_s=wait_s,
        )

    def _correct_wait_s(self, actor: StagedActor, late_s: float) -> float:
        return max(self.previous[actor.number].trigger_s - late_s, 0.0)

    def _get_path(self, actor: StagedActor) -> StationedPolyline:
        if actor.route:
            return self.dry_run.lane_paths[actor.number]
        return StationedPolyline.from_points(np.array(actor.path_m))

    def _get_size(self, actor: StagedActor) -> tuple[float, float, float]:
        blueprint = self.spec.blueprints[actor.blueprint]
        return blueprint.size

    def _build_track(
        self,
        path: StationedPolyline,
        stations: NDArray[np.float64],
        actor: StagedActor,
        conflict: StagedConflict,
    ) -> NDArray[np.void]:
        # Paths have no height; the ego's height at the conflict replaces it.
        z_m = float(self.ego.rows["z"][self.ego.find_nearest_row(conflict.point_m)])
        return build_front_rows(
            path,
            stations,
            number=actor.number,
            length_m=self._get_size(actor)[0],
            z_m=z_m,
            tick_s=self.tick_s,
        )


def _build_speed_commands(
    actor: StagedActor, wait_s: float, until_s: float, tick_s: float
) -> NDArray[np.float64]:
    """Build commands (ticks,): wait, drive at the actor's speed up to a time, then be free."""
    waits, drives = round(wait_s / tick_s), max(round((until_s - wait_s) / tick_s), 0)
    return np.concatenate([np.zeros(waits), np.full(drives, actor.speed_m_s), [np.nan]])
