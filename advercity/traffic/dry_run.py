"""Stage a spec's conflicts: rehearse the traffic, time the actors, clear their ways.

Traffic without chance can be rehearsed. Each run of SUMO tells when the ego comes by; actors are
timed by that, and whoever of the background would be in their way starts somewhere else. What
SUMO then does again is what was planned for.
"""

import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
from advercity_dsl import Spec
from numpy.typing import NDArray

from advercity.conflicts.clearance import Blockage, find_blockages, find_ego_blockers
from advercity.conflicts.report import evaluate_outcomes
from advercity.conflicts.schedule import ActorSchedule, DryRun, schedule_actors
from advercity.conflicts.trajectories import build_lane_path
from advercity.errors import RunError
from advercity.frames import Trace
from advercity.geometry.polyline import StationedPolyline
from advercity.roads.lane_graph import LaneGraph, read_lane_graph
from advercity.traffic.demand import TrafficDemand, VehicleTrip, draw_demand
from advercity.traffic.kinematics import SumoRecording, build_trace
from advercity.traffic.route_file import write_route_file
from advercity.traffic.speed_profile import list_route_lanes
from advercity.traffic.sumo_run import run_sumo

MAX_DRY_RUNS = 40
MAX_LISTED_PAIRS = 4
"""Pairs that a message names."""
TRIGGER_TOLERANCE_S = 0.1
"""A cue is right if the next rehearsal would move it by no more than this."""

PastDryRun = tuple[Mapping[int, int], Mapping[int, ActorSchedule]]
"""How often whom was drawn again in a rehearsal, and what actors were told after it."""


def simulate_with_dry_runs(spec: Spec, network: Path) -> Trace:
    """The traffic of a spec with its conflicts.

    Raises:
        RunError: A conflict cannot be staged here.
    """
    graph = read_lane_graph(network)
    if not spec.conflicts:
        demand = draw_demand(spec, graph, {})
        recording = record_traffic(spec, demand, graph, network, {})
        return build_trace(spec, demand, recording, first_tick=spec.timing.warm_up_ticks + 1)
    rehearsals = _DryRuns(spec, graph, network)
    for _ in range(MAX_DRY_RUNS):
        trace = rehearsals.run_next()
        if trace is not None:
            return trace
    raise RunError(f"after {MAX_DRY_RUNS} rehearsals {rehearsals.reason}")


class _DryRuns:
    """Traffic that is run again and again, each time with something mended.

    Attributes:
        reason: What was wrong with the last one.
    """

    def __init__(self, spec: Spec, graph: LaneGraph, network: Path) -> None:
        self.reason = ""
        self._spec = spec
        self._graph = graph
        self._network = network
        self._again: dict[int, int] = {}
        self._plays: Mapping[int, ActorSchedule] = {}
        self._told: list[PastDryRun] = []
        self._blamed: set[int] = set()

    def run_next(self) -> Trace | None:
        """One more: its trace if all went as declared; else None, and the next will differ.

        Raises:
            RunError: Nothing that could be changed would help.
        """
        spec, graph, before = self._spec, self._graph, self._plays
        demand = draw_demand(spec, graph, self._again)
        recording = record_traffic(spec, demand, graph, self._network, before)
        dry_run = DryRun(
            trace=build_trace(spec, demand, recording, first_tick=0),
            fronts=recording.tracks,
            lane_paths={trip.actor.id: _build_trip_path(trip, graph) for trip in demand.staged},
        )
        self._plays = schedule_actors(spec, dry_run, before)
        if self._redraw_ego_blockers(demand, dry_run.trace) or self._update_schedules(
            before, demand, dry_run.trace
        ):
            return None
        return self._check_result(demand, recording)

    @property
    def _has_untriggered(self) -> bool:
        return any(play.is_untriggered for play in self._plays.values())

    def _redraw_ego_blockers(self, demand: TrafficDemand, trace: Trace) -> bool:
        """Draw again who holds up an ego that an actor waits for in vain; whether somebody does."""
        if not self._has_untriggered:
            return False
        self.reason = format_unmet_conflicts(self._spec, self._plays)
        held = _find_background_blockers(self._spec, demand, trace) or self._blamed
        self._redraw(held)
        return bool(held)

    def _update_schedules(
        self, before: Mapping[int, ActorSchedule], demand: TrafficDemand, trace: Trace
    ) -> bool:
        """See whether cues have changed; where that goes round, draw again who holds up the ego."""
        if not _has_changed(before, self._plays):
            return False
        self.reason = (
            "the actors' times did not settle; lower the density or take other seeds.traffic"
        )
        goes_round = _is_repeated(self._plays, self._again, self._told)
        held = _find_background_blockers(self._spec, demand, trace) if goes_round else set()
        self._told.append((dict(self._again), self._plays))
        self._redraw(held)
        return True

    def _check_result(self, demand: TrafficDemand, recording: SumoRecording) -> Trace | None:
        """The trace with all parts played; None, others drawn again, if it is not as declared."""
        spec, plays = self._spec, self._plays
        tracks = {number: play.track for number, play in plays.items() if play.track is not None}
        first = spec.timing.warm_up_ticks + 1
        trace = build_trace(spec, demand, recording.with_tracks(tracks), first_tick=first)
        blocks = set(find_blockages(spec, trace))
        if blocks:
            self.reason = format_blockages(spec, blocks)
            self._blamed = {block.blocker_id for block in blocks} & _background_ids(
                demand
            ) or self._blamed
            if not self._blamed:
                raise RunError(self.reason)
        else:
            if self._has_untriggered:
                raise RunError(self.reason)
            self._blamed = _find_spoilers(spec, trace, demand)
            if not self._blamed:
                return trace
            self.reason = (
                "somebody of the background spoils a staged conflict; take other seeds.traffic"
            )
        self._redraw(self._blamed)
        return None

    def _redraw(self, blamed: set[int]) -> None:
        for number in blamed:
            self._again[number] = self._again.get(number, 0) + 1


