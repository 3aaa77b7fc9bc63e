"""A compiled scenario: self-contained, versioned, and enough to regenerate its data.

Nothing in it refers to another file.
"""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from advercity_dsl.base import Digest, Id, Model, is_empty
from advercity_dsl.catalogue import Blueprint
from advercity_dsl.conflict import StagedConflict
from advercity_dsl.distribution import Distribution
from advercity_dsl.rig import SensorSet
from advercity_dsl.road import ClassFractions, Road, RoadsideUnit, Vehicle
from advercity_dsl.suite import FieldPath, Timing
from advercity_dsl.traffic import ActorClass, Density, DriverResponse, Drivers
from advercity_dsl.weather import Weather

SPEC_VERSION = 1


class Agent(Model):
    """A viewpoint: a connected vehicle or a roadside unit, with its sensors."""

    id: Id
    number: int
    """Id of the agent in annotations; negative for roadside units."""
    place: Annotated[Vehicle | RoadsideUnit, Field(discriminator="kind")]
    sensors: SensorSet
    blueprint: Id | None = None
    """What a connected vehicle looks like."""

    @property
    def is_ego(self) -> bool:
        """Whether it is the connected vehicle that conflicts are staged for."""
        return self.place.is_ego


class ClassDemand(Model):
    """How many of what is asked for."""

    vehicles: Annotated[int, Field(ge=0, le=20_000)]
    walkers: Annotated[int, Field(ge=0, le=20_000)]
    crossing_share: float
    classes: ClassFractions
    around_agent_m: float
    around_path_m: float
    speed_offset_percent: float


class CrashGroup(Model):
    """A group of crash types that this road is here for."""

    typology: Id
    crash_types: tuple[str, ...]


class SpecSeeds(Model):
    """`traffic` differs by road and density alone; `sensors` is used along with the spec's id."""

    traffic: int
    sensors: int
    weather: int = 1


class SweepPoint(Model):
    """The step of a suite's sweep that a scenario is."""

    field: FieldPath
    value: float


class Provenance(Model):
    """What the spec was compiled from."""

    compiler: str
    suite: Id
    declarations: dict[str, Digest]
    """SHA-256 of every declaration that went in, as `kind/id`."""
    draws: dict[str, Distribution] = Field(default_factory=dict)
    """What numbers of the spec were drawn from, by their path."""
    sweep: SweepPoint | None = None
    conflict: Id | None = Field(default=None, exclude_if=is_empty)
    """The conflict that the suite crossed its roads with."""
    digest: Digest
    """SHA-256 of the spec itself, with this field left out."""


class Spec(Model):
    """One scenario."""

    spec_version: Literal[1] = SPEC_VERSION
    id: Id
    groups: tuple[CrashGroup, ...]
    road: Road
    weather: Weather
    density: Density
    agents: Annotated[tuple[Agent, ...], Field(min_length=1)]
    demand: ClassDemand
    conflicts: tuple[StagedConflict, ...] = Field(default=(), exclude_if=is_empty)
    """In the order in which they happen."""
    drivers: Drivers | None = Field(default=None, exclude_if=is_empty)
    """What drivers do about weather; they drive alike in any if it is left out."""
    caution: DriverResponse | None = Field(default=None, exclude_if=is_empty)
    """What they do about this one."""
    blueprints: dict[Id, Blueprint]
    timing: Timing
    seeds: SpecSeeds
    provenance: Provenance

    @property
    def ego(self) -> Agent:
        """The connected vehicle that conflicts are staged for."""
        return next(agent for agent in self.agents if agent.is_ego)

    @model_validator(mode="after")
    def _check_agents(self) -> Self:
        for what in ("id", "number"):
            values = [getattr(agent, what) for agent in self.agents]
            if len(set(values)) < len(values):
                raise ValueError(f"two agents have the same {what}")
        egos = [agent for agent in self.agents if agent.is_ego]
        if len(egos) != 1:
            raise ValueError(f"{len(egos)} of the agents have the role 'ego'; one has it")
        return self


__all__ = ["SPEC_VERSION", "ActorClass", "Agent", "Spec"]
