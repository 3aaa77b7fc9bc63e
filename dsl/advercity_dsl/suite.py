"""Suites: which declarations to cross, by which rules, and with which seeds."""

import re
from typing import Annotated, Literal, Self

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Discriminator,
    Field,
    StringConstraints,
    Tag,
    model_validator,
)

from advercity_dsl.base import (
    ByName,
    Declaration,
    Id,
    InvalidCombination,
    Items,
    Model,
    check_all_or_list,
    find_all_or_list_tag,
    is_empty,
    is_none,
)
from advercity_dsl.conflict import ResolverFractions
from advercity_dsl.units import Count, Flag, Metres, Number, Percent, Seconds


def _check_named_once(names: tuple[str, ...]) -> tuple[str, ...]:
    for index, name in enumerate(names):
        if name in names[:index]:
            raise InvalidCombination((index,), f"'{name}' is named twice", "remove one of them")
    return names


def _check_selection(value: object) -> object:
    is_item = isinstance(value, str) and re.fullmatch(PATTERN_OF_IDS, value) is not None
    hint = f"write [{value}]" if is_item else "list every id: [first_id, second_id]"
    return check_all_or_list(value, things="ids", hint=hint)


IdSelection = Annotated[
    Annotated[Literal["all"], Tag("all")]
    | Annotated[Items[Id], AfterValidator(_check_named_once), Tag("list")],
    Discriminator(find_all_or_list_tag),
    BeforeValidator(_check_selection),
]
"""`all`, or a list of ids."""
PATTERN_OF_IDS = r"^[a-z*?][a-z0-9_*?]{0,63}$"
PatternSelection = Annotated[
    Annotated[Literal["all"], Tag("all")]
    | Annotated[
        Items[Annotated[str, StringConstraints(pattern=PATTERN_OF_IDS)]],
        AfterValidator(_check_named_once),
        Tag("list"),
    ],
    Discriminator(find_all_or_list_tag),
    BeforeValidator(_check_selection),
]
"""`all`, or a list of ids and patterns: `fog_*` selects every id that begins like it."""
Scalar = Flag | Number | str
CROSSED_KINDS = ("weather", "road", "density", "rig", "catalogue", "channel")


def _check_field_path(path: str) -> str:
    kind, *parts = path.split(".")
    if (
        kind not in CROSSED_KINDS
        or not parts
        or not all(re.fullmatch(r"[a-z0-9_]{1,64}", p) for p in parts)
    ):
        kinds = ", ".join(CROSSED_KINDS)
        raise ValueError(f"'{path[:60]}' is not a field; begin with a kind ({kinds}): weather.time")
    return path


FieldPath = Annotated[str, AfterValidator(_check_field_path)]
"""Field of a crossed declaration: `weather.fog.mor_m`."""
MAX_SWEEP_STEPS = 1000
MAX_REPEATS = 1000


class Selection(Model):
    """Thresholds for typologies: a collision partner, fatalities, bad visibility.

    A typology has a collision partner if an external entity is struck or at least
    `vehicles_per_crash` vehicles are involved.
    """

    vehicles_per_crash: Annotated[Number, Field(ge=1, le=5)] = 1.5
    """Lowest mean number of vehicles of a typology with a collision partner."""
    fatality_rate_percent: Percent = 0.30
    """Lowest selected fatality rate."""
    bad_visibility_percent: Percent = 3
    """Lowest selected percentage of crashes in bad visibility."""


class Coverage(Model):
    """Lowest percentages of a group's crashes for which a kind of road must be covered."""

    land_use_percent: Percent = 40
    """Threshold for urban or rural roads."""
    junction_percent: Percent = 50
    """Threshold for junctions, or places away from them."""
    geometry_percent: Percent = 30
    """Threshold for slopes and curves."""


class Seeds(Model):
    """Seeds of all random numbers; the compiler derives one per purpose."""

    traffic: Count = 1
    """Seed of traffic, which is the same under every weather."""
    sensors: Count = 1
    """Seed of sensor noise."""
    weather: Count = 1
    """Seed of draws from the distributions in weathers."""


