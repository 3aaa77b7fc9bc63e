"""Conflicts: how a crash type is staged on a road, and the staged result in a spec."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from advercity_dsl.base import (
    ByName,
    CompactModel,
    Declaration,
    Id,
    InvalidCombination,
    Items,
    Model,
    is_none,
)
from advercity_dsl.distribution import NumberOrDistribution, compute_bounds
from advercity_dsl.traffic import ActorClass
from advercity_dsl.typology import CrashTypeId, Evidence
from advercity_dsl.units import (
    Fraction,
    Metres,
    MetresPerSecond,
    Number,
    Point2,
    PositiveMetres,
    Seconds,
)

Manoeuvre = Literal["straight", "left", "right"]
CrashRole = Literal["subject", "other"]
"""Role in a crash; the subject's action is the critical one."""
Behaviour = Literal["stops_short", "steers_clear", "drifts", "overtakes", "stands", "drives"]
"""Behaviour of an actor: it stops short of the ego's path, leaves the path sideways, drifts over
the centre line and back, overtakes on the ego's side, stays parked, or drives on."""
ApproachDirection = Literal[
    "nearside",
    "farside",
    "oncoming",
    "oncoming_turning",
    "from_left",
    "from_right",
    "alongside",
    "ahead",
    "opposite_lane",
]
"""Direction from which an actor approaches, relative to the ego."""


Resolver = Literal["actor", "ego", "both", "nobody"]
"""Who brakes or steers to avoid contact; if nobody does, the conflict is a collision."""


def _is_any(value: object) -> bool:
    return value == "any"


def _is_actor(value: object) -> bool:
    return value == "actor"


class ResolverFractions(CompactModel):
    """Fraction of a conflict's scenarios resolved by each party; the sum is 1."""

    actor: Fraction = 0
    """The actor alone stops short or steers back; the ego drives on."""
    ego: Fraction = 0
    """The ego alone brakes or steers; the actor goes on."""
    both: Fraction = 0
    """Both brake or steer."""
    nobody: Fraction = 0
    """Neither reacts: they collide, and the scenario ends."""

    @model_validator(mode="after")
    def _check_sum(self) -> Self:
        total = sum(value for _, value in self)
        if abs(total - 1) > 1e-6:
            raise ValueError(f"the fractions add up to {total:g}; they must add up to 1")
        return self


class OutcomeCriteria(Model):
    """Criteria on the trace by which a conflict counts as staged.

    In a near miss the actor approaches on a collision course: at constant speed it would arrive at
    the conflict point `arrival_offset_s` (a parameter) after the ego, within the tolerance. It then
    brakes or steers, and no contact occurs.
    """

    kind: Literal["near_miss"] = "near_miss"
    """Kind of outcome."""
    arrival_tolerance_s: Annotated[Seconds, Field(gt=0, le=2)]
    """Tolerance of the time between both arrivals, if the actor kept its approach speed."""
    time_to_collision_below_s: Annotated[Seconds, Field(gt=0, le=6)]
    """Upper bound of the lowest time to collision."""
    keeping: Literal["way", "velocity"] = "way"
    """Prediction for the time to collision: constant speed along paths, or constant velocity."""
    post_encroachment_s: tuple[Seconds, Seconds] | None = None
    """Range of the time between the ego leaving the conflict area and the actor entering it."""


class ConflictParameter(Model):
    """A number, or a distribution from which it is drawn for each road and density."""

    draw: NumberOrDistribution
    """Number or distribution: `30`, or `{uniform: [20, 40]}`."""
    source: str = ""
    """Source of the figure; without one it is an assumption."""
    evidence: Evidence = "D"
    """Strength of the evidence: A read directly to D inferred, U unverified."""


PARAMETER_BOUNDS = {
    "_km_h": (0.5, 250.0),
    "_m_s2": (0.01, 15.0),
    "_s": (-60.0, 60.0),
    "_m": (-100.0, 500.0),
}
"""Range of a parameter by the unit at the end of its name; the first match counts."""


