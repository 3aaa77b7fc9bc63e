"""Repeat dry runs of the traffic until no actors overlap and all staged conflicts happen.

SUMO's traffic is deterministic, so the next run repeats the last one apart from the changes. After
each run the actors are timed by the ego's passing, and background actors that block an actor or
the ego are drawn again. A run without changes is the result.
"""

import tempfile
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
from advercity_dsl import Spec
from numpy.typing import NDArray

from advercity.conflicts.clearance import (
    Blockage,
    find_blockages,
    find_blockers,
    find_first_contact,
)
from advercity.conflicts.crossing_people import find_crossing_people, find_roadway
from advercity.conflicts.outcome import evaluate_outcomes
from advercity.conflicts.reaction import (
    EgoReaction,
    HeldUpActorError,
    needs_plan,
    plan_reaction,
)
from advercity.conflicts.schedule import ActorSchedule, DryRun, schedule_actors
from advercity.conflicts.trajectories import build_lane_path, shift_laterally
from advercity.errors import StagingError
from advercity.frames import Trace
from advercity.geometry.polyline import StationedPolyline
from advercity.roads.lane_graph import LaneGraph, read_lane_graph
from advercity.traffic.demand import (
    TrafficDemand,
    VehicleTrip,
    draw_demand,
    let_others_drive_on,
)
from advercity.traffic.pedestrians import FIRST_BACKGROUND_WALKER
from advercity.traffic.route_file import write_route_file
from advercity.traffic.speed_profile import list_route_lanes
from advercity.traffic.sumo_recording import SumoRecording, build_trace
from advercity.traffic.sumo_run import run_sumo

MAX_DRY_RUNS = 60
MAX_LISTED_PAIRS = 4
"""Maximum number of blockages in a message."""
TRIGGER_TOLERANCE_S = 0.06
"""Maximum change of the trigger in the next schedule for which a schedule is kept."""

DELAYED = {"ego_speed_km_h", "since_red_s"}
"""Parameters that leave their range if others hold the ego up."""
DISTURBED = {"ego_speed_km_h", "arrival_offset_s"}
"""Parameters that leave their range if others hold the ego or the actor up."""
MAX_CROSSING_RUNS = 4
"""Number of first dry runs after each of which people who could not cross try another street."""
MAX_DELAY_REDRAWS = 10
"""Maximum number of redraws: in dense traffic yet another actor may hold the ego up."""

PastDryRun = tuple[Mapping[int, int], Mapping[int, ActorSchedule]]
"""Redraws of background actors in a dry run, and the resulting schedules."""


def simulate_with_dry_runs(spec: Spec, network: Path) -> Trace:
    """Simulate the traffic of a spec with its conflicts.

    Raises:
        InputError: The spec needs something that the road lacks.
        StagingError: A conflict cannot be staged here, or actors overlap in every draw.
    """
    runs = _DryRuns(spec, read_lane_graph(network), network)
    for _ in range(MAX_DRY_RUNS):
        trace = runs.run_next()
        if trace is not None:
            return trace
    raise StagingError(f"after {MAX_DRY_RUNS} dry runs {runs.reason}")