class Timing(Model):
    """When recording starts and when a scenario ends; one tick is one frame."""

    tick_s: Annotated[Seconds, Field(ge=0.001, le=1)] = 0.1
    """Time between frames."""
    warm_up_ticks: Annotated[Count, Field(ge=0, le=100_000)] = 59
    """Ticks simulated before recording starts."""
    max_ticks: Annotated[Count, Field(ge=1, le=1_000_000)] = 1800
    """Tick at which the scenario ends at the latest."""
    destination_box_m: Annotated[Metres, Field(ge=0.1, le=1000)] = 10
    """Distance to a connected vehicle's destination, in x and in y, at which the scenario ends."""

    @model_validator(mode="after")
    def _check_kept_frames(self) -> Self:
        if self.max_ticks < self.warm_up_ticks + 3:
            raise ValueError(
                f"max_ticks {self.max_ticks} leaves fewer than three frames after"
                f" {self.warm_up_ticks} warm_up_ticks; raise it"
            )
        return self


class ValueRange(Model):
    """Range of numbers; either end may be left out."""

    at_least: Scalar | None = None
    """Lowest value."""
    at_most: Scalar | None = None
    """Highest value."""


class Sweep(Model):
    """Variation of one field over many values, with everything else and the traffic unchanged.

    Either `values`, or `from`, `to` and `count`. A scenario's id ends in the field and its value.
    """

    field: FieldPath
    """Field to vary: `weather.fog.mor_m`."""
    values: Annotated[Items[Number | str], Field(max_length=MAX_SWEEP_STEPS)] = ()
    """Values of the field."""
    from_: Annotated[Number | str | None, Field(alias="from")] = None
    """First value."""
    to: Number | str | None = None
    """Last value."""
    count: Annotated[Count, Field(ge=2, le=MAX_SWEEP_STEPS)] | None = None
    """Number of values, including both ends."""
    log: Flag = False
    """Whether values are spaced logarithmically instead of linearly."""

    @model_validator(mode="after")
    def _check_exclusive_fields(self) -> Self:
        ends = (self.from_, self.to, self.count)
        if self.values and any(item is not None for item in ends):
            raise InvalidCombination(
                ("values",), "cannot be combined with from, to, count", "keep one of the two"
            )
        if not self.values and any(item is None for item in ends):
            raise InvalidCombination(
                (), "has no values", "give values: [...], or all of from, to and count"
            )
        if self.log and self.values:
            raise InvalidCombination(("log",), "requires from, to and count", "remove it")
        return self


def _find_sweep_tag(value: object) -> str:
    return "together" if isinstance(value, list | tuple) else "alone"


Sweeps = Annotated[
    Annotated[Sweep, Tag("alone")] | Annotated[Items[Sweep], Tag("together")],
    Discriminator(_find_sweep_tag),
]
"""A sweep, or a list of sweeps to cross."""
ConflictFit = Literal["primary", "extension", "variant"]
"""How a conflict matches a road: its group requires such a road, it can be staged there, or it
could be staged there without the traffic lights."""


Looks = Literal["full", "shaped"]
"""Whether asset packages are used."""


