"""Pre-crash typologies: groups of crash types with the statistics that select them."""

from typing import Annotated, Literal

from pydantic import Field, StringConstraints

from advercity_dsl.base import Declaration, Flag, Model, Number, Percent

Evidence = Literal["A", "B", "C", "D", "U"]
"""A read directly, B two sources agree, C one secondary source, D inferred, U unverified."""


class CrashType(Model):
    """One crash type; its id names the edition, since editions reuse numbers."""

    id: Annotated[str, StringConstraints(pattern=r"^nhtsa(2007|2019):\d{1,2}$")]
    name: str
    definition: str = ""


class Statistics(Model):
    """Figures of a group of crash types."""

    weather_percent: Percent
    """Crashes with weather as a main factor."""
    bad_visibility_percent: Percent
    fatality_rate_percent: Percent
    vehicles_per_crash: Annotated[Number, Field(ge=1, le=5)]
    crash_share_percent: Percent
    """Share of all crashes, 2011 to 2015."""
    external_entity: Flag
    """Whether somebody or something other than a vehicle is struck."""
    evidence: Evidence = "A"


class JunctionShare(Model):
    """Share of a group's crashes at a kind of place, of those with the given manoeuvre."""

    junction: Literal["intersection", "non_junction"]
    manoeuvre: Literal["any", "with", "without"] = "any"
    percent: Percent


class RoadFacts(Model):
    """On what roads a group's crashes happen."""

    urban_percent: Percent
    rural_percent: Percent
    junctions: tuple[JunctionShare, ...]
    non_level_percent: Percent | None = None
    curved_percent: Percent | None = None


class Typology(Declaration):
    """A group of crash types that share statistics."""

    kind: Literal["typology"] = "typology"
    crash_types: Annotated[tuple[CrashType, ...], Field(min_length=1)]
    statistics: Statistics
    roads: RoadFacts | None = None