class _DryRuns:
    """Successive dry runs, each changed by the results of the last one.

    Attributes:
        reason: Why the last one is not the result.
    """

    def __init__(self, spec: Spec, graph: LaneGraph, network: Path) -> None:
        self.reason = ""
        self._spec = spec
        self._graph = graph
        self._network = network
        self._redraws: dict[int, int] = {}
        self._schedules: Mapping[int, ActorSchedule] = {}
        self._history: list[PastDryRun] = []
        self._blockers: set[int] = set()
        self._reactions: dict[str, EgoReaction] = {}
        self._is_reaction_old = False
        self._delay_redraws = 0
        self._crossing_redraws = Counter[int]()
        self._crossing_runs = MAX_CROSSING_RUNS
        self._ends_with_ego = False

    def run_next(self) -> Trace | None:
        """Run once more; return the trace if all went as declared, else None for another run.

        Raises:
            StagingError: No possible change would help.
        """
        spec, previous = self._spec, self._schedules
        demand = draw_demand(spec, self._graph, self._redraws, self._crossing_redraws)
        if self._ends_with_ego:
            demand = let_others_drive_on(spec, demand, self._graph)
        recording = record_traffic(
            spec,
            demand,
            self._graph,
            self._network,
            previous,
            self._reactions.values(),
            ends_with_ego=self._ends_with_ego,
        )
        dry_run = DryRun(
            trace=build_trace(spec, demand, recording, first_tick=0),
            fronts=recording.tracks,
            lane_paths={
                trip.actor.id: _build_trip_path(trip, self._graph) for trip in demand.staged
            },
        )
        if self._redraw_crossings(demand, recording):
            return None
        self._schedules = schedule_actors(spec, dry_run, previous, self._reactions)
        trace = dry_run.trace
        if self._has_untriggered and self._wait_for_ego(recording):
            return None
        if self._redraw_ego_blockers(demand, recording, trace) or self._reschedule(
            previous, demand, trace
        ):
            return None
        return self._check_result(demand, recording)

    def _redraw_crossings(self, demand: TrafficDemand, recording: SumoRecording) -> bool:
        """Send people who could not cross a street to another; False if all did, or too late.

        Lights may stay red, and kerbs are crowded.
        """
        waiting = {trip.actor.id for trip in demand.walkers if trip.crosses}
        if self._crossing_runs == 0 or not waiting:
            return False
        self._crossing_runs -= 1
        spec = self._spec
        trace = build_trace(spec, demand, recording, first_tick=spec.timing.warm_up_ticks + 1)
        waiting -= find_crossing_people(trace, find_roadway(spec))
        self._crossing_redraws.update(waiting)
        return bool(waiting)

    @property
    def _has_untriggered(self) -> bool:
        return any(schedule.is_untriggered for schedule in self._schedules.values())

    def _wait_for_ego(self, recording: SumoRecording) -> bool:
        """Extend the next runs until the ego arrives; False if no other vehicle ended the last."""
        if self._ends_with_ego or recording.arrived <= {self._spec.ego.number}:
            return False
        self._ends_with_ego = True
        self._forget_reactions()
        self._history.clear()
        self.reason = "another connected vehicle arrives before the ego has met its actors"
        return True

    def _redraw_ego_blockers(
        self, demand: TrafficDemand, recording: SumoRecording, trace: Trace
    ) -> bool:
        """Redraw blockers of an ego that an actor waits for in vain; False without any."""
        if not self._has_untriggered:
            return False
        self.reason = format_unmet_conflicts(self._spec, self._schedules, recording)
        blockers = _find_background_blockers(self._spec, demand, trace) or self._blockers
        self._redraw(blockers)
        return bool(blockers)

    def _reschedule(
        self, previous: Mapping[int, ActorSchedule], demand: TrafficDemand, trace: Trace
    ) -> bool:
        """Return whether schedules have changed; if they alternate, redraw the ego's blockers."""
        if not _has_changed(previous, self._schedules):
            return False
        self.reason = (
            "the actors' trigger times did not converge; lower the density or take other"
            " seeds.traffic"
        )
        is_repeated = any(
            redraws == self._redraws and not _has_changed(schedules, self._schedules)
            for redraws, schedules in self._history
        )
        self._history.append((dict(self._redraws), self._schedules))
        if is_repeated:
            self._redraw(_find_background_blockers(self._spec, demand, trace))
        return True

    def _check_result(self, demand: TrafficDemand, recording: SumoRecording) -> Trace | None:
        """Return the trace with scripted tracks; None, with redraws, if it is not clear."""
        spec = self._spec
        tracks = {
            number: schedule.track
            for number, schedule in self._schedules.items()
            if schedule.track is not None
        }
        recording = self._steer_ego(recording.with_tracks(tracks))
        trace = build_trace(spec, demand, recording, first_tick=spec.timing.warm_up_ticks + 1)
        contact = find_first_contact(spec, trace)
        if contact is not None:
            trace = trace.cut(contact + 1)  # no model of bodies after a collision
        blockages = set(find_blockages(spec, trace))
        if blockages:
            self.reason = format_blockages(spec, blockages)
            blockers = demand.select_background(item.blocker_id for item in blockages)
            # A staged actor cannot be redrawn: earlier blockers may have led to this.
            self._blockers = blockers or self._blockers
            if not self._blockers:
                raise StagingError(self.reason)
        elif self._has_untriggered:
            raise StagingError(self.reason)
        elif self._redraw_delaying_actors(demand, trace) or self._plan_reaction(demand, recording):
            return None
        else:
            missed = _list_missed_actors(spec, trace)
            if missed and self._is_reaction_old:
                self._forget_reactions()
                return None
            self._blockers = _find_disturbing_actors(spec, trace, demand, missed)
            if not self._blockers:
                return trace
            self.reason = "a background actor disturbs a staged conflict; take other seeds.traffic"
        self._redraw(self._blockers)
        return None

    def _redraw_delaying_actors(self, demand: TrafficDemand, trace: Trace) -> bool:
        """Redraw actors that delay the ego before it reacts; False without any, or too often."""
        if self._reactions or self._delay_redraws == MAX_DELAY_REDRAWS:
            return False
        outcomes = evaluate_outcomes(self._spec, trace)
        if not any(DELAYED & {*item.outside} for item in outcomes):
            return False
        blockers = _find_background_blockers(self._spec, demand, trace)
        self._delay_redraws += 1
        self.reason = "background actors make the ego late; lower the density"
        self._redraw(blockers)
        return bool(blockers)

    def _plan_reaction(self, demand: TrafficDemand, recording: SumoRecording) -> bool:
        """Let the ego react to the next remaining actor, if any, in the next run."""
        waiting = (
            conflict
            for conflict in self._spec.conflicts
            if needs_plan(conflict) and conflict.id not in self._reactions
        )
        conflict = next(waiting, None)
        if conflict is None:
            return False
        actor = conflict.actors[0].number
        trace = build_trace(self._spec, demand, recording, first_tick=0)
        self._history.clear()
        try:
            reaction = plan_reaction(self._spec, conflict, trace, self._schedules[actor].crossing)
        except HeldUpActorError as error:
            blockers = demand.select_background(find_blockers(self._spec, trace, actor))
            if self._wait_for_ego(recording):
                return True
            if not blockers:
                raise
            self.reason = str(error)
            self._redraw(blockers)
            return True
        hiding = demand.select_background(reaction.hidden_by)
        if hiding:
            self.reason = (
                "a background actor hides a staged one from the ego; take other seeds.traffic"
            )
            self._redraw(hiding)
        else:
            self._reactions[conflict.id] = reaction
        return True

    def _steer_ego(self, recording: SumoRecording) -> SumoRecording:
        """Move the ego aside by the offsets of its reactions."""
        ego, tick_s = self._spec.ego, self._spec.timing.tick_s
        for reaction in self._reactions.values():
            if len(reaction.offsets_m) > 0:
                track = recording.tracks[ego.number]
                offsets = reaction.offsets_m[track["tick"]]
                length_m = self._spec.blueprints[ego.blueprint or ""].length_m
                steered = shift_laterally(track, offsets, length_m, tick_s)
                recording = recording.with_tracks({ego.number: steered})
        return recording

    def _forget_reactions(self) -> None:
        self._reactions.clear()
        self._is_reaction_old = False

    def _redraw(self, numbers: set[int]) -> None:
        # After vehicles have changed, actors of reactions may come at another time.
        if all(number >= FIRST_BACKGROUND_WALKER for number in numbers):
            self._is_reaction_old = True
        else:
            self._forget_reactions()
        for number in numbers:
            self._redraws[number] = self._redraws.get(number, 0) + 1


