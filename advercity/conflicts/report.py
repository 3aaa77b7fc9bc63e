"""Whether a staged conflict happened, told from the trace alone.

What a scenario's traffic amounts to: who takes part, how near they come, what was staged.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass

import numpy as np
import shapely
from advercity_dsl import Spec
from advercity_dsl.conflict import OutcomeCriteria, StagedConflict
from numpy.typing import NDArray

from advercity.conflicts.metrics import (
    ActorTrack,
    BoxOverlap,
    Encounter,
    MetricAtTick,
    find_overlaps,
    measure_encounter,
)
from advercity.conflicts.trajectories import find_crossing
from advercity.errors import RunError
from advercity.frames import Trace

APPROACH_WINDOW_S = 8.0
"""Before the ego's arrival; an actor's approach is over by then."""
ADJACENT_LANE_GAP_M = 6.0
"""Whoever passes a point nearer than this passes it in a lane beside."""
STEADY_SPEED_RATIO = 0.95
"""Of the approach's speed; slower than this somebody has begun to brake."""


@dataclass(frozen=True)
class ConflictOutcome:
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


def evaluate_outcomes(spec: Spec, trace: Trace) -> Iterator[ConflictOutcome]:
    """What came of every staged conflict of a spec.

    Raises:
        RunError: Somebody who takes part is not in the trace.
    """
    ego = spec.ego.number
    for conflict in spec.conflicts:
        actor = conflict.actors[0].number
        try:
            met = measure_encounter(trace, ego, actor)
            tracks = ActorTrack.from_trace(trace, ego), ActorTrack.from_trace(trace, actor)
        except KeyError:
            met, tracks = None, None
        if met is None or tracks is None:
            raise RunError(f"{spec.id}: {conflict.id} lacks its actor {actor}, or the ego")
        yield _evaluate_outcome(conflict, met, *tracks, trace.tick_s)


def _evaluate_outcome(
    conflict: StagedConflict, met: Encounter, ego: ActorTrack, actor: ActorTrack, tick_s: float
) -> ConflictOutcome:
    wanted = conflict.outcome
    point = _find_meeting_point(conflict, ego, actor)
    ego_at_s = float(ego.rows["tick"][_find_nearest_row(ego, point)]) * tick_s
    beside = wanted.keeping == "velocity"
    there = _find_adjacent_row(actor, ego, point) if beside else _find_nearest_row(actor, point)
    lag = _extrapolate_arrival_s(actor, there, point, ego_at_s, tick_s) - ego_at_s
    meant = conflict.parameters["arrival_offset_s"]
    missed: list[str] = []
    if met.distance_m.value <= 0:
        missed.append("they touch")
    if abs(lag - meant) > wanted.arrival_tolerance_s:
        missed.append(f"the actor comes {lag:.2f} s after the ego instead of {meant:.2f} s")
    missed.extend(_find_deviations(wanted, met))
    return ConflictOutcome(
        conflict.id, conflict.conflict, actor.actor, ego_at_s, lag, met, tuple(missed)
    )


def _find_deviations(wanted: OutcomeCriteria, met: Encounter) -> Iterator[str]:
    nearest = {
        "way": met.time_to_collision_on_way_s,
        "velocity": met.time_to_collision_s,
    }[wanted.keeping]
    if nearest is None or nearest.value >= wanted.time_to_collision_below_s:
        yield (
            f"time to collision {_format_metric(nearest)} is not below"
            f" {wanted.time_to_collision_below_s:g} s"
        )
    if wanted.post_encroachment_s is not None:
        low, high = wanted.post_encroachment_s
        gap = met.post_encroachment_s
        if gap is None or not low <= gap.value <= high:
            found = _format_metric(gap)
            yield f"post-encroachment time {found} is not within {low:g} to {high:g} s"


def _format_metric(moment: MetricAtTick | None) -> str:
    return "(none)" if moment is None else f"{moment.value:.2f} s"


def _find_meeting_point(
    conflict: StagedConflict, ego: ActorTrack, actor: ActorTrack
) -> NDArray[np.float64]:
    """Where (2,) both ways really met; as declared if they do not meet."""
    met = None
    if conflict.outcome.keeping == "way" and len(actor.rows) > 1:
        met = find_crossing(shapely.LineString(actor.centres), ego, conflict.point_m)
    return np.array(conflict.point_m) if met is None else met


def _find_nearest_row(track: ActorTrack, point_m: NDArray[np.float64]) -> int:
    """The row in which a track is nearest to a point."""
    return int(np.argmin(np.linalg.norm(track.centres - point_m, axis=1)))


def _find_adjacent_row(actor: ActorTrack, ego: ActorTrack, point_m: NDArray[np.float64]) -> int:
    """The row in which an actor is beside a point on the ego's way, or else nearest to it."""
    yaw = ego.rows["yaw"][_find_nearest_row(ego, point_m)]
    gaps = actor.centres - point_m
    ahead = np.abs(gaps @ np.array([np.cos(yaw), np.sin(yaw)]))
    near = np.linalg.norm(gaps, axis=1) < ADJACENT_LANE_GAP_M
    return (
        int(np.argmin(np.where(near, ahead, np.inf)))
        if near.any()
        else _find_nearest_row(actor, point_m)
    )


def _extrapolate_arrival_s(
    actor: ActorTrack, row: int, point_m: NDArray[np.float64], ego_at_s: float, tick_s: float
) -> float:
    """When an actor would be at a point, in its row `there`, had it kept its approach's speed."""
    rows = actor.rows
    times_s = rows["tick"] * tick_s
    approaches = np.flatnonzero((times_s >= ego_at_s - APPROACH_WINDOW_S) & (times_s <= ego_at_s))
    if len(approaches) == 0:
        return float("inf")
    speeds = rows["speed"][approaches]
    last = approaches[np.flatnonzero(speeds >= STEADY_SPEED_RATIO * speeds.max())[-1]]
    left_m = rows["travelled"][row] - rows["travelled"][last]
    left_m += np.linalg.norm(actor.centres[row] - point_m) * (row == len(rows) - 1)
    return float(times_s[last] + left_m / max(rows["speed"][last], 0.1))