class ConflictParameters(Model):
    """Parameters of a conflict; the unit is part of the name."""

    ego_speed_km_h: ConflictParameter
    """Speed of the ego for which the staging is designed."""
    actor_speed_km_h: ConflictParameter
    """Speed of the actor's approach."""
    acceleration_m_s2: ConflictParameter
    """Acceleration of the actor from standstill."""
    braking_m_s2: ConflictParameter
    """Deceleration with which the actor stops short of the ego."""
    ego_braking_m_s2: ConflictParameter | None = Field(default=None, exclude_if=is_none)
    """Deceleration with which the ego stops short of the actor, on a dry road."""
    arrival_offset_s: ConflictParameter
    """Time from the ego's arrival at the conflict point to the actor's, if it did not brake."""
    post_encroachment_s: ConflictParameter | None = None
    """Time from the ego leaving the actor's path to the actor continuing."""
    since_red_s: ConflictParameter | None = Field(default=None, exclude_if=is_none)
    """Time from an actor's red light to its passing of the line, where it violates the light."""
    start_lateral_m: ConflictParameter | None = None
    """Lowest distance between the actor's start and the ego's path."""
    obstruction_gap_m: ConflictParameter | None = None
    """Distance between the actor's path and the vehicle in front of it, which hides it."""
    encroachment_m: ConflictParameter | None = None
    """Overlap of the actor's body over the centre line."""
    drift_time_s: ConflictParameter | None = None
    """Duration of leaving its lane."""
    return_time_s: ConflictParameter | None = None
    """Duration of returning to its lane, or of leaving the ego's path."""
    passed_speed_km_h: ConflictParameter | None = Field(default=None, exclude_if=is_none)
    """Speed of the overtaken cyclist."""
    passing_gap_m: ConflictParameter | None = Field(default=None, exclude_if=is_none)
    """Distance behind the cyclist at which it leaves its lane, and ahead at which it is back."""

    @model_validator(mode="after")
    def _check_bounds(self) -> Self:
        for name, value in self:
            low, high = next(
                bounds for unit, bounds in PARAMETER_BOUNDS.items() if name.endswith(unit)
            )
            lowest, highest = (0.0, 0.0) if value is None else compute_bounds(value.draw)
            if value is not None and not low <= lowest <= highest <= high:
                worst = lowest if lowest < low else highest
                message = f"{worst:g} is outside the range of {low:g} to {high:g}"
                hint = "no road user in traffic does this"
                raise InvalidCombination((name, "draw"), message, hint)
        return self


class EgoRole(Model):
    """Role and manoeuvre of the ego."""

    part: CrashRole
    """Whether the ego's action is the critical one."""
    manoeuvre: Manoeuvre
    """Manoeuvre at the junction; straight away from one."""


class ActorRole(Model):
    """Role of the actor in conflict with the ego."""

    classes: Annotated[Items[ActorClass], Field(min_length=1)]
    """Classes from which one is drawn."""
    comes: ApproachDirection
    """Direction of approach, relative to the ego."""
    behaviour: Behaviour = "stops_short"
    """Behaviour at the conflict point."""
    violates: Literal["signal"] | None = None
    """Traffic control violated by it, unless it has green together with the ego."""


class PlaceRequirements(Model):
    """Requirements on the road."""

    junction: Literal["intersection", "non_junction", "any"] = "any"
    """At a junction, or away from any."""
    signals: Literal["required", "forbidden", "any"] = "any"
    """Traffic lights on the ego's path."""
    median: Literal["forbidden", "any"] = "any"
    """Whether a median may divide the road."""
    kerb_space: Literal["required", "any"] = "any"
    """Room for a parked vehicle next to the lane."""
    ahead: Literal["free", "any"] = Field(default="any", exclude_if=_is_any)
    """Whether connected vehicles normally ahead of the ego must follow it instead."""


