"""Conflicts: how a crash type is staged at a place, and what of it a spec holds."""

from typing import Annotated, Literal

from pydantic import Field

from advercity_dsl.base import Declaration, Id, Model, is_none
from advercity_dsl.distribution import NumberOrDistribution
from advercity_dsl.traffic import ActorClass
from advercity_dsl.typology import CrashTypeId, Evidence
from advercity_dsl.units import Metres, Point2, PositiveMetres, Seconds

Manoeuvre = Literal["straight", "left", "right"]
CrashRole = Literal["subject", "other"]
"""The subject's action is the critical one."""
Behaviour = Literal["stops_short", "steers_clear", "drifts", "overtakes", "stands", "drives"]
"""What an actor does: it stops where the ego comes by, leaves the ego's way to the side, drifts
over the centre line and back, overtakes on the ego's side, stands, or drives on."""
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
"""From where an actor comes, as the ego sees it."""


def _is_any(value: object) -> bool:
    return value == "any"


class OutcomeCriteria(Model):
    """What has to be seen in the trace for a conflict to have happened.

    In a near miss the actor comes as if to meet the ego: had it kept the speed of its approach, it
    would be at the conflict point `arrival_offset_s` (a parameter) after the ego, up to the
    tolerance. Then it brakes or steers, so that nobody touches.
    """

    kind: Literal["near_miss"] = "near_miss"
    """How it ends."""
    arrival_tolerance_s: Annotated[Seconds, Field(gt=0, le=2)]
    """Of the time between both at the conflict point, if the actor kept its approach's speed."""
    time_to_collision_below_s: Annotated[Seconds, Field(gt=0, le=6)]
    """The least time to collision is below this at some tick."""
    keeping: Literal["way", "velocity"] = "way"
    """Time to collision if both kept their speed on the ways that they take, or their velocity."""
    post_encroachment_s: tuple[Seconds, Seconds] | None = None
    """Range of the time between the ego leaving a place and the actor coming there."""


class ConflictParameter(Model):
    """A number, or the distribution that each road and density draws it from."""

    draw: NumberOrDistribution
    """`30`, or `{uniform: [20, 40]}`."""
    source: str = ""
    """Where it comes from; what has no source is an assumption."""
    evidence: Evidence = "D"
    """How sure it is: A read directly to D inferred, U unverified."""


class ConflictParameters(Model):
    """What a conflict draws; the unit is in the name."""

    ego_speed_km_h: ConflictParameter
    """Range that the staging is meant for."""
    actor_speed_km_h: ConflictParameter
    """Of its approach."""
    acceleration_m_s2: ConflictParameter
    """With which the actor sets out."""
    braking_m_s2: ConflictParameter
    """With which it stops short of the ego."""
    arrival_offset_s: ConflictParameter
    """Of the actor after the ego at the conflict point, if it did not brake."""
    post_encroachment_s: ConflictParameter | None = None
    """From the ego's leaving the actor's way to the actor's going on."""
    start_lateral_m: ConflictParameter | None = None
    """Least distance between where the actor starts and the ego's way."""
    obstruction_gap_m: ConflictParameter | None = None
    """Between the actor's path and what hides it."""
    encroachment_m: ConflictParameter | None = None
    """How far the actor's body reaches over the centre line."""
    drift_time_s: ConflictParameter | None = None
    """In which it leaves its lane."""
    return_time_s: ConflictParameter | None = None
    """In which it comes back, or leaves the way of the ego."""
    passed_speed_km_h: ConflictParameter | None = Field(default=None, exclude_if=is_none)
    """Of the cyclist whom it overtakes."""
    passing_gap_m: ConflictParameter | None = Field(default=None, exclude_if=is_none)
    """It is beside its lane from this far behind the cyclist to this far ahead."""


class EgoRole(Model):
    """What the ego does in it."""

    part: CrashRole
    """Whether its own action is the critical one."""
    manoeuvre: Manoeuvre
    """At the junction; straight on away from one."""


