"""Whether a staged conflict happened, told from the trace alone."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import shapely
from advercity_dsl import Spec
from advercity_dsl.conflict import Outcome, StagedConflict
from numpy.typing import NDArray

from advercity.errors import RunError
from advercity.traffic.approach import crossing
from advercity.traffic.encounters import Encounter, Moment, Track, encounter
from advercity.traffic.trace import Trace

APPROACH_S = 8.0
"""Before the ego's arrival; an actor's approach is over by then."""
BESIDE_M = 6.0
"""Whoever passes a point nearer than this passes it in a lane beside."""
STEADY = 0.95
"""Of the approach's speed; slower than this somebody has begun to brake."""


@dataclass(frozen=True)
class StagedOutcome:
    """What came of a staged conflict.

    Attributes:
        id: Of the staged conflict.
        conflict: Id of its declaration.
        actor: Id of whom the ego met.
        ego_at_s: When the ego's middle was nearest to where the ways met, from the first kept tick.
        actor_lag_s: How much later the actor would have been there at the speed of its approach.
        met: How near they came to each other.
        missed: What did not happen as declared; empty if the conflict happened.
    """

    id: str
    conflict: str
    actor: int
    ego_at_s: float
    actor_lag_s: float
    met: Encounter
    missed: tuple[str, ...]

    @property
    def happened(self) -> bool:
        """Whether everything was as declared."""
        return not self.missed

    @property
    def time_to_collision_s(self) -> float | None:
        """The least by either measure."""
        found = (self.met.time_to_collision_s, self.met.time_to_collision_on_way_s)
        return min((moment.value for moment in found if moment), default=None)


def outcomes(spec: Spec, trace: Trace) -> Iterator[StagedOutcome]:
    """What came of every staged conflict of a spec.

    Raises:
        RunError: Somebody who takes part is not in the trace.
    """
    ego = spec.ego.number
    for conflict in spec.conflicts:
        actor = conflict.actors[0].number
        try:
            met = encounter(trace, ego, actor)
            tracks = Track.of(trace, ego), Track.of(trace, actor)
        except KeyError:
            met, tracks = None, None
        if met is None or tracks is None:
            raise RunError(f"{spec.id}: {conflict.id} lacks its actor {actor}, or the ego")
        yield _outcome(conflict, met, *tracks, trace.tick_s)


def _outcome(
    conflict: StagedConflict, met: Encounter, ego: Track, actor: Track, tick_s: float
) -> StagedOutcome:
    wanted = conflict.outcome
    point = _meeting_point(conflict, ego, actor)
    ego_at_s = float(ego.rows["tick"][_nearest(ego, point)]) * tick_s
    beside = wanted.keeping == "velocity"
    there = _abreast(actor, ego, point) if beside else _nearest(actor, point)
    lag = _unbraked_arrival_s(actor, there, point, ego_at_s, tick_s) - ego_at_s
    meant = conflict.parameters["arrival_offset_s"]
    missed: list[str] = []
    if met.distance_m.value <= 0:
        missed.append("they touch")
    if abs(lag - meant) > wanted.arrival_tolerance_s:
        missed.append(f"the actor comes {lag:.2f} s after the ego instead of {meant:.2f} s")
    missed.extend(_misses(wanted, met))
    return StagedOutcome(
        conflict.id, conflict.conflict, actor.actor, ego_at_s, lag, met, tuple(missed)
    )


def _misses(wanted: Outcome, met: Encounter) -> Iterator[str]:
    nearest = {
        "way": met.time_to_collision_on_way_s,
        "velocity": met.time_to_collision_s,
    }[wanted.keeping]
    if nearest is None or nearest.value >= wanted.time_to_collision_below_s:
        yield (
            f"time to collision {_told(nearest)} is not below"
            f" {wanted.time_to_collision_below_s:g} s"
        )
    if wanted.post_encroachment_s is not None:
        low, high = wanted.post_encroachment_s
        gap = met.post_encroachment_s
        if gap is None or not low <= gap.value <= high:
            yield f"post-encroachment time {_told(gap)} is not within {low:g} to {high:g} s"


def _told(moment: Moment | None) -> str:
    return "(none)" if moment is None else f"{moment.value:.2f} s"


def _meeting_point(conflict: StagedConflict, ego: Track, actor: Track) -> NDArray[np.float64]:
    """Where (2,) both ways really met; as declared if they do not meet."""
    met = None
    if conflict.outcome.keeping == "way" and len(actor.rows) > 1:
        met = crossing(shapely.LineString(actor.middles), ego, conflict.point_m)
    return np.array(conflict.point_m) if met is None else met


def _nearest(track: Track, point_m: NDArray[np.float64]) -> int:
    """The row in which a track is nearest to a point."""
    return int(np.argmin(np.linalg.norm(track.middles - point_m, axis=1)))


def _abreast(actor: Track, ego: Track, point_m: NDArray[np.float64]) -> int:
    """The row in which an actor is beside a point on the ego's way, or else nearest to it."""
    yaw = ego.rows["yaw"][_nearest(ego, point_m)]
    gaps = actor.middles - point_m
    ahead = np.abs(gaps @ np.array([np.cos(yaw), np.sin(yaw)]))
    near = np.linalg.norm(gaps, axis=1) < BESIDE_M
    return int(np.argmin(np.where(near, ahead, np.inf))) if near.any() else _nearest(actor, point_m)


def _unbraked_arrival_s(
    actor: Track, there: int, point_m: NDArray[np.float64], ego_at_s: float, tick_s: float
) -> float:
    """When an actor would be at a point, in its row `there`, had it kept its approach's speed."""
    rows = actor.rows
    times_s = rows["tick"] * tick_s
    approaches = np.flatnonzero((times_s >= ego_at_s - APPROACH_S) & (times_s <= ego_at_s))
    if len(approaches) == 0:
        return float("inf")
    speeds = rows["speed"][approaches]
    last = approaches[np.flatnonzero(speeds >= STEADY * speeds.max())[-1]]
    left_m = rows["travelled"][there] - rows["travelled"][last]
    left_m += np.linalg.norm(actor.middles[there] - point_m) * (there == len(rows) - 1)
    return float(times_s[last] + left_m / max(rows["speed"][last], 0.1))
