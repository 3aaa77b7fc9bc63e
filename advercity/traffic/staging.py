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
    first = spec.timing.warm_up_ticks + 1
    again: dict[int, int] = {}
    plays: Mapping[int, Play] = {}
    told: list[Told] = []
    blamed: set[int] = set()
    why = ""
    for _ in range(MOST_REHEARSALS):
        demand = draw(spec, graph, again)
        recording = recorded(spec, demand, graph, network, plays)
        if not spec.conflicts:
            return trace_of(spec, demand, recording, first=first)
        before = plays
        plays = played(spec, demand, graph, recording, before)
        if any(play.waits for play in plays.values()):
            why = never_met(spec, plays)
            held = _holding_up(spec, demand, recording) or blamed
            if held:
                _draw_again(held, again)
                continue
        if _is_told_anew(before, plays):
            why = "the actors' times did not settle; lower the density or take other seeds.traffic"
            held = _holding_up(spec, demand, recording) if _recurs(plays, again, told) else set()
            told.append((dict(again), plays))
            _draw_again(held, again)
            continue
        tracks = {number: play.track for number, play in plays.items() if play.track is not None}
        trace = trace_of(spec, demand, recording.with_tracks(tracks), first=first)
        blocks = set(in_the_way(spec, trace))
        if not blocks and any(play.waits for play in plays.values()):
            raise RunError(why)
        if not blocks:
            blamed = _spoiling(spec, trace, demand)
            if not blamed:
                return trace
            why = "somebody of the background spoils a staged conflict; take other seeds.traffic"
            _draw_again(blamed, again)
            continue
        why = blocked(spec, blocks)
        blamed = {block.who for block in blocks} & _background(demand) or blamed
        if not blamed:
            raise RunError(why)
        _draw_again(blamed, again)
    raise RunError(f"after {MOST_REHEARSALS} rehearsals {why}")


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


def _draw_again(blamed: set[int], again: dict[int, int]) -> None:
    for number in blamed:
        again[number] = again.get(number, 0) + 1


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


def _is_told_anew(before: Mapping[int, Play], after: Mapping[int, Play]) -> bool:
    """Whether a vehicle in SUMO has to be told something else than it was."""
    return any(
        play.cue is not None
        and (number not in before or abs(before[number].cued_s - play.cued_s) > STEADY_S)
        for number, play in after.items()
    )


def _recurs(plays: Mapping[int, Play], again: dict[int, int], told: Iterable[Told]) -> bool:
    """Whether the same was told to the same traffic: rehearsals go round and will not settle."""
    return any(drawn == again and not _is_told_anew(then, plays) for drawn, then in told)


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
