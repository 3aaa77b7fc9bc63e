"""Distributions in place of a number in a weather or a conflict; each spec holds one draw."""

from typing import Annotated, Any, Self, cast

from pydantic import Discriminator, Field, Tag, model_validator

from advercity_dsl.base import Model
from advercity_dsl.units import Number


class Uniform(Model):
    """Every number between two is as likely as any other."""

    uniform: tuple[Number, Number]
    """Lowest and highest, `[50, 150]`."""

    @model_validator(mode="after")
    def _check_order(self) -> Self:
        low, high = self.uniform
        if low >= high:
            raise ValueError(f"{low:g} to {high:g} is no range; write the lower number first")
        return self


class TruncatedNormal(Model):
    """A normal distribution, cut off at both ends."""

    mean: Number
    """Where the middle lies."""
    sd: Annotated[Number, Field(gt=0)]
    """Standard deviation."""
    within: tuple[Number, Number]
    """Nothing outside of these is drawn; a bell has no ends of its own."""

    @model_validator(mode="after")
    def _check_mean(self) -> Self:
        low, high = self.within
        if not low < high or not low <= self.mean <= high:
            raise ValueError(f"the mean {self.mean:g} does not lie within {low:g} to {high:g}")
        return self


class Normal(Model):
    """Numbers near the mean are likelier."""

    normal: TruncatedNormal
    """Mean, standard deviation and ends."""


class Choice(Model):
    """One of a list, each as likely as any other."""

    choice: Annotated[tuple[Number, ...], Field(min_length=1, max_length=1000)]
    """The numbers, `[50, 75, 150]`."""


Distribution = Uniform | Normal | Choice
DISTRIBUTIONS: dict[str, type[Distribution]] = {
    "uniform": Uniform,
    "normal": Normal,
    "choice": Choice,
}
"""The model of each by the key that it is written with."""


def _find_distribution_key(value: object) -> str:
    """The key that a distribution is written with; whatever else there is should be a number."""
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
"""A number, or a distribution to draw it from."""