class Suite(Declaration):
    """Roads, weathers and densities to cross, and common settings of all scenarios."""

    kind: Literal["suite"] = "suite"
    selection: Selection = Selection()
    """Rule for the selection of typologies."""
    coverage: Coverage = Coverage()
    """Rule for the kinds of roads of the selected typologies."""
    roads: PatternSelection = "all"
    """Ids and patterns such as `r*`, or `all` of the library, which then needs a road of every
    required kind."""
    weathers: PatternSelection = "all"
    """Ids and patterns such as `fog_*`, or `all` of the library but the `optional` ones."""
    densities: PatternSelection = "all"
    """Ids and patterns, or `all` of the library."""
    where: dict[FieldPath, Scalar | Items[Scalar] | ValueRange] = Field(
        default_factory=dict, max_length=1000
    )
    """Conditions on scenarios, by field: a value, one of several values, or a range."""
    sweep: Sweeps | None = None
    """Variation of one field over many values; a list of sweeps is crossed."""
    stage: ByName[Items[Id]] = Field(default_factory=dict)
    """Conflicts staged in the scenarios of a road, by road id, in the order of occurrence."""
    staged_at_once: Annotated[Count, Field(ge=1)] | None = Field(default=None, exclude_if=is_none)
    """Highest number of conflicts in one scenario; repeats take turns over the rest of a road's
    list, which all densities stage alike. All of the list where omitted."""
    cross_conflicts: IdSelection = ()
    """Conflicts with their own scenarios on every road where they can be staged."""
    standings: Items[ConflictFit] = Field(
        default=("primary",), exclude_if=lambda standings: standings == ("primary",)
    )
    """How conflicts of `cross_conflicts` must match a road: primary, extension or variant.
    Conflicts of `stage` may be variants if `variant` is among these."""
    looks: Looks = Field(default="full", exclude_if=lambda looks: looks == "full")
    """Whether bodies are models and surfaces photographs of asset packages, which a run then needs
    (`full`), or both are generated (`shaped`)."""
    default: Flag = False
    """Whether this suite is compiled if none is named."""
    rig: Id
    """Sensors of all agents without an entry in `agents`."""
    agents: ByName[Id] = Field(default_factory=dict, exclude_if=is_empty)
    """Rigs of single agents, by the agent's id: `{cav1: nuscenes_like, rsu1: roadside}`."""
    channel: Id | None = Field(default=None, exclude_if=is_none)
    """V2X channel between the agents; without one, no messages are written."""
    catalogue: Id
    """Vehicles and people of every scenario."""
    bodies: ByName[Id] = Field(default_factory=dict, exclude_if=is_empty)
    """Blueprints of single connected vehicles, by agent; others have the catalogue's `ego`."""
    drivers: Id | None = Field(default=None, exclude_if=lambda name: name is None)
    """Drivers who react to weather; without them, traffic is the same in every weather."""
    resolved_by: ResolverFractions | None = Field(default=None, exclude_if=is_none)
    """Who resolves the conflicts, in place of their own `resolved_by`."""
    pairing: Literal["weather", "none"] = Field(
        default="weather", exclude_if=lambda pairing: pairing == "weather"
    )
    """Reaction of the ego to staged actors: as in `reaction_weather`, with the traffic and the
    noise of sensors shared by all weathers (`weather`), or as in the weather of each scenario, with
    its own seeds (`none`)."""
    reaction_weather: Id | None = Field(default=None, exclude_if=is_none)
    """Weather of the ego's friction and visibility; without it, a dry road in clear air."""
    seeds: Seeds = Seeds()
    """Seeds of all random numbers."""
    repeats: Annotated[Count, Field(ge=1, le=MAX_REPEATS)] = Field(
        default=1, exclude_if=lambda count: count == 1
    )
    """Traffic seeds of every road and density; each is shared by all weathers. The number of the
    repeat ends a scenario's id; the first one has the traffic of a suite without repeats."""
    timing: Timing = Timing()
    """Start and end of scenarios."""

    @property
    def sweeps(self) -> dict[tuple[str | int, ...], Sweep]:
        """Sweeps by their paths in the suite; empty without any."""
        if isinstance(self.sweep, tuple):
            return {("sweep", index): item for index, item in enumerate(self.sweep)}
        return {} if self.sweep is None else {("sweep",): self.sweep}

    @model_validator(mode="after")
    def _check_pairing(self) -> Self:
        if self.pairing == "none" and self.reaction_weather is not None:
            message = "has no effect: the ego reacts as in the weather of each scenario"
            hint = "remove it (`null` where it is inherited), or write `pairing: weather`"
            raise InvalidCombination(("reaction_weather",), message, hint, other_path=("pairing",))
        return self