def format_unmet_conflicts(
    spec: Spec, schedules: Mapping[int, ActorSchedule], recording: SumoRecording
) -> str:
    """Format the conflicts that the ego did not pass, and the end of the run, as a sentence."""
    names = [
        f"{conflict.id} ({conflict.conflict})"
        for conflict in spec.conflicts
        if any(schedules[actor.number].is_untriggered for actor in conflict.actors)
    ]
    timing, missed = spec.timing, f"the ego does not cross the path of {', '.join(names)} before"
    for agent in spec.agents:
        if agent.number in recording.arrived and not agent.is_ego:
            left_s = len(recording) * timing.tick_s
            return (
                f"{missed} {agent.id} leaves the site {left_s:g} s after the start, which ends the"
                f" scenario; let {agent.id} wait (waits_s) or drive farther, or lower the density"
            )
    end_s = timing.max_ticks * timing.tick_s
    return (
        f"{missed} it arrives or the scenario"
        f" ends, {end_s:g} s after the start (max_ticks {timing.max_ticks}); raise"
        " timing.max_ticks or lower the density"
    )


def format_blockages(spec: Spec, blockages: Iterable[Blockage]) -> str:
    """Format blocking and blocked actors, as a sentence."""
    names = {agent.number: f"{agent.id} ({agent.number})" for agent in spec.agents} | {
        actor.number: f"{actor.actor_class} {actor.number} of {conflict.id} ({conflict.conflict})"
        for conflict in spec.conflicts
        for actor in conflict.actors
    }
    pairs = sorted({(item.blocker_id, item.blocked_id) for item in blockages})
    texts = [
        f"{names.get(blocker, blocker)} blocks {names.get(blocked, blocked)}"
        for blocker, blocked in pairs
    ]
    more = f" and {len(texts) - MAX_LISTED_PAIRS} more" if len(texts) > MAX_LISTED_PAIRS else ""
    return (
        f"{', '.join(texts[:MAX_LISTED_PAIRS])}{more}; lower the density, move the agents, stage"
        " fewer conflicts in one scenario, or take other seeds.traffic"
    )


