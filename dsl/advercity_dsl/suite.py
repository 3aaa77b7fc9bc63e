"""A suite: which declarations to cross, by which rules, and with which seeds."""

import re
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from advercity_dsl.base import Declaration, Id, InvalidCombination, Model
from advercity_dsl.units import Count, Flag, Metres, Number, Percent, Seconds

IdSelection = Literal["all"] | tuple[Id, ...]
Scalar = Flag | Number | str
CROSSED_KINDS = ("weather", "road", "density", "rig", "catalogue")


def _check_field_path(path: str) -> str:
    kind, *parts = path.split(".")
    if (
        kind not in CROSSED_KINDS
        or not parts
        or not all(re.fullmatch(r"[a-z0-9_]+", p) for p in parts)
    ):
        kinds = ", ".join(CROSSED_KINDS)
        raise ValueError(f"'{path[:60]}' is no field; begin with a kind ({kinds}): weather.time")
    return path


FieldPath = Annotated[str, AfterValidator(_check_field_path)]
"""A field of what a suite crosses: `weather.fog.mor_m`."""
MAX_SWEEP_STEPS = 1000


class Selection(Model):
    """Which typologies are about perception: somebody to misperceive, deadly, visibility-related.

    A typology has a partner if it strikes an external entity or involves at least
    `vehicles_per_crash` vehicles.
    """

    vehicles_per_crash: Annotated[Number, Field(ge=1, le=5)] = 1.5
    """From this many on, somebody else is there to be misperceived."""
    fatality_rate_percent: Percent = 0.30
    """Selected from this rate on."""
    bad_visibility_percent: Percent = 3
    """Selected from this share on."""


class Coverage(Model):
    """From which share on a kind of road must be covered."""

    land_use_percent: Percent = 40
    """Town or country is called for from this share on."""
    junction_percent: Percent = 50
    """Junctions, or places away from them, likewise."""
    geometry_percent: Percent = 30
    """Slopes and curves likewise."""


class Seeds(Model):
    """Seeds of everything random; the compiler derives one per purpose from them."""

    traffic: Annotated[Count, Field(ge=0, lt=2**32)] = 1
    """Who drives and walks where; the same under every weather."""
    sensors: Annotated[Count, Field(ge=0, lt=2**32)] = 1
    """Noise of sensors."""
    weather: Annotated[Count, Field(ge=0, lt=2**32)] = 1
    """Draws from the distributions in weathers."""


class Timing(Model):
    """When a scenario is kept and when it ends; one tick is one frame."""

    tick_s: Annotated[Seconds, Field(gt=0, le=1)] = 0.1
    """Time from frame to frame."""
    warm_up_ticks: Annotated[Count, Field(ge=0, le=100_000)] = 59
    """Driven, not kept."""
    max_ticks: Annotated[Count, Field(ge=1, le=1_000_000)] = 1800
    """The scenario ends here at the latest."""
    destination_box_m: Annotated[Metres, Field(gt=0)] = 10
    """The scenario ends when a connected vehicle is this near to its destination in x and in y."""

    @model_validator(mode="after")
    def _check_kept_frames(self) -> Self:
        if self.max_ticks < self.warm_up_ticks + 3:
            raise ValueError(
                f"max_ticks {self.max_ticks} leaves fewer than three frames after"
                f" {self.warm_up_ticks} warm_up_ticks; raise it"
            )
        return self


class ValueRange(Model):
    """Numbers from one end to another; either may be left out."""

    at_least: Scalar | None = None
    """Lowest that is kept."""
    at_most: Scalar | None = None
    """Highest that is kept."""


class Sweep(Model):
    """One field taken through many values, all else and the traffic the same.

    Either `values`, or `from`, `to` and `count`. A scenario's id ends in the field and its value.
    """

    field: FieldPath
    """What to vary: `weather.fog.mor_m`."""
    values: Annotated[tuple[Number | str, ...], Field(max_length=MAX_SWEEP_STEPS)] = ()
    """The values themselves."""
    from_: Annotated[Number | str | None, Field(alias="from")] = None
    """First value."""
    to: Number | str | None = None
    """Last value."""
    count: Annotated[Count, Field(ge=2, le=MAX_SWEEP_STEPS)] | None = None
    """How many values, both ends among them."""
    log: Flag = False
    """Equal factors between values instead of equal distances."""

    @model_validator(mode="after")
    def _check_exclusive_fields(self) -> Self:
        ends = (self.from_, self.to, self.count)
        if self.values and any(item is not None for item in ends):
            raise InvalidCombination(
                ("values",), "stands beside from, to, count", "keep one of the two"
            )
        if not self.values and any(item is None for item in ends):
            raise InvalidCombination(
                (), "has no values", "give values: [...], or all of from, to and count"
            )
        if self.log and self.values:
            raise InvalidCombination(("log",), "goes with from, to and count", "leave it out")
        return self


ConflictFit = Literal["primary", "extension", "variant"]
"""Its group calls for such a road; it fits one; it would fit one that had no traffic lights."""


class Suite(Declaration):
    """What to cross."""

    kind: Literal["suite"] = "suite"
    selection: Selection = Selection()
    """Which typologies count."""
    coverage: Coverage = Coverage()
    """Which places those call for."""
    roads: IdSelection = "all"
    """Ids, or `all` of the library, which then holds a road for every place called for."""
    weathers: IdSelection = "all"
    """Ids, or `all` of the library."""
    densities: IdSelection = "all"
    """Ids, or `all` of the library."""
    where: dict[FieldPath, Scalar | tuple[Scalar, ...] | ValueRange] = Field(default_factory=dict)
    """Only scenarios whose fields have the value, one of the values, or lie in the range given."""
    sweep: Sweep | None = None
    """One field through many values."""
    stage: dict[Id, tuple[Id, ...]] = Field(default_factory=dict)
    """Conflicts that each road's scenarios stage, one after the other, by the road's id."""
    cross_conflicts: IdSelection = ()
    """Conflicts to make scenarios of their own of, on every road that calls for them."""
    standings: tuple[ConflictFit, ...] = Field(
        default=("primary",), exclude_if=lambda standings: standings == ("primary",)
    )
    """How those have to stand to a road: called for, fitting, or fitting it without lights."""
    default: Flag = False
    """Whether this is the suite that is compiled where none is named."""
    rig: Id
    """Sensors of every scenario."""
    catalogue: Id
    """Vehicles and people of every scenario."""
    drivers: Id | None = Field(default=None, exclude_if=lambda name: name is None)
    """Drivers who react to weather; left out, they drive alike in any, and weathers are pairs."""
    seeds: Seeds = Seeds()
    """Of all that is drawn."""
    timing: Timing = Timing()
    """When scenarios begin and end."""