class Conflict(Declaration):
    """Instructions for staging a crash type."""

    kind: Literal["conflict"] = "conflict"
    stages: Annotated[Items[CrashTypeId], Field(min_length=1)]
    """Crash types staged by it, all of one typology."""
    ego: EgoRole
    """Role of the ego."""
    actor: ActorRole
    """Role of the actor."""
    requires: PlaceRequirements = PlaceRequirements()
    """Requirements on the road."""
    parameters: ConflictParameters
    """Parameters with their sources."""
    resolved_by: ResolverFractions = Field(
        default=ResolverFractions(actor=1), exclude_if=lambda fractions: fractions.actor == 1
    )
    """Who resolves the conflict, drawn for each road and density."""
    outcome: OutcomeCriteria
    """Criteria of success."""

    @model_validator(mode="after")
    def _check_subject(self) -> Self:
        if self.actor.violates is not None and self.ego.part == "subject":
            message = "the critical action is the actor's, which runs the light (`actor.violates`)"
            raise InvalidCombination(("ego", "part"), message, "write other")
        return self


class StagedActor(CompactModel):
    """An actor in a conflict with the ego.

    It drives a route in lanes, or follows a free path over any ground.
    """

    id: Id
    """Id such as `conflict_1_walker`."""
    number: Annotated[int, Field(ge=1, le=100_000)]
    """Id of the actor in the trace and in annotations."""
    part: Literal["subject", "other", "bystander"]
    """Role; a bystander hides the actor, or is overtaken by it."""
    behaviour: Behaviour
    actor_class: ActorClass
    blueprint: Id
    route: Items[Id] = ()
    """Streets along which it drives."""
    lane: Annotated[int, Field(ge=1, le=9)] = 1
    """Lane on the first street, 1 is innermost."""
    path_m: Items[Point2] = ()
    """Points of a free path, or the two ends of a parked vehicle."""
    start_m: Metres = 0.0
    """Distance of its centre from the end of the first street."""
    speed_m_s: Annotated[MetresPerSecond, Field(ge=0)]
    """Speed of its approach."""
    acceleration_m_s2: Annotated[Number, Field(gt=0, le=50)]
    braking_m_s2: Annotated[Number, Field(gt=0, le=50)]


class StagedConflict(Model):
    """A conflict solved for a scenario, with numbers instead of distributions."""

    id: Id
    """Id such as `conflict_1`, numbered in the order of occurrence."""
    conflict: Id
    """Source of the solution, a conflict declaration."""
    typology: Id
    stages: Items[CrashTypeId]
    ego: CrashRole
    manoeuvre: Manoeuvre
    """Manoeuvre of the ego."""
    violates: Literal["signal"] | None = Field(default=None, exclude_if=is_none)
    """Traffic control violated by the actor."""
    light: str | None = Field(default=None, exclude_if=is_none)
    """Violated light, `<junction>/<street>`; None on imported roads."""
    actors: Annotated[Items[StagedActor], Field(min_length=1)]
    """Actors; the first conflicts with the ego."""
    point_m: Point2
    """Point where both paths cross."""
    station_m: PositiveMetres
    """Distance of the conflict point along the ego's path from its spawn."""
    window_s: tuple[Seconds, Seconds]
    """Expected times of an unhindered ego at the point, from the scenario's start."""
    parameters: ByName[Number]
    """Drawn parameters by name with unit, including `arrival_offset_s`."""
    declared: ByName[tuple[Number, Number]] = Field(default_factory=dict)
    """Lowest and highest declared value of every parameter."""
    resolved_by: Resolver = Field(default="actor", exclude_if=_is_actor)
    """Who brakes or steers."""
    mode: Literal["open_loop", "reactive"]
    """Timed against a dry run of the same traffic, or controlled at each tick."""
    outcome: OutcomeCriteria
