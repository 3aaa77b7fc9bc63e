"""Cross-sections: what lies beside a street's axis, strip by strip."""

from enum import StrEnum
from typing import Annotated, Self

from pydantic import Field, model_validator

from advercity_dsl.base import Model, PositiveMetres, Terse, is_none


class StripKind(StrEnum):
    """What a strip of a cross-section is for."""

    LANE = "lane"
    PARKING = "parking"
    SHOULDER = "shoulder"
    EDGE = "edge"
    MEDIAN = "median"
    VERGE = "verge"
    SIDEWALK = "sidewalk"


class Paint(StrEnum):
    """A painted line."""

    SOLID_WHITE = "solid_white"
    BROKEN_WHITE = "broken_white"
    SOLID_YELLOW = "solid_yellow"
    BROKEN_YELLOW = "broken_yellow"
    DOUBLE_YELLOW = "double_yellow"


class Strip(Terse):
    """A band along a street, as wide as it says, and the line painted on its outer border."""

    kind: StripKind
    """What it is for."""
    width_m: Annotated[PositiveMetres, Field(le=60)]
    """Its width."""
    line: Paint | None = None
    """What is painted on its outer border."""
    bay_m: PositiveMetres | None = Field(default=None, exclude_if=is_none)
    """Width of parking bays, which lines across the strip divide; cars stand across it."""

    @model_validator(mode="after")
    def _has_bays_to_park_in(self) -> Self:
        if self.bay_m is not None and self.kind is not StripKind.PARKING:
            raise ValueError("only a parking strip has bays")
        return self


class CrossSection(Model):
    """Strips on either side of the axis, from the axis outwards.

    Lanes on the right run along the axis, lanes on the left against it. Lane 1 is the innermost.
    """

    left: tuple[Strip, ...] = ()
    """Strips on the left, from the axis outwards."""
    right: tuple[Strip, ...] = ()
    """Strips on the right, from the axis outwards."""
    axis_line: Paint | None = None
    """What is painted on the axis."""