class ActorRole(Model):
    """Whom the ego meets."""

    classes: Annotated[tuple[ActorClass, ...], Field(min_length=1)]
    """One of them is drawn."""
    comes: ApproachDirection
    """From where, as the ego sees it."""
    behaviour: Behaviour = "stops_short"
    """What it does in the end."""
    violates: Literal["signal"] | None = None
    """What it does not obey."""


class PlaceRequirements(Model):
    """What the place has to be like."""

    junction: Literal["intersection", "non_junction", "any"] = "any"
    """At a junction, or away from any."""
    signals: Literal["required", "forbidden", "any"] = "any"
    """Traffic lights on the ego's way."""
    median: Literal["forbidden", "any"] = "any"
    """Whether one may divide the road."""
    kerb_space: Literal["required", "any"] = "any"
    """Room for a parked vehicle beside the lane."""
    ahead: Literal["free", "any"] = Field(default="any", exclude_if=_is_any)
    """Whether connected vehicles that usually lead the ego have to follow it."""


class Conflict(Declaration):
    """How to stage a crash type."""

    kind: Literal["conflict"] = "conflict"
    stages: Annotated[tuple[CrashTypeId, ...], Field(min_length=1)]
    """Crash types of a typology; those of one group."""
    ego: EgoRole
    """What the ego does."""
    actor: ActorRole
    """Whom it meets."""
    requires: PlaceRequirements = PlaceRequirements()
    """What the road has to be like."""
    parameters: ConflictParameters
    """Numbers, with their sources."""
    outcome: OutcomeCriteria
    """What has to come of it."""


class StagedActor(Model):
    """Somebody who takes part in a conflict along with the ego.

    It drives a route in its lanes, or follows a path of its own over any ground.
    """

    id: Id
    """`conflict_1_walker`."""
    number: Annotated[int, Field(gt=0)]
    """Id of the actor in the trace and in annotations."""
    part: Literal["subject", "other", "bystander"]
    """A bystander hides the actor, or is overtaken by it."""
    behaviour: Behaviour
    actor_class: ActorClass
    blueprint: Id
    route: tuple[Id, ...] = ()
    """Streets it drives along."""
    lane: Annotated[int, Field(ge=1)] = 1
    """On the first street, 1 is innermost."""
    path_m: tuple[Point2, ...] = ()
    """Points it walks or rides along, or the two that a parked vehicle lies between."""
    start_m: Metres = 0.0
    """Distance of its middle from the end of the first street."""
    speed_m_s: Annotated[float, Field(ge=0)]
    """Of its approach."""
    acceleration_m_s2: Annotated[float, Field(gt=0)]
    braking_m_s2: Annotated[float, Field(gt=0)]


class StagedConflict(Model):
    """A conflict that a scenario stages, solved: numbers instead of distributions."""

    id: Id
    """`conflict_1`; in the order in which they happen."""
    conflict: Id
    """The declaration it was made from."""
    typology: Id
    stages: tuple[CrashTypeId, ...]
    ego: CrashRole
    manoeuvre: Manoeuvre
    """Of the ego."""
    violates: Literal["signal"] | None = None
    """What the actor does not obey."""
    actors: Annotated[tuple[StagedActor, ...], Field(min_length=1)]
    """The first one meets the ego."""
    point_m: Point2
    """Where both ways meet."""
    station_m: PositiveMetres
    """Of that point along the ego's way from its spawn."""
    window_s: tuple[Seconds, Seconds]
    """When an ego that nobody holds up is expected at the point, since the scenario's start."""
    parameters: dict[Id, float]
    """What was drawn, by name with its unit; `arrival_offset_s` is among them."""
    mode: Literal["open_loop", "reactive"]
    """Timed against a rehearsal of the same traffic, or from tick to tick."""
    outcome: OutcomeCriteria
