"""A suite: which declarations to cross, by which rules, and with which seeds."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from advercity_dsl.base import Declaration, Id, Model, Percent, Seconds

Choice = Literal["all"] | tuple[Id, ...]


class Selection(Model):
    """Which typologies are about perception: somebody to misperceive, deadly, visibility-related.

    A typology has a partner if it strikes an external entity or involves at least
    `vehicles_per_crash` vehicles.
    """

    vehicles_per_crash: Annotated[float, Field(ge=1, le=5)] = 1.5
    fatality_rate_percent: Percent = 0.30
    bad_visibility_percent: Percent = 3


class Coverage(Model):
    """From which share on a kind of road must be covered."""

    land_use_percent: Percent = 40
    junction_percent: Percent = 50
    geometry_percent: Percent = 30


class Seeds(Model):
    """Seeds of everything random; the compiler derives one per purpose from them."""

    traffic: Annotated[int, Field(ge=0, lt=2**32)] = 1
    sensors: Annotated[int, Field(ge=0, lt=2**32)] = 1


class Timing(Model):
    """When a scenario is kept and when it ends; one tick is one frame."""

    tick_s: Annotated[Seconds, Field(gt=0, le=1)] = 0.1
    warm_up_ticks: Annotated[int, Field(ge=0, le=100_000)] = 59
    """Driven, not kept."""
    max_ticks: Annotated[int, Field(ge=1, le=1_000_000)] = 1800
    destination_box_m: Annotated[float, Field(gt=0)] = 10
    """The scenario ends when a connected vehicle is this near to its destination in x and in y."""

    @model_validator(mode="after")
    def _keeps_something(self) -> Self:
        if self.max_ticks < self.warm_up_ticks + 3:
            raise ValueError(
                f"max_ticks {self.max_ticks} leaves fewer than three frames after"
                f" {self.warm_up_ticks} warm_up_ticks; raise it"
            )
        return self


class Suite(Declaration):
    """What to cross."""

    kind: Literal["suite"] = "suite"
    selection: Selection = Selection()
    coverage: Coverage = Coverage()
    roads: Choice = "all"
    weathers: Choice = "all"
    densities: Choice = "all"
    rig: Id
    catalogue: Id
    seeds: Seeds = Seeds()
    timing: Timing = Timing()
