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

from advercity.errors import RunError
from advercity.traffic.clearing import Block, holding_up, in_the_way
from advercity.traffic.demand import Demand, draw
from advercity.traffic.drive import drive
from advercity.traffic.lanes import LaneGraph, read_lanes
from advercity.traffic.outcomes import outcomes
from advercity.traffic.parts import Play, played
from advercity.traffic.recording import Recording, trace_of
from advercity.traffic.route_file import write_route_file
from advercity.traffic.trace import Trace

MOST_REHEARSALS = 40
MOST_TOLD = 4
"""Pairs that a message names."""
STEADY_S = 0.1
"""A cue is right if the next rehearsal would move it by no more than this."""

Told = tuple[Mapping[int, int], Mapping[int, Play]]
"""How often whom was drawn again in a rehearsal, and what actors were told after it."""


def stage(spec: Spec, network: Path) -> Trace:
    """The traffic of a spec with its conflicts.

    Raises:
        RunError: A conflict cannot be staged here.
    """
    graph = read_lanes(network)
    if not spec.conflicts:
        demand = draw(spec, graph, {})
        recording = recorded(spec, demand, graph, network, {})
        return trace_of(spec, demand, recording, first=spec.timing.warm_up_ticks + 1)
    rehearsals = _Rehearsals(spec, graph, network)
    for _ in range(MOST_REHEARSALS):
        trace = rehearsals.next()
        if trace is not None:
            return trace
    raise RunError(f"after {MOST_REHEARSALS} rehearsals {rehearsals.why}")


class _Rehearsals:
    """Traffic that is run again and again, each time with something mended.

    Attributes:
        why: What was wrong with the last one.
    """

    def __init__(self, spec: Spec, graph: LaneGraph, network: Path) -> None:
        self.why = ""
        self._spec = spec
        self._graph = graph
        self._network = network
        self._again: dict[int, int] = {}
        self._plays: Mapping[int, Play] = {}
        self._told: list[Told] = []
        self._blamed: set[int] = set()

    def next(self) -> Trace | None:
        """One more: its trace if all went as declared; else None, and the next will differ.

        Raises:
            RunError: Nothing that could be changed would help.
        """
        spec, graph, before = self._spec, self._graph, self._plays
        demand = draw(spec, graph, self._again)
        recording = recorded(spec, demand, graph, self._network, before)
        self._plays = played(spec, demand, graph, recording, before)
        if self._make_way(demand, recording) or self._tell_anew(before, demand, recording):
            return None
        return self._judge(demand, recording)

    @property
    def _waits(self) -> bool:
        return any(play.waits for play in self._plays.values())

    def _make_way(self, demand: Demand, recording: Recording) -> bool:
        """Draw again who holds up an ego that an actor waits for in vain; whether somebody does."""
        if not self._waits:
            return False
        self.why = never_met(self._spec, self._plays)
        held = _holding_up(self._spec, demand, recording) or self._blamed
        self._draw_again(held)
        return bool(held)

    def _tell_anew(self, before: Mapping[int, Play], demand: Demand, recording: Recording) -> bool:
        """See whether cues have changed; where that goes round, draw again who holds up the ego."""
        if not _differs(before, self._plays):
            return False
        self.why = "the actors' times did not settle; lower the density or take other seeds.traffic"
        goes_round = _recurs(self._plays, self._again, self._told)
        held = _holding_up(self._spec, demand, recording) if goes_round else set()
        self._told.append((dict(self._again), self._plays))
        self._draw_again(held)
        return True

    def _judge(self, demand: Demand, recording: Recording) -> Trace | None:
        """The trace with all parts played; None, others drawn again, if it is not as declared."""
        spec, plays = self._spec, self._plays
        tracks = {number: play.track for number, play in plays.items() if play.track is not None}
        first = spec.timing.warm_up_ticks + 1
        trace = trace_of(spec, demand, recording.with_tracks(tracks), first=first)
        blocks = set(in_the_way(spec, trace))
        if blocks:
            self.why = blocked(spec, blocks)
            self._blamed = {block.who for block in blocks} & _background(demand) or self._blamed
            if not self._blamed:
                raise RunError(self.why)
        else:
            if self._waits:
                raise RunError(self.why)
            self._blamed = _spoiling(spec, trace, demand)
            if not self._blamed:
                return trace
            self.why = (
                "somebody of the background spoils a staged conflict; take other seeds.traffic"
            )
        self._draw_again(self._blamed)
        return None

    def _draw_again(self, blamed: set[int]) -> None:
        for number in blamed:
            self._again[number] = self._again.get(number, 0) + 1


