"""The compiled scenario: versioned, self-contained, sufficient to regenerate its data."""

from typing import Annotated, Literal, Self

from pydantic import Field, StringConstraints, model_validator

from advercity_dsl.base import ByName, Digest, Id, Items, Model, is_empty
from advercity_dsl.catalogue import Blueprint
from advercity_dsl.channel import Channel
from advercity_dsl.conflict import StagedConflict
from advercity_dsl.distribution import Distribution
from advercity_dsl.rig import SensorSet
from advercity_dsl.road import ClassFractions, Road, RoadsideUnit, Vehicle
from advercity_dsl.suite import FieldPath, Timing
from advercity_dsl.traffic import (
    Density,
    DriverResponse,
    Drivers,
    ReactionConditions,
    TimedDriverResponse,
)
from advercity_dsl.units import Count, Fraction, Number, PositiveMetres, Seconds
from advercity_dsl.weather import Weather

SPEC_VERSION = 1
AssetName = Annotated[str, StringConstraints(pattern=r"^[a-z]+/[a-z][a-z0-9_]{0,63}$")]
"""Kind and name of an asset: `model/seat_leon`."""


class Agent(Model):
    """A connected vehicle or a roadside unit, with its sensors."""

    id: Id
    number: Annotated[int, Field(ge=-100_000, le=100_000)]
    """Id of the agent in annotations; negative for roadside units."""
    place: Annotated[Vehicle | RoadsideUnit, Field(discriminator="kind")]
    sensors: SensorSet
    blueprint: Id | None = None
    """Blueprint of a connected vehicle."""

    @property
    def is_ego(self) -> bool:
        """Whether it is the connected vehicle with staged conflicts."""
        return self.place.is_ego


class ClassDemand(Model):
    """Background traffic to spawn: numbers by kind, and where."""

    vehicles: Annotated[int, Field(ge=0, le=20_000)]
    walkers: Annotated[int, Field(ge=0, le=20_000)]
    crossing_share: Fraction
    classes: ClassFractions
    around_agent_m: PositiveMetres
    around_path_m: PositiveMetres
    speed_offset_percent: Annotated[Number, Field(ge=-100, le=100)]


class CrashGroup(Model):
    """A group of crash types staged by a scenario; its road was selected for it."""

    typology: Id
    crash_types: Items[str]


class SpecSeeds(Model):
    """Seeds of a scenario; `traffic` depends on road and density alone, never on the weather.

    `sensors` is combined with the spec's id wherever it is used.
    """

    traffic: Count
    sensors: Count
    weather: Count = 1  # specs from before distributions lack it


class SweepPoint(Model):
    """Field and value of a scenario in its suite's sweep."""

    field: FieldPath
    value: Number


class Settlement(Model):
    """Seed and waits found by simulation, in place of the declared ones."""

    traffic: Count
    """Seed of traffic, as of a suite."""
    waits_s: ByName[Seconds] = Field(default_factory=dict, exclude_if=is_empty)
    """Time for which connected vehicles wait at their start, where it is not the declared one."""
    attempts: Annotated[Count, Field(ge=1)]
    """Number of simulations until all conflicts happened."""


class Unrecorded(Model):
    """Sensors and agents that a run left out of a dataset."""

    sensors: Items[Id] = ()
    """Kinds of sensors removed from the agents."""
    agents: Items[Id] = ()
    """Agents that take part in traffic, without data of their own."""


class Provenance(Model):
    """Inputs of a compiled spec."""

    compiler: str
    suite: Id
    declarations: Annotated[dict[str, Digest], Field(max_length=1000)]
    """SHA-256 of every declaration used, by `kind/id`."""
    draws: dict[str, Distribution] = Field(default_factory=dict, max_length=1000)
    """Distributions behind the drawn numbers of the spec, by path of the number."""
    sweep: SweepPoint | Items[SweepPoint] | None = None
    """Field and value in the suite's sweep, or one for each of its sweeps."""
    conflict: Id | None = Field(default=None, exclude_if=is_empty)
    """Conflict crossed with the roads of the suite."""
    repeat: Count | None = Field(default=None, exclude_if=is_empty)
    """Number of the scenario among its repeats, which differ in traffic alone, from 1."""
    settled: Settlement | None = Field(default=None, exclude_if=is_empty)
    """Outcome of the search for traffic in which all conflicts happen; None without a search."""
    digest: Digest
    """SHA-256 of the spec itself, this field excluded."""

    @property
    def sweep_points(self) -> tuple[SweepPoint, ...]:
        """Fields and values in the suite's sweeps."""
        if isinstance(self.sweep, tuple):
            return self.sweep
        return () if self.sweep is None else (self.sweep,)


class Spec(Model):
    """A compiled scenario."""

    spec_version: Literal[1] = SPEC_VERSION
    id: Id
    groups: Items[CrashGroup]
    road: Road
    weather: Weather
    density: Density
    agents: Annotated[Items[Agent], Field(min_length=1)]
    demand: ClassDemand
    conflicts: Items[StagedConflict] = Field(default=(), exclude_if=is_empty)
    """Staged conflicts in the order in which they occur."""
    drivers: Drivers | None = Field(default=None, exclude_if=is_empty)
    """Reactions of drivers to weather; without them, weather does not change traffic."""
    caution: DriverResponse | None = Field(default=None, exclude_if=is_empty)
    """Response of the drivers to this weather."""
    caution_changes: Items[TimedDriverResponse] = Field(default=(), exclude_if=is_empty)
    """Their later responses to a changing weather, in order of time."""
    reaction: ReactionConditions | None = Field(default=None, exclude_if=is_empty)
    """Conditions of the ego's reaction to staged actors; None where it resolves no conflict."""
    channel: Channel | None = Field(default=None, exclude_if=is_empty)
    """V2X channel between the agents; None where they send no messages."""
    blueprints: ByName[Blueprint]
    assets: dict[AssetName, Digest] = Field(
        default_factory=dict[AssetName, Digest], exclude_if=is_empty, max_length=10_000
    )
    """SHA-256 of the scenario's foreign files, by `kind/name`: `model/seat_leon` is the converted
    model of the blueprint, `textures/ez_tree` the photographs of a package."""
    unrecorded: Unrecorded | None = Field(default=None, exclude_if=is_empty)
    """Sensors and agents that the run of a dataset left out; None in a compiled spec."""
    timing: Timing
    seeds: SpecSeeds
    provenance: Provenance

    @property
    def ego(self) -> Agent:
        """The connected vehicle with staged conflicts."""
        return next(agent for agent in self.agents if agent.is_ego)

    @property
    def recorded_agents(self) -> tuple[Agent, ...]:
        """The agents with data in a dataset."""
        left_out = self.unrecorded.agents if self.unrecorded else ()
        return tuple(agent for agent in self.agents if agent.id not in left_out)

    @model_validator(mode="after")
    def _check_agents(self) -> Self:
        for what in ("id", "number"):
            values = [getattr(agent, what) for agent in self.agents]
            if len(set(values)) < len(values):
                raise ValueError(f"two agents have the same {what}")
        egos = [agent for agent in self.agents if agent.is_ego]
        if len(egos) != 1:
            raise ValueError(f"{len(egos)} agents have the role 'ego'; exactly one is required")
        return self
