"""Distributions in weathers: found in the data, checked at their ends, drawn once per spec."""

import math
from collections.abc import Callable, Iterator, Mapping
from statistics import NormalDist
from typing import Any, cast

import numpy as np
from advercity_dsl import Weather
from advercity_dsl.distribution import DISTRIBUTIONS, Choice, Distribution, Uniform
from pydantic import ValidationError

from advercity.compiler.extension import Resolved, replaced
from advercity.compiler.fields import facts_at
from advercity.compiler.problems import Problem, ProblemsError
from advercity.compiler.source import Where, dotted
from advercity.compiler.validation import problems_of, validate
from advercity.randomness import generator

DIGITS = 6
"""Significant digits of a draw."""
Distributions = Mapping[Where, Distribution]


def distributions_in(source: Resolved) -> dict[Where, Distribution]:
    """Every distribution in a weather's data, by the path of the number it stands for.

    Raises:
        ProblemsError: One is malformed, or stands where no number does.
    """
    found: dict[Where, Distribution] = {}
    problems: list[Problem] = []
    for where, written in _candidates(source.data, ()):
        facts = facts_at(Weather, where)
        (name,) = written
        if facts is None:
            hint = "distributions stand in place of a number"
            problems.append(source.problem(where, f"'{name}' does not stand here", hint=hint))
            continue
        try:
            plain = _without_units(written, facts.unit.read if facts.unit else _as_it_is)
            found[where] = DISTRIBUTIONS[name].model_validate(plain)
        except ValidationError as error:
            problems += problems_of(DISTRIBUTIONS[name], source, error, at=where)
        except ValueError as error:
            problems.append(source.problem(where, str(error)))
    if problems:
        raise ProblemsError(problems)
    return found


def _candidates(data: Any, where: Where) -> Iterator[tuple[Where, dict[str, Any]]]:
    if isinstance(data, dict):
        mapping = cast(dict[str, Any], data)
        if len(mapping) == 1 and next(iter(mapping)) in DISTRIBUTIONS:
            yield where, mapping
        else:
            for key, value in mapping.items():
                yield from _candidates(value, (*where, key))
    elif isinstance(data, list):
        for index, value in enumerate(cast(list[Any], data)):
            yield from _candidates(value, (*where, index))


def _as_it_is(value: Any) -> Any:
    return value


def _without_units(written: Any, read: Callable[[Any], Any]) -> Any:
    if isinstance(written, dict):
        items = cast(dict[str, Any], written).items()
        return {key: _without_units(value, read) for key, value in items}
    if isinstance(written, list):
        return [_without_units(value, read) for value in cast(list[Any], written)]
    return read(written)


def check_ends(source: Resolved, distributions: Distributions) -> Weather:
    """The weather with typical values, after trying the ends of each distribution.

    Raises:
        ProblemsError: The weather is not valid, or would not be with some draw.
    """
    typical = {where: _rounded(_typical(item), where) for where, item in distributions.items()}
    weather = validate(
        Weather, source, replaced(source.data, typical), known=source.document.problems
    )
    for where, item in distributions.items():
        for end in _ends(item):
            data = replaced(source.data, typical | {where: _rounded(end, where)})
            try:
                validate(Weather, source, data)
            except ProblemsError as error:
                problem = error.problems[0]
                message = f"may draw {end:g}, which does not fit: {problem.message}"
                raise ProblemsError.of(source.problem(where, message, hint=problem.hint)) from None
    return weather


def draw(source: Resolved, distributions: Distributions, seed: int, spec_id: str) -> Weather:
    """The weather of one spec: every number is a function of seed, spec and field alone."""
    drawn = {
        where: _rounded(
            number_from(item, generator(seed, "weather", spec_id, dotted(where))), where
        )
        for where, item in distributions.items()
    }
    return validate(Weather, source, replaced(source.data, drawn))


def number_from(item: Distribution, rng: np.random.Generator) -> float:
    """A number drawn from a distribution by one draw of `rng`."""
    if isinstance(item, Choice):
        return item.choice[int(rng.integers(len(item.choice)))]
    share = float(rng.random())
    if isinstance(item, Uniform):
        low, high = item.uniform
        return low + (high - low) * share
    bell = NormalDist(item.normal.mean, item.normal.sd)
    low, high = item.normal.within
    below, above = bell.cdf(low), bell.cdf(high)
    level = min(max(below + (above - below) * share, 1e-12), 1 - 1e-12)
    return min(max(bell.inv_cdf(level), low), high)


def _typical(item: Distribution) -> float:
    if isinstance(item, Choice):
        return item.choice[0]
    return sum(item.uniform) / 2 if isinstance(item, Uniform) else item.normal.mean


def _ends(item: Distribution) -> tuple[float, ...]:
    if isinstance(item, Choice):
        return item.choice
    return item.uniform if isinstance(item, Uniform) else item.normal.within


def _rounded(value: float, where: Where) -> float:
    facts = facts_at(Weather, where)
    if facts and facts.whole:
        return math.floor(value + 0.5)
    return float(f"{value:.{DIGITS}g}")
