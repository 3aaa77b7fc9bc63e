"""Distributions in weathers: found in the data, checked at their ends, drawn once per spec."""

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any, cast

from advercity_dsl import Weather
from advercity_dsl.distribution import DISTRIBUTIONS, Choice, Distribution, Uniform
from pydantic import ValidationError

from advercity.compiler.diagnostics import Diagnostic, DiagnosticsError
from advercity.compiler.extends import ResolvedDeclaration, replace_values
from advercity.compiler.fields import find_number_constraints
from advercity.compiler.source import ValuePath, format_value_path
from advercity.compiler.validation import build_diagnostics, validate_model
from advercity.randomness import create_generator, draw_number

DRAW_DIGITS = 6
"""Significant digits of a draw."""
Distributions = Mapping[ValuePath, Distribution]


def find_distributions(source: ResolvedDeclaration) -> dict[ValuePath, Distribution]:
    """Every distribution in a weather's data, by the path of the number it stands for.

    Raises:
        ProblemsError: One is malformed, or stands where no number does.
    """
    found: dict[ValuePath, Distribution] = {}
    problems: list[Diagnostic] = []
    for where, written in _iterate_candidates(source.data, ()):
        facts = find_number_constraints(Weather, where)
        (name,) = written
        if facts is None:
            hint = "distributions stand in place of a number"
            problems.append(
                source.build_diagnostic(where, f"'{name}' does not stand here", hint=hint)
            )
            continue
        try:
            plain = _strip_units(written, facts.unit.parse if facts.unit else _return_unchanged)
            found[where] = DISTRIBUTIONS[name].model_validate(plain)
        except ValidationError as error:
            problems += build_diagnostics(DISTRIBUTIONS[name], source, error, at=where)
        except ValueError as error:
            problems.append(source.build_diagnostic(where, str(error)))
    if problems:
        raise DiagnosticsError(problems)
    return found


def _iterate_candidates(data: Any, where: ValuePath) -> Iterator[tuple[ValuePath, dict[str, Any]]]:
    if isinstance(data, dict):
        mapping = cast(dict[str, Any], data)
        if len(mapping) == 1 and next(iter(mapping)) in DISTRIBUTIONS:
            yield where, mapping
        else:
            for key, value in mapping.items():
                yield from _iterate_candidates(value, (*where, key))
    elif isinstance(data, list):
        for index, value in enumerate(cast(list[Any], data)):
            yield from _iterate_candidates(value, (*where, index))


def _return_unchanged(value: Any) -> Any:
    return value


def _strip_units(written: Any, read: Callable[[Any], Any]) -> Any:
    if isinstance(written, dict):
        items = cast(dict[str, Any], written).items()
        return {key: _strip_units(value, read) for key, value in items}
    if isinstance(written, list):
        return [_strip_units(value, read) for value in cast(list[Any], written)]
    return read(written)


def validate_distribution_bounds(
    source: ResolvedDeclaration, distributions: Distributions
) -> Weather:
    """The weather with typical values, after trying the ends of each distribution.

    Raises:
        ProblemsError: The weather is not valid, or would not be with some draw.
    """
    typical = {
        where: _round_value(_get_typical_value(item), where)
        for where, item in distributions.items()
    }
    weather = validate_model(
        Weather, source, replace_values(source.data, typical), known=source.document.diagnostics
    )
    for where, item in distributions.items():
        for end in _get_bounds(item):
            data = replace_values(source.data, typical | {where: _round_value(end, where)})
            try:
                validate_model(Weather, source, data)
            except DiagnosticsError as error:
                problem = error.diagnostics[0]
                message = f"may draw {end:g}, which does not fit: {problem.message}"
                raise DiagnosticsError.from_diagnostic(
                    source.build_diagnostic(where, message, hint=problem.hint)
                ) from None
    return weather


def draw_weather(
    source: ResolvedDeclaration, distributions: Distributions, seed: int, spec_id: str
) -> Weather:
    """The weather of one spec: every number is a function of seed, spec and field alone."""
    drawn = {
        where: _round_value(
            draw_number(item, create_generator(seed, "weather", spec_id, format_value_path(where))),
            where,
        )
        for where, item in distributions.items()
    }
    return validate_model(Weather, source, replace_values(source.data, drawn))


def _get_typical_value(item: Distribution) -> float:
    if isinstance(item, Choice):
        return item.choice[0]
    return sum(item.uniform) / 2 if isinstance(item, Uniform) else item.normal.mean


def _get_bounds(item: Distribution) -> tuple[float, ...]:
    if isinstance(item, Choice):
        return item.choice
    return item.uniform if isinstance(item, Uniform) else item.normal.within


def _round_value(value: float, where: ValuePath) -> float:
    facts = find_number_constraints(Weather, where)
    if facts and facts.whole:
        return math.floor(value + 0.5)
    return float(f"{value:.{DRAW_DIGITS}g}")
