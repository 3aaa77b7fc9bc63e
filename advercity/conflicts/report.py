"""Report a scenario's traffic, and tabulate many scenarios."""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass

import numpy as np
from advercity_dsl import Spec

from advercity.conflicts.case import CALM_S
from advercity.conflicts.crossing_people import find_roadway, measure_crossing_share
from advercity.conflicts.metrics import BoxOverlap, Encounter, find_overlaps, measure_encounter
from advercity.conflicts.outcome import ConflictOutcome, evaluate_outcomes
from advercity.conflicts.resolution import EVASIVE_SHIFT_M, Resolution
from advercity.frames import Trace
from advercity.roads.mirrored_traffic import mirror_trace
from advercity.roads.plan_frame import to_plan_spec

ENCOUNTER_RANGE_M = 30.0
"""Distance within which an actor counts as met by the ego."""


@dataclass(frozen=True)
class DrivingExtremes:
    """Extremes of all vehicles' driving."""

    top_speed_m_s: float
    acceleration_m_s2: float
    braking_m_s2: float


@dataclass(frozen=True)
class TrafficReport:
    """Measures of a scenario's traffic, with the fields of `report.json`.

    Attributes:
        spec: Id of the spec.
        trace_sha256: Checksum of the trace's content.
        frames: Number of kept ticks.
        duration_s: Their duration.
        actors: Number of actors by class; an articulated lorry is one truck.
        driving: Extremes of the vehicles' driving.
        staged: Outcomes of the staged conflicts, in their order.
        met: The ego's encounters with all actors near it, the nearest first; tractor units and
            semi-trailers have their own.
        crossing_share: Fraction of the background pedestrians who set foot on a roadway; None
            without any.
        overlaps: Actors in one place, tick by tick; only collisions should have any.
        is_recorded: Whether actors follow recorded trajectories, which may have collisions.
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
    crossing_share: float | None = None
    is_recorded: bool = False

    @property
    def vehicles(self) -> int:
        """Number of vehicles, connected ones included."""
        return sum(self.actors.values()) - self.pedestrians

    @property
    def pedestrians(self) -> int:
        """Number of people on foot."""
        return self.actors.get("pedestrian", 0)

    @property
    def problems(self) -> tuple[str, ...]:
        """Conflicts that did not happen as declared, and actors in one place."""
        missed = (problem for outcome in self.staged for problem in outcome.problems)
        impacts = {item.actor for item in self.staged if item.resolution.impact is not None}
        pairs = dict.fromkeys(
            (overlap.first, overlap.second)
            for overlap in self.overlaps
            if overlap.second not in impacts and not self.is_recorded
        )
        overlaps = (f"{first} and {second} overlap" for first, second in pairs)
        return (*missed, *_describe_crowding(self.staged), *overlaps)

    def to_document(self) -> dict[str, object]:
        """Convert the report to plain data for JSON."""
        return {
            **asdict(self),
            "staged": [{**asdict(item), "happened": item.happened} for item in self.staged],
        }


def _describe_crowding(staged: Iterable[ConflictOutcome]) -> Iterator[str]:
    """Describe which conflicts come too soon after the start or after another."""
    before, before_s = "the recording begins", 0.0
    for outcome in sorted(staged, key=lambda outcome: outcome.ego_at_s):
        after_s = outcome.ego_at_s - before_s
        if after_s < CALM_S:
            yield f"{outcome.id} ({outcome.conflict}) comes {after_s:.1f} s after {before}"
        before, before_s = outcome.id, outcome.ego_at_s


def build_traffic_report(spec: Spec, trace: Trace, trace_sha256: str) -> TrafficReport:
    """Measure a spec's traffic.

    Raises:
        RunError: A participant of a staged conflict is not in the trace.
    """
    encounters = (
        measure_encounter(trace, spec.ego.number, actor.id, within_m=ENCOUNTER_RANGE_M)
        for actor in trace.actors
        if actor.id != spec.ego.number
    )
    vehicles = (actor for actor in trace.actors if not actor.towed_by)
    met = sorted((item for item in encounters if item), key=lambda item: item.distance_m.value)
    return TrafficReport(
        spec=spec.id,
        trace_sha256=trace_sha256,
        frames=len(trace),
        duration_s=round(len(trace) * trace.tick_s, 6),
        actors=dict(sorted(Counter(one.actor_class for one in vehicles).items())),
        driving=_compute_driving_extremes(trace),
        staged=tuple(evaluate_outcomes(spec, trace)),
        met=tuple(met),
        overlaps=tuple(find_overlaps(trace)),
        crossing_share=_measure_crossing_share(spec, trace),
        is_recorded=spec.road.trajectories is not None,
    )


def _measure_crossing_share(spec: Spec, trace: Trace) -> float | None:
    if spec.road.is_left_hand:
        spec, trace = to_plan_spec(spec), mirror_trace(trace)
    return measure_crossing_share(spec, trace, find_roadway(spec))


def _compute_driving_extremes(trace: Trace) -> DrivingExtremes:
    on_foot = np.array([actor.actor_class == "pedestrian" for actor in trace.actors])
    rows = trace.states[~on_foot[trace.states["actor"]]]
    return DrivingExtremes(
        top_speed_m_s=float(rows["speed"].max()),
        acceleration_m_s2=float(rows["acceleration"].max()),
        braking_m_s2=float(-rows["acceleration"].min()),
    )


def build_table_rows(reports: Iterable[TrafficReport]) -> list[dict[str, object]]:
    """Build a table row per staged conflict, or one for a scenario without any."""
    return [
        {
            "scenario": report.spec,
            "frames": report.frames,
            "vehicles": report.vehicles,
            "people": report.pedestrians,
            **_build_conflict_cells(staged),
        }
        for report in reports
        for staged in report.staged or (None,)
    ]


def format_markdown_table(reports: Sequence[TrafficReport]) -> str:
    """Format the rows as a table in Markdown, means over all scenarios and counts below it."""
    table = build_table_rows(reports)
    counts = {
        "frames": [report.frames for report in reports],
        "vehicles": [report.vehicles for report in reports],
        "people": [report.pedestrians for report in reports],
    }
    heads = list(table[0])
    means = {name: f"{np.mean(values):.1f}" for name, values in counts.items()}
    table.append({"scenario": "mean", **means})
    table.append({"scenario": "count", **_count_outcomes(reports)})
    lines = [heads, ["---"] * len(heads), *([row.get(head, "") for head in heads] for row in table)]
    return "".join("| " + " | ".join(map(str, line)) + " |\n" for line in lines)


HARD_BRAKING_M_S2 = 3.0
"""Deceleration above which an ego counts as braking hard."""


def _count_outcomes(reports: Iterable[TrafficReport]) -> dict[str, object]:
    """Count over all conflicts; the braking column counts egos that brake hard or steer aside."""
    staged = [item for report in reports for item in report.staged]
    evading = [
        item
        for item in staged
        if item.resolution.ego_braking_m_s2 > HARD_BRAKING_M_S2
        or (item.resolution.ego_aside_m or 0.0) >= EVASIVE_SHIFT_M
    ]
    return {
        "conflict": f"{len(staged)}",
        "outside": f"{sum(len(item.outside) for item in staged)}",
        "ego m/s2": f"{len(evading)} over {HARD_BRAKING_M_S2:g} or aside",
        "impact km/h": f"{sum(item.resolution.impact is not None for item in staged)}",
        "happened": f"{sum(item.happened for item in staged)}",
    }


RESOLUTION_HEADS = ("ego m/s2", "ego aside m", "actor m/s2", "impact km/h")
METRIC_HEADS = ("path TTC s", "velocity TTC s", "distance m", "gap s")
PARAMETER_HEADS = {
    "ego_speed_km_h": "ego km/h",
    "actor_speed_km_h": "actor km/h",
    "arrival_offset_s": "offset s",
    "since_red_s": "red s",
    "encroachment_m": "over the line m",
}


def _build_conflict_cells(staged: ConflictOutcome | None) -> dict[str, object]:
    """Build the cells on a conflict, empty without one: measured values, declared in brackets."""
    parameter_heads = PARAMETER_HEADS.values()
    heads = (
        *("conflict", "NHTSA type", "resolved by", *parameter_heads, "outside"),
        *(*METRIC_HEADS, *RESOLUTION_HEADS, "happened"),
    )
    if staged is None:
        return dict.fromkeys(heads, "")
    met = staged.met
    metrics = (
        met.time_to_collision_on_way_s,
        met.time_to_collision_s,
        met.distance_m,
        met.post_encroachment_s,
    )
    found = {PARAMETER_HEADS[item.name]: str(item) for item in staged.parameters}
    return {
        **dict.fromkeys(heads, ""),
        **found,
        "conflict": staged.conflict,
        "NHTSA type": staged.crash_types[0],
        "resolved by": staged.resolution.resolved_by,
        **_build_resolution_cells(staged.resolution),
        "outside": ", ".join(staged.outside),
        **{
            head: f"{metric.value:.2f}"
            for head, metric in zip(METRIC_HEADS, metrics, strict=True)
            if metric is not None
        },
        "happened": "yes" if staged.happened else "no",
    }


def _build_resolution_cells(resolution: Resolution) -> dict[str, object]:
    aside_m = resolution.ego_aside_m
    cells = (
        f"{max(resolution.ego_braking_m_s2, 0):.1f}",
        "" if aside_m is None else f"{aside_m:.2f}",
        f"{max(resolution.actor_braking_m_s2, 0):.1f}",
        str(resolution.impact or ""),
    )
    return dict(zip(RESOLUTION_HEADS, cells, strict=True))
