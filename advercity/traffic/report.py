"""What a scenario's traffic amounts to: who takes part, how near they come, what was staged."""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass

import numpy as np
from advercity_dsl import Spec

from advercity.traffic.encounters import Encounter, Overlap, encounter, overlaps
from advercity.traffic.outcomes import StagedOutcome, outcomes
from advercity.traffic.trace import Trace

NEAR_M = 30.0
"""Whoever comes this near to the ego is met by it."""


@dataclass(frozen=True)
class Driving:
    """Extremes over all vehicles."""

    top_speed_m_s: float
    acceleration_m_s2: float
    braking_m_s2: float


@dataclass(frozen=True)
class Report:
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
    driving: Driving
    staged: tuple[StagedOutcome, ...]
    met: tuple[Encounter, ...]
    overlaps: tuple[Overlap, ...]

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

    def document(self) -> dict[str, object]:
        """The report as plain data for JSON."""
        return {
            **asdict(self),
            "staged": [{**asdict(one), "happened": one.happened} for one in self.staged],
        }


def report(spec: Spec, trace: Trace, trace_sha256: str) -> Report:
    """The report on a spec's traffic.

    Raises:
        RunError: Somebody who takes part in a staged conflict is not in the trace.
    """
    nearest = sorted(_met(spec, trace), key=lambda one: one.distance_m.value)
    return Report(
        spec=spec.id,
        trace_sha256=trace_sha256,
        frames=len(trace),
        duration_s=round(len(trace) * trace.tick_s, 6),
        actors=dict(sorted(Counter(actor.actor_class for actor in trace.actors).items())),
        driving=_driving(trace),
        staged=tuple(outcomes(spec, trace)),
        met=tuple(nearest),
        overlaps=tuple(overlaps(trace)),
    )


def _met(spec: Spec, trace: Trace) -> Iterator[Encounter]:
    ego = spec.ego.number
    for actor in trace.actors:
        found = encounter(trace, ego, actor.id, within_m=NEAR_M) if actor.id != ego else None
        if found is not None:
            yield found


def _driving(trace: Trace) -> Driving:
    on_foot = np.array([actor.actor_class == "pedestrian" for actor in trace.actors])
    rows = trace.states[~on_foot[trace.states["actor"]]]
    return Driving(
        top_speed_m_s=float(rows["speed"].max()),
        acceleration_m_s2=float(rows["acceleration"].max()),
        braking_m_s2=float(-rows["acceleration"].min()),
    )


def rows(reports: Iterable[Report]) -> list[dict[str, object]]:
    """A row per staged conflict, or one for a scenario that stages none; for tables."""
    return [
        {
            "scenario": one.spec,
            "frames": one.frames,
            "vehicles": one.vehicles,
            "people": one.pedestrians,
            **_staged_cells(staged),
        }
        for one in reports
        for staged in one.staged or (None,)
    ]


def markdown(reports: Sequence[Report]) -> str:
    """The rows as a table in Markdown, the means over all scenarios below it."""
    table = rows(reports)
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


def _staged_cells(staged: StagedOutcome | None) -> dict[str, object]:
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