def never_met(spec: Spec, plays: Mapping[int, Play]) -> str:
    """Which conflicts the ego did not come by, in a sentence."""
    named = [
        f"{conflict.id} ({conflict.conflict})"
        for conflict in spec.conflicts
        if any(plays[actor.number].waits for actor in conflict.actors)
    ]
    timing = spec.timing
    end_s = timing.max_ticks * timing.tick_s
    return (
        f"the ego does not cross the way of {', '.join(named)} before it arrives or the scenario"
        f" ends, {end_s:g} s after the start (max_ticks {timing.max_ticks}); raise"
        " timing.max_ticks or lower the density"
    )


def blocked(spec: Spec, blocks: Iterable[Block]) -> str:
    """Who was in whose way, in a sentence."""
    staged = {
        actor.number: f"{actor.actor_class} {actor.number} of {conflict.id} ({conflict.conflict})"
        for conflict in spec.conflicts
        for actor in conflict.actors
    }
    agents = {agent.number: f"{agent.id} ({agent.number})" for agent in spec.agents}
    named = {**agents, **staged}
    pairs = sorted({(block.who, block.of) for block in blocks})
    told = [f"{named.get(who, who)} is in the way of {named.get(of, of)}" for who, of in pairs]
    more = f" and {len(told) - MOST_TOLD} more" if len(told) > MOST_TOLD else ""
    return (
        f"{', '.join(told[:MOST_TOLD])}{more}; lower the density, move the agents, stage fewer"
        " conflicts in one scenario, or take other seeds.traffic"
    )


def _spoiling(spec: Spec, trace: Trace, demand: Demand) -> set[int]:
    """Those of the background who hold the ego up, if a conflict did not happen as declared."""
    if all(outcome.happened for outcome in outcomes(spec, trace)):
        return set()
    return set(holding_up(spec, trace)) & _background(demand)


def _holding_up(spec: Spec, demand: Demand, recording: Recording) -> set[int]:
    """Those of the background who hold the ego up in a rehearsal."""
    rehearsal = trace_of(spec, demand, recording, first=0)
    return set(holding_up(spec, rehearsal)) & _background(demand)


def _background(demand: Demand) -> set[int]:
    return {one.actor.id for one in (*demand.vehicles, *demand.walkers)}


def _differs(before: Mapping[int, Play], after: Mapping[int, Play]) -> bool:
    """Whether a vehicle in SUMO has to be told something else than it was."""
    return any(
        play.cue is not None
        and (number not in before or abs(before[number].cued_s - play.cued_s) > STEADY_S)
        for number, play in after.items()
    )


def _recurs(plays: Mapping[int, Play], again: dict[int, int], told: Iterable[Told]) -> bool:
    """Whether the same was told to the same traffic: rehearsals go round and will not settle."""
    return any(drawn == again and not _differs(then, plays) for drawn, then in told)


def recorded(
    spec: Spec, demand: Demand, graph: LaneGraph, network: Path, plays: Mapping[int, Play]
) -> Recording:
    """One run of SUMO; staged vehicles that have no cue yet wait."""
    waits: NDArray[np.float64] = np.zeros(1)
    cues = {ride.actor.id: waits for ride in demand.staged}
    cues |= {number: play.cue for number, play in plays.items() if play.cue is not None}
    with tempfile.TemporaryDirectory() as folder:
        routes = Path(folder) / "demand.rou.xml"
        write_route_file(demand, routes, spec.caution)
        return drive(spec, demand, graph, network, routes, cues)