ENCOUNTER_RANGE_M = 30.0
"""Whoever comes this near to the ego is met by it."""


@dataclass(frozen=True)
class DrivingExtremes:
    """Extremes over all vehicles."""

    top_speed_m_s: float
    acceleration_m_s2: float
    braking_m_s2: float


@dataclass(frozen=True)
class TrafficReport:
    """What a scenario's traffic amounts to.

    Attributes:
        spec: Id of the spec.
        trace_sha256: Of all that the trace holds.
        frames: Kept ticks.
        duration_s: Of them.
        actors: How many of each class appear.
        driving: Extremes of the vehicles' driving.
        staged: What came of the staged conflicts, in their order.
        met: The ego's encounters with everybody who comes near it, the nearest first.
        overlaps: Actors in one place, tick by tick; there should be none.
    """

    spec: str
    trace_sha256: str
    frames: int
    duration_s: float
    actors: dict[str, int]
    driving: DrivingExtremes
    staged: tuple[ConflictOutcome, ...]
    met: tuple[Encounter, ...]
    overlaps: tuple[BoxOverlap, ...]

    @property
    def vehicles(self) -> int:
        """How many vehicles appear, connected ones included."""
        return sum(self.actors.values()) - self.pedestrians

    @property
    def pedestrians(self) -> int:
        """How many people on foot appear."""
        return self.actors.get("pedestrian", 0)

    @property
    def problems(self) -> tuple[str, ...]:
        """What should not be: conflicts that did not happen, actors in one place."""
        missed = (
            f"{one.id} ({one.conflict}): {reason}" for one in self.staged for reason in one.missed
        )
        pairs = dict.fromkeys((one.first, one.second) for one in self.overlaps)
        return (*missed, *(f"{first} and {second} overlap" for first, second in pairs))

    def to_document(self) -> dict[str, object]:
        """The report as plain data for JSON."""
        return {
            **asdict(self),
            "staged": [{**asdict(one), "happened": one.happened} for one in self.staged],
        }


def build_traffic_report(spec: Spec, trace: Trace, trace_sha256: str) -> TrafficReport:
    """The report on a spec's traffic.

    Raises:
        RunError: Somebody who takes part in a staged conflict is not in the trace.
    """
    nearest = sorted(_measure_ego_encounters(spec, trace), key=lambda one: one.distance_m.value)
    return TrafficReport(
        spec=spec.id,
        trace_sha256=trace_sha256,
        frames=len(trace),
        duration_s=round(len(trace) * trace.tick_s, 6),
        actors=dict(sorted(Counter(actor.actor_class for actor in trace.actors).items())),
        driving=_compute_driving_extremes(trace),
        staged=tuple(evaluate_outcomes(spec, trace)),
        met=tuple(nearest),
        overlaps=tuple(find_overlaps(trace)),
    )


def _measure_ego_encounters(spec: Spec, trace: Trace) -> Iterator[Encounter]:
    ego = spec.ego.number
    for actor in trace.actors:
        found = (
            measure_encounter(trace, ego, actor.id, within_m=ENCOUNTER_RANGE_M)
            if actor.id != ego
            else None
        )
        if found is not None:
            yield found


def _compute_driving_extremes(trace: Trace) -> DrivingExtremes:
    on_foot = np.array([actor.actor_class == "pedestrian" for actor in trace.actors])
    rows = trace.states[~on_foot[trace.states["actor"]]]
    return DrivingExtremes(
        top_speed_m_s=float(rows["speed"].max()),
        acceleration_m_s2=float(rows["acceleration"].max()),
        braking_m_s2=float(-rows["acceleration"].min()),
    )


def build_table_rows(reports: Iterable[TrafficReport]) -> list[dict[str, object]]:
    """A row per staged conflict, or one for a scenario that stages none; for tables."""
    return [
        {
            "scenario": one.spec,
            "frames": one.frames,
            "vehicles": one.vehicles,
            "people": one.pedestrians,
            **_build_conflict_cells(staged),
        }
        for one in reports
        for staged in one.staged or (None,)
    ]


def format_markdown_table(reports: Sequence[TrafficReport]) -> str:
    """The rows as a table in Markdown, the means over all scenarios below it."""
    table = build_table_rows(reports)
    means = {
        name: f"{np.mean([getattr(one, attribute) for one in reports]):.1f}"
        for name, attribute in (
            ("frames", "frames"),
            ("vehicles", "vehicles"),
            ("people", "pedestrians"),
        )
    }
    heads = list(table[0])
    table.append({"scenario": "mean", **means})
    lines = [heads, ["---"] * len(heads), *([row.get(head, "") for head in heads] for row in table)]
    return "".join("| " + " | ".join(map(str, line)) + " |\n" for line in lines)


def _build_conflict_cells(staged: ConflictOutcome | None) -> dict[str, object]:
    if staged is None:
        return {"conflict": "", "distance m": "", "collision s": "", "gap s": "", "happened": ""}
    gap = staged.met.post_encroachment_s
    time = staged.time_to_collision_s
    return {
        "conflict": staged.conflict,
        "distance m": f"{staged.met.distance_m.value:.2f}",
        "collision s": "" if time is None else f"{time:.1f}",
        "gap s": "" if gap is None else f"{gap.value:.1f}",
        "happened": "yes" if staged.happened else "no",
    }