def format_unmet_conflicts(spec: Spec, schedules: Mapping[int, ActorSchedule]) -> str:
    """Which conflicts the ego did not come by, in a sentence."""
    named = [
        f"{conflict.id} ({conflict.conflict})"
        for conflict in spec.conflicts
        if any(schedules[actor.number].is_untriggered for actor in conflict.actors)
    ]
    timing = spec.timing
    end_s = timing.max_ticks * timing.tick_s
    return (
        f"the ego does not cross the way of {', '.join(named)} before it arrives or the scenario"
        f" ends, {end_s:g} s after the start (max_ticks {timing.max_ticks}); raise"
        " timing.max_ticks or lower the density"
    )


def format_blockages(spec: Spec, blockages: Iterable[Blockage]) -> str:
    """Who was in whose way, in a sentence."""
    staged = {
        actor.number: f"{actor.actor_class} {actor.number} of {conflict.id} ({conflict.conflict})"
        for conflict in spec.conflicts
        for actor in conflict.actors
    }
    agents = {agent.number: f"{agent.id} ({agent.number})" for agent in spec.agents}
    named = {**agents, **staged}
    pairs = sorted({(block.blocker_id, block.blocked_id) for block in blockages})
    told = [f"{named.get(who, who)} is in the way of {named.get(of, of)}" for who, of in pairs]
    more = f" and {len(told) - MAX_LISTED_PAIRS} more" if len(told) > MAX_LISTED_PAIRS else ""
    return (
        f"{', '.join(told[:MAX_LISTED_PAIRS])}{more}; lower the density, move the agents, stage"
        " fewer conflicts in one scenario, or take other seeds.traffic"
    )


def _find_spoilers(spec: Spec, trace: Trace, demand: TrafficDemand) -> set[int]:
    """Those of the background who hold the ego up, if a conflict did not happen as declared."""
    if all(outcome.happened for outcome in evaluate_outcomes(spec, trace)):
        return set()
    return set(find_ego_blockers(spec, trace)) & _background_ids(demand)


def _find_background_blockers(spec: Spec, demand: TrafficDemand, trace: Trace) -> set[int]:
    """Find the background actors that hold the ego up in a dry run."""
    return set(find_ego_blockers(spec, trace)) & _background_ids(demand)


def _build_trip_path(trip: VehicleTrip, graph: LaneGraph) -> StationedPolyline:
    start_m = (trip.front_position_m or 0.0) - trip.actor.size[0] / 2
    return build_lane_path(list_route_lanes(trip, graph), start_m)


def _background_ids(demand: TrafficDemand) -> set[int]:
    return {one.actor.id for one in (*demand.vehicles, *demand.walkers)}


def _has_changed(before: Mapping[int, ActorSchedule], after: Mapping[int, ActorSchedule]) -> bool:
    """Whether a vehicle in SUMO has to be told something else than it was."""
    return any(
        play.speed_commands_m_s is not None
        and (
            number not in before
            or abs(before[number].trigger_s - play.trigger_s) > TRIGGER_TOLERANCE_S
        )
        for number, play in after.items()
    )


def _is_repeated(
    plays: Mapping[int, ActorSchedule], again: dict[int, int], told: Iterable[PastDryRun]
) -> bool:
    """Whether the same was told to the same traffic: rehearsals go round and will not settle."""
    return any(drawn == again and not _has_changed(then, plays) for drawn, then in told)


def record_traffic(
    spec: Spec,
    demand: TrafficDemand,
    graph: LaneGraph,
    network: Path,
    schedules: Mapping[int, ActorSchedule],
) -> SumoRecording:
    """One run of SUMO; staged vehicles that have no cue yet wait."""
    waits: NDArray[np.float64] = np.zeros(1)
    cues = {ride.actor.id: waits for ride in demand.staged}
    cues |= {
        number: play.speed_commands_m_s
        for number, play in schedules.items()
        if play.speed_commands_m_s is not None
    }
    with tempfile.TemporaryDirectory() as folder:
        routes = Path(folder) / "demand.rou.xml"
        write_route_file(demand, routes, spec.caution)
        return run_sumo(spec, demand, graph, network, routes, cues)
