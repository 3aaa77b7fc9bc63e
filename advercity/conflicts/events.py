"""Find the moments of staged conflicts, for a viewer."""

from collections.abc import Iterator
from dataclasses import dataclass

from advercity_dsl import Spec

from advercity.conflicts.metrics import MetricAtTick
from advercity.conflicts.outcome import ConflictOutcome, evaluate_outcomes
from advercity.frames import Trace


@dataclass(frozen=True)
class ConflictEvent:
    """A moment of a staged conflict, for a viewer.

    Attributes:
        frame: Kept tick at which it happens.
        text: Description, for people.
        point_m: Conflict point on the ground.
        is_failure: Whether the conflict did not happen as declared.
    """

    frame: int
    text: str
    point_m: tuple[float, float]
    is_failure: bool = False


def find_conflict_events(spec: Spec, trace: Trace) -> tuple[ConflictEvent, ...]:
    """Find the moments of all staged conflicts of a spec, by frame.

    Raises:
        RunError: A participant is not in the trace.
    """
    outcomes = zip(spec.conflicts, evaluate_outcomes(spec, trace), strict=True)
    events = (
        event
        for conflict, outcome in outcomes
        for event in _iter_outcome_events(outcome, conflict.point_m, trace.tick_s)
    )
    return tuple(sorted(events, key=lambda event: event.frame))


def _iter_outcome_events(
    outcome: ConflictOutcome, point_m: tuple[float, float], tick_s: float
) -> Iterator[ConflictEvent]:
    name = f"{outcome.id} ({outcome.conflict}), actor {outcome.actor}"
    arrival = round(outcome.ego_at_s / tick_s)
    impact = outcome.resolution.impact
    if impact is not None:
        yield ConflictEvent(impact.tick, f"{name}: collision, {impact}", point_m)
    if outcome.happened:
        yield ConflictEvent(arrival, f"{name}: the ego is at the conflict point", point_m)
    else:
        missed = "; ".join(outcome.missed)
        yield ConflictEvent(arrival, f"{name}: not as declared: {missed}", point_m, is_failure=True)
    metrics: tuple[tuple[str, str, MetricAtTick | None], ...] = (
        ("minimum distance", "m", outcome.met.distance_m),
        ("minimum time to collision on their paths", "s", outcome.met.time_to_collision_on_way_s),
        ("minimum time to collision at the same velocities", "s", outcome.met.time_to_collision_s),
        ("post-encroachment time", "s", outcome.met.post_encroachment_s),
    )
    for title, unit, metric in metrics:
        if metric is not None:
            yield ConflictEvent(metric.tick, f"{name}: {title} {metric.value:.2f} {unit}", point_m)
