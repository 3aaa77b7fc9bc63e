"""Draws a conflict's parameters; every number is a function of seed, key and name alone."""

from advercity_dsl.conflict import Parameters
from advercity_dsl.distribution import Choice, Distribution, Uniform

from advercity.compiler.distributions import number_from
from advercity.randomness import generator

DIGITS = 4


def sampled(parameters: Parameters, seed: int, key: str) -> dict[str, float]:
    """A number for every parameter but the range that the ego's speed is meant for."""
    return {
        name: _rounded(_drawn(item.draw, seed, key, name))
        for name in type(parameters).model_fields
        if name != "ego_speed_km_h" and (item := getattr(parameters, name)) is not None
    }


def ends(draw: float | Distribution) -> tuple[float, float]:
    """The least and the most that may be drawn."""
    if isinstance(draw, int | float):
        return float(draw), float(draw)
    if isinstance(draw, Choice):
        return min(draw.choice), max(draw.choice)
    return draw.uniform if isinstance(draw, Uniform) else draw.normal.within


def _drawn(draw: float | Distribution, seed: int, key: str, name: str) -> float:
    if isinstance(draw, int | float):
        return float(draw)
    return number_from(draw, generator(seed, "conflict", key, name))


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")
