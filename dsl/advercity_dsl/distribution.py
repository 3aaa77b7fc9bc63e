"""Distributions in place of numbers of a weather or a conflict; each spec holds one draw."""

from typing import Annotated, Any, Self, cast

from pydantic import Discriminator, Field, Tag, model_validator

from advercity_dsl.base import Items, Model
from advercity_dsl.units import Number


class Uniform(Model):
    """Uniform distribution over an interval."""

    uniform: tuple[Number, Number]
    """Lowest and highest, `[50, 150]`."""

    @model_validator(mode="after")
    def _check_order(self) -> Self:
        low, high = self.uniform
        if low >= high:
            raise ValueError(f"{low:g} to {high:g} is not a range; write the lower number first")
        return self


class TruncatedNormal(Model):
    """Parameters of a normal distribution truncated at both ends."""

    mean: Number
    """Mean before truncation."""
    sd: Annotated[Number, Field(ge=1e-9)]
    """Standard deviation."""
    within: tuple[Number, Number]
    """Lowest and highest possible value."""

    @model_validator(mode="after")
    def _check_mean(self) -> Self:
        low, high = self.within
        if not low < high or not low <= self.mean <= high:
            raise ValueError(f"the mean {self.mean:g} is outside {low:g} to {high:g}")
        return self


class Normal(Model):
    """Truncated normal distribution."""

    normal: TruncatedNormal
    """Mean, standard deviation and bounds."""


class Choice(Model):
    """Uniform choice from a list."""

    choice: Annotated[Items[Number], Field(min_length=1, max_length=1000)]
    """Numbers to choose from, `[50, 75, 150]`."""


Distribution = Uniform | Normal | Choice
DISTRIBUTIONS: dict[str, type[Distribution]] = {
    "uniform": Uniform,
    "normal": Normal,
    "choice": Choice,
}
"""Model of each distribution, by its key in YAML."""


def compute_bounds(draw: float | Distribution) -> tuple[float, float]:
    """Compute the smallest and the largest possible draw."""
    if isinstance(draw, int | float):
        return float(draw), float(draw)
    if isinstance(draw, Choice):
        return min(draw.choice), max(draw.choice)
    return draw.uniform if isinstance(draw, Uniform) else draw.normal.within


def _find_distribution_key(value: object) -> str:
    """Return the key of a distribution, or `number` for anything else, as the union's tag."""
    if isinstance(value, Uniform | Normal | Choice):
        return next(iter(type(value).model_fields))
    if isinstance(value, dict) and len(written := cast(dict[Any, Any], value)) == 1:
        return str(next(iter(written)))
    return "number"


NumberOrDistribution = Annotated[
    Annotated[Number, Tag("number")]
    | Annotated[Uniform, Tag("uniform")]
    | Annotated[Normal, Tag("normal")]
    | Annotated[Choice, Tag("choice")],
    Discriminator(_find_distribution_key),
]
"""A number, or a distribution to draw it from.

The tag is explicit: errors name the distribution written by the author.
"""
