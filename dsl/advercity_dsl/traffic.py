"""How much traffic there is, and of which classes.

Drivers: what they do about the weather, as tables over what they see and drive on.
"""

from collections.abc import Sequence
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from advercity_dsl.base import Declaration, InvalidCombination, Model
from advercity_dsl.typology import Evidence
from advercity_dsl.units import (
    Fraction,
    Metres,
    MillimetresPerHour,
    Number,
    Percent,
    RangeReason,
    Seconds,
)

ActorClass = Literal["car", "van", "truck", "bicycle", "motorcycle", "pedestrian"]
DemandFactor = Annotated[
    Number, Field(ge=0, le=20), RangeReason("a road has no room for more than 20 times its demand")
]


class Density(Declaration):
    """How much traffic there is, as multiples of the road's own demand."""

    kind: Literal["density"] = "density"
    vehicles: DemandFactor
    """Of the road's `traffic.vehicles_per_area`."""
    walkers: DemandFactor
    """Of the road's `traffic.walkers`."""


FrictionCoefficient = Annotated[
    Number,
    Field(gt=0, le=1.2),
    RangeReason("rubber holds with less than 1.2 of the wheel's load, even on dry asphalt"),
]


class ResponseStep(Model):
    """What drivers do from some intensity on; between two steps it changes evenly."""

    slower_percent: Annotated[Percent, Field(lt=100)] = 0
    """How much slower they drive than they would in clear weather."""
    headway_s: Annotated[Seconds, Field(ge=0, le=10)] = 0
    """How much more time they leave to whom they follow."""
    source: str = ""
    """Where it comes from; what has no source is an assumption."""
    evidence: Evidence = "D"
    """How sure it is: A read directly to D inferred, U unverified."""


class RainStep(ResponseStep):
    """In rain of a rate."""

    rate_mm_h: Annotated[MillimetresPerHour, Field(ge=0)]
    """Of the rain."""


class SnowfallStep(ResponseStep):
    """In snowfall of a rate."""

    rate_mm_h: Annotated[MillimetresPerHour, Field(ge=0)]
    """Of melted water."""


class SnowCoverStep(ResponseStep):
    """On a road that snow lies on."""

    road_coverage: Fraction
    """Share of the carriageway under snow."""


class VisibilityStep(ResponseStep):
    """In haze, fog or dust; rain and snow have steps of their own."""

    mor_m: Annotated[Metres, Field(gt=0)]
    """Visibility (5 % contrast)."""


class TyreFriction(Model):
    """What tyres hold on, and how much of it drivers use."""

    dry: FrictionCoefficient
    """Coefficient of friction on a dry road."""
    wet: FrictionCoefficient
    """On one that is soaked; in between it falls with `surface.wetness`."""
    snow: FrictionCoefficient
    """On snow; of ruts that are partly clear it is the mean, by `snow.rut_coverage`."""
    used_share: Annotated[Fraction, Field(gt=0)]
    """Share of it that drivers use to speed up, to brake and in bends, but in an emergency."""
    source: str = ""
    """Where the figures come from."""
    evidence: Evidence = "D"
    """How sure they are."""


class Drivers(Declaration):
    """How drivers react to weather.

    A table has no effect before its first step and stays at its last. Where several apply, the
    strongest counts, since each was observed with the others about.
    """

    kind: Literal["drivers"] = "drivers"
    rain: tuple[RainStep, ...] = ()
    """By how hard it rains, the lightest first."""
    snowfall: tuple[SnowfallStep, ...] = ()
    """By how hard it snows, the lightest first."""
    snow_cover: tuple[SnowCoverStep, ...] = ()
    """By how much of the road is white, the least first."""
    visibility: tuple[VisibilityStep, ...] = ()
    """By how far one sees, the farthest first."""
    grip: TyreFriction
    """On what they brake."""

    @model_validator(mode="after")
    def _check_tables(self) -> Self:
        _check_table_order("rain", [step.rate_mm_h for step in self.rain])
        _check_table_order("snowfall", [step.rate_mm_h for step in self.snowfall])
        _check_table_order("snow_cover", [step.road_coverage for step in self.snow_cover])
        _check_table_order("visibility", [-step.mor_m for step in self.visibility])
        return self


def _check_table_order(table: str, intensities: Sequence[float]) -> None:
    for index in range(1, len(intensities)):
        if intensities[index] <= intensities[index - 1]:
            what = f"is no worse than the step before: {abs(intensities[index]):g}"
            raise InvalidCombination(
                (table, index), what, "order steps from the mildest to the worst"
            )


class DriverResponse(Model):
    """What drivers do about the weather of one scenario."""

    speed_share: Annotated[Number, Field(gt=0, le=1)]
    """Of the speed that they would drive in clear weather."""
    headway_s: Annotated[Seconds, Field(ge=0)]
    """How much more time they leave to whom they follow."""
    usual_m_s2: Annotated[Number, Field(gt=0)]
    """Most that they speed up, brake and go round bends with."""
    hardest_m_s2: Annotated[Number, Field(gt=0)]
    """Most that they brake with in an emergency."""
