"""What happens in staged conflicts, and when."""

from collections.abc import Iterator
from dataclasses import dataclass

from advercity_dsl import Spec

from advercity.conflicts.metrics import MetricAtTick
from advercity.conflicts.report import ConflictOutcome, evaluate_outcomes
from advercity.frames import Trace


@dataclass(frozen=True)
class ConflictEvent:
    """A moment of a staged conflict.

    Attributes:
        frame: At which it happens.
        text: What happens, for people.
        point_m: Where the ways of both meet, on the ground.
        is_failure: Whether the conflict is not what was declared.
    """

    frame: int
    text: str
    point_m: tuple[float, float]
    is_failure: bool = False


def find_conflict_events(spec: Spec, trace: Trace) -> tuple[ConflictEvent, ...]:
    """The moments of all staged conflicts of a spec, by frame.

    Raises:
        RunError: Somebody who takes part is not in the trace.
    """
    told = zip(spec.conflicts, evaluate_outcomes(spec, trace), strict=True)
    events = (
        event
        for conflict, outcome in told
        for event in _iter_outcome_events(outcome, conflict.point_m, trace.tick_s)
    )
    return tuple(sorted(events, key=lambda event: event.frame))


def _iter_outcome_events(
    outcome: ConflictOutcome, point_m: tuple[float, float], tick_s: float
) -> Iterator[ConflictEvent]:
    name = f"{outcome.id} ({outcome.conflict}), actor {outcome.actor}"
    arrival = round(outcome.ego_at_s / tick_s)
    if outcome.happened:
        yield ConflictEvent(arrival, f"{name}: the ego is at the conflict point", point_m)
    else:
        missed = "; ".join(outcome.missed)
        yield ConflictEvent(arrival, f"{name}: not as declared: {missed}", point_m, is_failure=True)
    met = outcome.met
    moments: tuple[tuple[str, str, MetricAtTick | None], ...] = (
        ("least distance", "m", met.distance_m),
        ("least time to collision at the same velocities", "s", met.time_to_collision_s),
        ("least time to collision on their ways", "s", met.time_to_collision_on_way_s),
        ("post-encroachment time", "s", met.post_encroachment_s),
    )
    for what, unit, moment in moments:
        if moment is not None:
            yield ConflictEvent(moment.tick, f"{name}: {what} {moment.value:.2f} {unit}", point_m)
