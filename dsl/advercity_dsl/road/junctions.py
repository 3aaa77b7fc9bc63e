"""Junctions: which lane leads into which, lights, signs and crossings."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field, StringConstraints

from advercity_dsl.base import CompactModel, Id, Model, is_empty, is_none
from advercity_dsl.units import Point2, Point3, PositiveMetres, Seconds

LaneText = Annotated[str, StringConstraints(pattern=r"^[a-z][a-z0-9_]*\.\d$")]
"""`north_road.1`: the innermost lane of a street, on the side that the junction means."""


MovementText = Annotated[
    str, StringConstraints(pattern=r"^[a-z][a-z0-9_]*\.\d > [a-z][a-z0-9_]*\.\d$")
]
"""`north_road.1 > east_road.1`: from the innermost lane of one street into that of another."""


@dataclass(frozen=True)
class Movement:
    """A way through a junction; lanes count from 1, the innermost."""

    from_street: Id
    from_lane: int
    to_street: Id
    to_lane: int

    @staticmethod
    def parse(text: str) -> "Movement":
        """Take a `MovementText` apart."""
        (from_street, from_lane), (to_street, to_lane) = (
            side.split(".") for side in text.split(" > ")
        )
        return Movement(from_street, int(from_lane), to_street, int(to_lane))


class SignalHead(Model):
    """A traffic light: the heads hang at `at_m`, on a mast whose foot is at `pole_m`."""

    street: Id
    """Whose traffic it is for."""
    at_m: Point3
    """Where the heads hang, [east, north, up]."""
    pole_m: Point2
    """Foot of the mast, [east, north]."""


class Signals(Model):
    """A fixed programme, one approach at a time, in the order of `cycle`."""

    cycle: Annotated[tuple[Id, ...], Field(min_length=1)]
    """Streets in the order in which they get green."""
    green_s: Annotated[Seconds, Field(gt=0)]
    """Green of each."""
    yellow_s: Annotated[Seconds, Field(gt=0)] = 3
    """Yellow after it."""
    all_red_s: Annotated[Seconds, Field(ge=0)] = 2
    """All red after that."""
    elapsed_s: Annotated[Seconds, Field(ge=0)] = 0
    """Time of the first approach's green that is over when the scenario starts."""
    heads: tuple[SignalHead, ...] = ()
    """Traffic lights to be seen."""


class Crossing(Model):
    """A zebra crossing over a street, at the end where it meets the junction."""

    street: Id
    """Which it leads across."""
    width_m: PositiveMetres = 3.0
    """Along that street."""


class Sign(Model):
    """A stop or give-way sign for one approach."""

    street: Id
    """Whose traffic it is for."""
    kind: Literal["stop", "yield"]
    """What it says."""
    at_m: Point2
    """Where it stands, [east, north]."""


class Junction(CompactModel):
    """Where streets meet, and which lane may go into which."""

    control: Literal["signals", "priority", "stop", "yield", "none"] = "none"
    """Who goes first."""
    movements: tuple[MovementText, ...] = ()
    """Ways through it: `north.1 > east.1`."""
    corner_radius_m: PositiveMetres = 5.0
    """Of the roadway's edge between neighbouring streets."""
    turn_radius_m: PositiveMetres | None = Field(default=None, exclude_if=is_none)
    """Largest radius of a turn between straights; without it, as wide as there is room."""
    median: tuple[Id, Id] | None = None
    """Two streets between which the median runs on through the junction."""
    signals: Signals | None = None
    """Programme of its lights, with `control: signals`."""
    crossings: tuple[Crossing, ...] = ()
    """Zebra crossings."""
    signs: tuple[Sign, ...] = ()
    """Stop and give-way signs."""
    arrows: tuple[LaneText, ...] = Field(default=(), exclude_if=is_empty)
    """Arriving lanes on which arrows say where they lead."""
