"""Density of traffic, and how drivers respond to weather."""

from collections.abc import Sequence
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from advercity_dsl.base import Declaration, InvalidCombination, Items, Model, is_empty, is_none
from advercity_dsl.typology import Evidence
from advercity_dsl.units import (
    Flag,
    Fraction,
    KilometresPerHour,
    MillimetresPerHour,
    Number,
    Percent,
    PositiveMetres,
    RangeReason,
    Seconds,
)

ActorClass = Literal["car", "van", "truck", "bicycle", "motorcycle", "pedestrian"]
DemandFactor = Annotated[
    Number, Field(ge=0, le=20), RangeReason("no road has room for more than 20 times its demand")
]


SpeedLimit = Annotated[KilometresPerHour, Field(ge=10, le=200)]


class SpeedLimits(Model):
    """Speed limits by land use."""

    urban: SpeedLimit
    """Limit in towns."""
    rural: SpeedLimit
    """Outside of towns."""


class Density(Declaration):
    """Amount of traffic, as multiples of the road's own demand."""

    kind: Literal["density"] = "density"
    vehicles: DemandFactor
    """Factor on the road's `traffic.vehicles_per_area`."""
    walkers: DemandFactor
    """Factor on the road's `traffic.walkers`."""
    speed_limits_km_h: SpeedLimits | None = Field(default=None, exclude_if=is_none)
    """Limits of all streets and connected vehicles in place of the road's own."""
    least_speed_share: Fraction = Field(default=0.0, exclude_if=is_empty)
    """Least speed of the ego and of an actor in lanes before they meet, as a fraction of the
    highest that the road and the conflict permit."""


FrictionCoefficient = Annotated[
    Number,
    Field(gt=0, le=1.2),
    RangeReason("tyres grip with less than 1.2 of the wheel's load, even on dry asphalt"),
]


class ResponseStep(Model):
    """Response of drivers at one intensity; linear between two steps."""

    slower_percent: Annotated[Percent, Field(lt=100)] = 0
    """Reduction of speed against clear weather."""
    headway_s: Annotated[Seconds, Field(ge=0, le=10)] = 0
    """Additional time headway to the vehicle ahead."""
    source: str = ""
    """Source of the figures; without one they are an assumption."""
    evidence: Evidence = "D"
    """Strength of the evidence: A read directly to D inferred, U unverified."""


class RainStep(ResponseStep):
    """Response to rain."""

    rate_mm_h: MillimetresPerHour
    """Rate of the rain."""


class SnowfallStep(ResponseStep):
    """Response to snowfall."""

    rate_mm_h: MillimetresPerHour
    """Rate of the snowfall as melted water."""


class SnowCoverStep(ResponseStep):
    """Response to snow on the road."""

    road_coverage: Fraction
    """Fraction of the carriageway covered by snow."""


class VisibilityStep(ResponseStep):
    """Response to haze, fog or dust; rain and snow have their own tables."""

    mor_m: Annotated[PositiveMetres, Field(ge=1)]
    """Visibility (5 % contrast)."""


DEFAULT_ICE_FRICTION = 0.1
"""Usual for bare ice in reconstructions (SAE 960959); 0.09 was measured at -6 degC (SAE 960652).
Omitted from JSON, to keep earlier specs unchanged."""


class TyreFriction(Model):
    """Friction between tyres and road, and the fraction of it used by drivers."""

    dry: FrictionCoefficient
    """Coefficient of friction on a dry road."""
    wet: FrictionCoefficient
    """Coefficient on a soaked road; in between it falls linearly with `surface.wetness`."""
    snow: FrictionCoefficient
    """Coefficient on snow; averaged with the bare road by `snow.rut_coverage`."""
    ice: FrictionCoefficient = Field(
        default=DEFAULT_ICE_FRICTION, exclude_if=lambda value: value == DEFAULT_ICE_FRICTION
    )
    """Coefficient on clear ice; averaged with the rest by the part covered by `surface.ice_mm`."""
    used_share: Annotated[Fraction, Field(gt=0)]
    """Fraction of it used to accelerate, brake and corner, except in an emergency."""
    source: str = ""
    """Source of the figures."""
    evidence: Evidence = "D"
    """Strength of the evidence."""


class Drivers(Declaration):
    """How drivers react to weather.

    A table has no effect below its first step and is constant above its last. If several tables
    apply, the strongest response counts, since each was observed with the other effects present.
    """

    kind: Literal["drivers"] = "drivers"
    rain: Items[RainStep] = ()
    """Steps by rate of rain, the lightest first."""
    snowfall: Items[SnowfallStep] = ()
    """Steps by rate of snowfall, the lightest first."""
    snow_cover: Items[SnowCoverStep] = ()
    """Steps by snow on the road, the least first."""
    visibility: Items[VisibilityStep] = ()
    """Steps by visibility, the farthest first."""
    grip: TyreFriction
    """Friction, which limits acceleration."""

    @model_validator(mode="after")
    def _check_tables(self) -> Self:
        # Interpolation needs rising intensities; falling visibility is a rising effect.
        _check_table_order("rain", [step.rate_mm_h for step in self.rain])
        _check_table_order("snowfall", [step.rate_mm_h for step in self.snowfall])
        _check_table_order("snow_cover", [step.road_coverage for step in self.snow_cover])
        _check_table_order("visibility", [-step.mor_m for step in self.visibility])
        return self


def _check_table_order(table: str, intensities: Sequence[float]) -> None:
    for index in range(1, len(intensities)):
        if intensities[index] <= intensities[index - 1]:
            what = f"is not worse than the step before: {abs(intensities[index]):g}"
            raise InvalidCombination(
                (table, index), what, "order steps from the mildest to the worst"
            )


class DriverResponse(Model):
    """Response of drivers to the weather of one scenario."""

    speed_share: Annotated[Number, Field(gt=0, le=1)]
    """Speed as a fraction of the speed in clear weather."""
    headway_s: Annotated[Seconds, Field(ge=0, le=10)]
    """Additional time headway to the vehicle ahead."""
    usual_m_s2: Annotated[Number, Field(gt=0, le=20)]
    """Highest acceleration, deceleration and lateral acceleration in normal driving."""
    hardest_m_s2: Annotated[Number, Field(gt=0, le=20)]
    """Highest deceleration in an emergency."""


class ReactionConditions(Model):
    """Sight and grip with which the ego reacts to a staged actor."""

    is_paired: Flag = False
    """Whether they are the same in all weathers of a suite, in place of each scenario's own."""
    visibility_m: PositiveMetres | None = None
    """Distance at which it sees the actor; None is unlimited."""
    friction: FrictionCoefficient
    """Coefficient of friction of its tyres."""


class TimedDriverResponse(DriverResponse):
    """Response of drivers from a time on, as the weather changes."""

    at_s: Annotated[Seconds, Field(gt=0)]
    """Time since the first recorded frame."""
