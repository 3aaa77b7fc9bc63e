"""Junctions: movements between lanes, traffic lights, signs and crossings."""

from dataclasses import dataclass
from functools import partial
from typing import Annotated, Literal

from pydantic import BeforeValidator, Discriminator, Field, StringConstraints, Tag

from advercity_dsl.base import (
    CompactModel,
    Id,
    Items,
    Model,
    check_all_or_list,
    find_all_or_list_tag,
    is_empty,
    is_none,
)
from advercity_dsl.units import Point2, Point3, PositiveMetres, RangeReason, Seconds

LaneText = Annotated[str, StringConstraints(pattern=r"^[a-z][a-z0-9_]*\.\d$")]
"""`north_road.1`: the innermost lane of a street, on the side implied by the context."""


MovementText = Annotated[
    str, StringConstraints(pattern=r"^[a-z][a-z0-9_]*\.\d > [a-z][a-z0-9_]*\.\d$")
]
"""`north_road.1 > east_road.1`: from the innermost lane of one street into another's."""


Movements = Annotated[
    Annotated[Literal["all"], Tag("all")] | Annotated[Items[MovementText], Tag("list")],
    Discriminator(find_all_or_list_tag),
    BeforeValidator(
        partial(check_all_or_list, things="movements", hint="write [north.1 > east.1]")
    ),
]
"""`all`: from every street into every other one; or a list of movements."""


@dataclass(frozen=True)
class Movement:
    """A path through a junction; lanes count from 1, the innermost."""

    from_street: Id
    from_lane: int
    to_street: Id
    to_lane: int

    @staticmethod
    def parse(text: str) -> "Movement":
        """Parse a `MovementText`."""
        (from_street, from_lane), (to_street, to_lane) = (
            side.split(".") for side in text.split(" > ")
        )
        return Movement(from_street, int(from_lane), to_street, int(to_lane))

    def __str__(self) -> str:
        return f"{self.from_street}.{self.from_lane} > {self.to_street}.{self.to_lane}"


class SignalHead(Model):
    """A traffic light at `at_m`, on a mast with its foot at `pole_m`."""

    street: Id
    """Street for which it applies."""
    at_m: Point3
    """Position of the head, [east, north, up]."""
    pole_m: Point2
    """Foot of the mast, [east, north]."""


PhaseSeconds = Annotated[
    Seconds, Field(ge=0, le=86_400), RangeReason("a phase is shorter than a day")
]


def _find_phase_tag(value: object) -> str:
    return "together" if isinstance(value, list | tuple) else "alone"


Approaches = Annotated[
    Annotated[Id, Tag("alone")] | Annotated[Items[Id], Tag("together")],
    Discriminator(_find_phase_tag),
]
"""A street, or streets with green together: their left turns give way to oncoming traffic."""


class Signals(Model):
    """A fixed signal programme, some approaches at a time."""

    cycle: Annotated[Items[Approaches], Field(min_length=1)]
    """Streets in the order of their green phases; those in a list have green together."""
    green_s: Annotated[PhaseSeconds, Field(gt=0)]
    """Duration of green for each street."""
    yellow_s: Annotated[PhaseSeconds, Field(gt=0)] = 3
    """Duration of yellow."""
    all_red_s: PhaseSeconds = 2
    """Duration of the all-red phase."""
    elapsed_s: PhaseSeconds = 0
    """Time since the start of the first green phase when the scenario starts."""
    heads: Items[SignalHead] = ()
    """Visible traffic lights."""

    @property
    def phases(self) -> tuple[tuple[Id, ...], ...]:
        """Streets of every green phase, in their order."""
        return tuple((item,) if isinstance(item, str) else item for item in self.cycle)


class Crossing(Model):
    """A zebra crossing over a street, at its end at the junction."""

    street: Id
    """Crossed street."""
    width_m: Annotated[PositiveMetres, Field(ge=0.5, le=60)] = 3.0
    """Width along the street."""


class Sign(Model):
    """A stop or give-way sign for one approach."""

    street: Id
    """Street for which it applies."""
    kind: Literal["stop", "yield"]
    """Kind of sign."""
    at_m: Point2
    """Position, [east, north]."""


class Junction(CompactModel):
    """A junction of streets, with its permitted movements."""

    control: Literal["signals", "priority", "all_way_stop", "stop", "yield", "none"] = "none"
    """Rule of right of way; `all_way_stop` puts a stop sign at every street without one."""
    movements: Movements = "all"
    """Lane links through it, `north.1 > east.1`; `all` leads into every other street."""
    corner_radius_m: Annotated[PositiveMetres, Field(ge=0.1, le=200)] = 5.0
    """Radius of the roadway's edge between neighbouring streets."""
    turn_radius_m: Annotated[PositiveMetres, Field(ge=1, le=1000)] | None = Field(
        default=None, exclude_if=is_none
    )
    """Largest radius of a turn between straights; without it, as large as space permits."""
    median: tuple[Id, Id] | None = None
    """Two streets between which the median continues through the junction."""
    signals: Signals | None = None
    """Signal programme, with `control: signals`."""
    crossings: Items[Crossing] = ()
    """Zebra crossings."""
    signs: Items[Sign] = ()
    """Stop and give-way signs."""
    arrows: Items[LaneText] = Field(default=(), exclude_if=is_empty)
    """Incoming lanes with arrow markings."""
