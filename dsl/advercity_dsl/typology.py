"""Pre-crash typologies: groups of crash types with the statistics that select them."""

from typing import Annotated, Literal

from pydantic import BeforeValidator, Field, StringConstraints

from advercity_dsl.base import Declaration, InvalidCombination, Model
from advercity_dsl.units import Flag, Number, Percent

Evidence = Literal["A", "B", "C", "D", "U"]
"""A read directly, B two sources agree, C one secondary source, D inferred, U unverified."""


def _require_edition(value: object) -> object:
    number = str(value)
    if number.isdecimal():
        hint = f'write "nhtsa2019:{number}" or "nhtsa2007:{number}"; editions reuse numbers'
        raise InvalidCombination((), f"{number} names no edition", hint)
    return value


CrashTypeId = Annotated[
    str,
    BeforeValidator(_require_edition),
    StringConstraints(pattern=r"^nhtsa(2007|2019):\d{1,2}$"),
]
"""`nhtsa2019:30`; the editions give the same numbers to different things."""


class CrashType(Model):
    """One crash type; its id names the edition, since editions reuse numbers."""

    id: CrashTypeId
    """Edition and number, `nhtsa2019:19`; in quotes, since it holds a colon."""
    name: str
    """As the edition calls it."""
    definition: str = ""
    """What happens, in a sentence."""
    derived_from: tuple[CrashTypeId, ...] = ()
    """Crash types of the earlier edition that it stands for, in whole or in part."""


class EarlierCrashType(Model):
    """A crash type of the 2007 edition."""

    id: CrashTypeId
    """Edition and number, `nhtsa2007:21`."""
    name: str
    """As the edition calls it."""
    thousand_crashes_2004: Annotated[Number, Field(ge=0)]
    """Crashes in the United States in 2004, in thousands."""
    evidence: Evidence = "C"
    """How sure the figure is."""


class Statistics(Model):
    """Figures of a group of crash types."""

    weather_percent: Percent
    """Crashes with weather as a main factor."""
    bad_visibility_percent: Percent
    """Crashes with bad visibility as a main factor."""
    fatality_rate_percent: Percent
    """Of the crashes, as the report gives it."""
    vehicles_per_crash: Annotated[Number, Field(ge=1, le=5)]
    """On average; 1 is a crash with nobody else."""
    crash_share_percent: Percent
    """Share of all crashes, 2011 to 2015."""
    external_entity: Flag
    """Whether somebody or something other than a vehicle is struck."""
    evidence: Evidence = "A"
    """How sure the figures are: A read directly to D inferred, U unverified."""


class JunctionStatistics(Model):
    """Share of a group's crashes at a kind of place, of those with the given manoeuvre."""

    junction: Literal["intersection", "non_junction"]
    """At a junction, or away from any."""
    manoeuvre: Literal["any", "with", "without"] = "any"
    """Of crashes with the group's manoeuvre, without it, or of all."""
    percent: Percent
    """Their share."""


class RoadStatistics(Model):
    """On what roads a group's crashes happen."""

    urban_percent: Percent
    """In towns."""
    rural_percent: Percent
    """In the country."""
    junctions: tuple[JunctionStatistics, ...]
    """At junctions and away from them."""
    non_level_percent: Percent | None = None
    """On slopes; left out if nobody counted."""
    curved_percent: Percent | None = None
    """On curves; left out if nobody counted."""


class Typology(Declaration):
    """A group of crash types that share statistics."""

    kind: Literal["typology"] = "typology"
    crash_types: Annotated[tuple[CrashType, ...], Field(min_length=1)]
    """What the group consists of."""
    earlier: tuple[EarlierCrashType, ...] = ()
    """What the 2007 edition had in their place."""
    statistics: Statistics | None = None
    """What suites select by."""
    roads: RoadStatistics | None = None
    """What decides which roads the group calls for; left out, none."""
