"""Staged conflicts: how a crash type comes about at a place, and what of it a spec holds."""

from typing import Annotated, Literal

from pydantic import Field, StringConstraints

from advercity_dsl.base import Id, Metres, Model, Point2, PositiveMetres, Seconds
from advercity_dsl.traffic import ActorClass

CrashTypeId = Annotated[str, StringConstraints(pattern=r"^nhtsa(2007|2019):\d{1,2}$")]
"""`nhtsa2019:30`; the editions give the same numbers to different things."""
Manoeuvre = Literal["straight", "left", "right"]
Part = Literal["subject", "other"]
"""The subject's action is the critical one."""


class Outcome(Model):
    """What has to be seen in the trace for a conflict to have happened.

    In a near miss the actor comes as if to meet the ego: had it kept the speed of its approach, it
    would be at the conflict point `arrival_offset_s` (a parameter) after the ego, up to the
    tolerance. Then it brakes or steers, so that nobody touches.
    """

    kind: Literal["near_miss"] = "near_miss"
    arrival_tolerance_s: Annotated[Seconds, Field(gt=0, le=2)]
    """Of the time between both at the conflict point, if the actor kept its approach's speed."""
    time_to_collision_below_s: Annotated[Seconds, Field(gt=0, le=6)]
    """The least time to collision is below this at some tick."""
    keeping: Literal["way", "velocity"] = "way"
    """Time to collision if both kept their speed on the ways that they take, or their velocity."""
    post_encroachment_s: tuple[Seconds, Seconds] | None = None
    """Range of the time between the ego leaving a place and the actor coming there."""


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
    actor_class: ActorClass
    blueprint: Id
    route: tuple[Id, ...] = ()
    """Streets it drives along."""
    lane: Annotated[int, Field(ge=1)] = 1
    """On the first street, 1 is innermost."""
    path_m: tuple[Point2, ...] = ()
    """Points it walks or rides along, or the two that a parked vehicle lies between."""
    start_m: Metres = 0.0
    """Distance of its middle from the end of the first street, or along its path."""
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
    ego: Part
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
    """When the ego is expected at the point, since the scenario's start."""
    parameters: dict[Id, float]
    """What was drawn, by name with its unit; `arrival_offset_s` is among them."""
    mode: Literal["open_loop", "reactive"]
    """Timed against a rehearsal of the same traffic, or from tick to tick."""
    outcome: Outcome
