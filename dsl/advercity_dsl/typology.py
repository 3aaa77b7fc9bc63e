"""Pre-crash typologies: groups of crash types with the statistics to select them by."""

from typing import Annotated, Literal

from pydantic import BeforeValidator, Field, StringConstraints

from advercity_dsl.base import Declaration, InvalidCombination, Items, Model
from advercity_dsl.units import Flag, Number, Percent

Evidence = Literal["A", "B", "C", "D", "U"]
"""A read directly, B two sources agree, C one secondary source, D inferred, U unverified."""


def _require_edition(value: object) -> object:
    # Both editions number from 1: a bare number would silently name another crash type.
    number = str(value)
    if number.isdecimal():
        hint = f'write "nhtsa2019:{number}" or "nhtsa2007:{number}"; editions reuse numbers'
        raise InvalidCombination((), f"{number} does not name an edition", hint)
    return value


CrashTypeId = Annotated[
    str,
    BeforeValidator(_require_edition),
    StringConstraints(pattern=r"^nhtsa(2007|2019):\d{1,2}$"),
]
"""`nhtsa2019:30`; the editions use the same numbers for different crash types."""


class CrashType(Model):
    """One crash type; its id names the edition, since editions reuse numbers."""

    id: CrashTypeId
    """Edition and number, `nhtsa2019:19`; in quotes, since it holds a colon."""
    name: str
    """Name in the edition."""
    definition: str = ""
    """Definition in a sentence."""
    derived_from: Items[CrashTypeId] = ()
    """Crash types of the earlier edition replaced by it, in whole or in part."""


class EarlierCrashType(Model):
    """A crash type of the 2007 edition."""

    id: CrashTypeId
    """Edition and number, `nhtsa2007:21`."""
    name: str
    """Name in the edition."""
    thousand_crashes_2004: Annotated[Number, Field(ge=0, le=1_000_000)]
    """Crashes in the United States in 2004, in thousands."""
    evidence: Evidence = "C"
    """Strength of the evidence."""


class Statistics(Model):
    """Statistics of a group of crash types."""

    weather_percent: Percent
    """Crashes with weather as a main factor."""
    bad_visibility_percent: Percent
    """Crashes with bad visibility as a main factor."""
    fatality_rate_percent: Percent
    """Fatal crashes, as the report gives them."""
    vehicles_per_crash: Annotated[Number, Field(ge=1, le=5)]
    """Mean number of vehicles; 1 is a crash of a single vehicle."""
    crash_share_percent: Percent
    """Percentage of all crashes, 2011 to 2015."""
    external_entity: Flag
    """Whether a person or an object other than a vehicle is struck."""
    evidence: Evidence = "A"
    """Strength of the evidence: A read directly to D inferred, U unverified."""


class JunctionStatistics(Model):
    """Percentage of a group's crashes at a kind of place, among those with a manoeuvre."""

    junction: Literal["intersection", "non_junction"]
    """At a junction, or away from any."""
    manoeuvre: Literal["any", "with", "without"] = "any"
    """Base of the percentage: crashes with the group's manoeuvre, without it, or all."""
    percent: Percent
    """Percentage of those crashes."""


class RoadStatistics(Model):
    """Kinds of roads on which a group's crashes happen."""

    urban_percent: Percent
    """Percentage in urban areas."""
    rural_percent: Percent
    """Percentage in rural areas."""
    junctions: Items[JunctionStatistics]
    """Percentages at junctions and away from them."""
    non_level_percent: Percent | None = None
    """Percentage on slopes, if known."""
    curved_percent: Percent | None = None
    """Percentage on curves, if known."""


class Typology(Declaration):
    """A group of crash types with shared statistics."""

    kind: Literal["typology"] = "typology"
    crash_types: Annotated[Items[CrashType], Field(min_length=1)]
    """Crash types of the group."""
    earlier: Items[EarlierCrashType] = ()
    """Corresponding crash types of the 2007 edition."""
    statistics: Statistics | None = None
    """Figures by which suites select groups."""
    roads: RoadStatistics | None = None
    """Figures for the choice of the group's roads; without them, none are required."""