def _list_missed_actors(spec: Spec, trace: Trace) -> list[int]:
    """List the actors of conflicts that did not happen as declared."""
    return [
        item.actor
        for item in evaluate_outcomes(spec, trace)
        if not item.happened or DISTURBED & {*item.outside}
    ]


def _find_disturbing_actors(
    spec: Spec, trace: Trace, demand: TrafficDemand, missed: Sequence[int]
) -> set[int]:
    """Find background actors that hold up an ego that missed conflicts with actors.

    If none does, find background actors that hold up the conflicts' actors.
    """
    if not missed:
        return set()
    blockers = {number for actor in missed for number in find_blockers(spec, trace, actor)}
    return _find_background_blockers(spec, demand, trace) or demand.select_background(blockers)


def _find_background_blockers(spec: Spec, demand: TrafficDemand, trace: Trace) -> set[int]:
    return demand.select_background(find_blockers(spec, trace, spec.ego.number))


def _build_trip_path(trip: VehicleTrip, graph: LaneGraph) -> StationedPolyline:
    start_m = (trip.front_position_m or 0.0) - trip.actor.size[0] / 2
    return build_lane_path(list_route_lanes(trip, graph), start_m)


def _has_changed(before: Mapping[int, ActorSchedule], after: Mapping[int, ActorSchedule]) -> bool:
    """Return whether a vehicle in SUMO needs different commands."""
    return any(
        schedule.speed_commands_m_s is not None
        and (
            number not in before
            or abs(before[number].trigger_s - schedule.trigger_s) > TRIGGER_TOLERANCE_S
            or abs(before[number].go_s - schedule.go_s) > TRIGGER_TOLERANCE_S
        )
        for number, schedule in after.items()
    )


def record_traffic(
    spec: Spec,
    demand: TrafficDemand,
    graph: LaneGraph,
    network: Path,
    schedules: Mapping[int, ActorSchedule],
    reactions: Iterable[EgoReaction] = (),
    *,
    ends_with_ego: bool = False,
) -> SumoRecording:
    """Run SUMO once; staged vehicles without a schedule wait, and the ego reacts as planned."""
    waits: NDArray[np.float64] = np.zeros(1)
    speed_commands = {trip.actor.id: waits for trip in demand.staged} | {
        number: schedule.speed_commands_m_s
        for number, schedule in schedules.items()
        if schedule.speed_commands_m_s is not None
    }
    commands = (reaction.speed_commands_m_s for reaction in reactions)
    braking = [speeds for speeds in commands if len(speeds) > 0]
    if braking:
        speed_commands[spec.ego.number] = _join_commands(braking)
    with tempfile.TemporaryDirectory() as folder:
        routes = Path(folder) / "demand.rou.xml"
        write_route_file(demand, routes, spec.caution)
        return run_sumo(
            spec, demand, graph, network, routes, speed_commands, ends_with_ego=ends_with_ego
        )


def _join_commands(parts: Iterable[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Join speed commands (ticks,) for different times; NaN at all other times."""
    parts = list(parts)
    joined = np.full(max(map(len, parts)), np.nan)
    for part in parts:
        given = np.flatnonzero(~np.isnan(part))
        joined[given] = part[given]
    return joined
