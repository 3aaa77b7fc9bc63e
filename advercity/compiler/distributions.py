"""Distributions in weathers: found in the data, validated at their bounds, drawn once per spec."""

import math
from collections.abc import Iterator, Mapping
from typing import Any, cast

from advercity_dsl import Weather
from advercity_dsl.base import ValuePath
from advercity_dsl.distribution import DISTRIBUTIONS, Choice, Distribution, Uniform
from pydantic import ValidationError

from advercity.compiler.extends import ResolvedDeclaration
from advercity.compiler.fields import NumberConstraints, find_number_constraints
from advercity.compiler.source import format_value_path, iterate_values, replace_values
from advercity.compiler.validation import build_diagnostics, validate_model
from advercity.diagnostics import Diagnostic, DiagnosticsError
from advercity.randomness import create_generator, draw_number

DRAW_DIGITS = 6
"""Significant digits of a drawn number."""
Distributions = Mapping[ValuePath, Distribution]


def find_distributions(source: ResolvedDeclaration) -> dict[ValuePath, Distribution]:
    """Return every distribution in a weather's data, by the path of the number that it replaces.

    Raises:
        DiagnosticsError: A distribution is malformed, or does not replace a number.
    """
    distributions: dict[ValuePath, Distribution] = {}
    diagnostics: list[Diagnostic] = []
    for value_path, name, written in _iterate_candidates(source.data):
        constraints = find_number_constraints(Weather, value_path)
        if constraints is None:
            message, hint = f"'{name}' is not allowed here", "distributions replace numbers"
            diagnostics.append(source.build_diagnostic(value_path, message, hint=hint))
            continue
        try:
            plain = _strip_units(written, constraints)
            distributions[value_path] = DISTRIBUTIONS[name].model_validate(plain)
        except ValidationError as error:
            diagnostics += build_diagnostics(DISTRIBUTIONS[name], source, error, at=value_path)
        except ValueError as error:
            diagnostics.append(source.build_diagnostic(value_path, str(error)))
    if diagnostics:
        raise DiagnosticsError(*diagnostics)
    return distributions


def _iterate_candidates(data: Any) -> Iterator[tuple[ValuePath, str, dict[str, Any]]]:
    """Yield path, key and data of mappings with the key of a distribution as their only one."""
    for value_path, value in iterate_values(data):
        if isinstance(value, dict) and len(mapping := cast(dict[str, Any], value)) == 1:
            (name,) = mapping
            if name in DISTRIBUTIONS:
                yield value_path, name, mapping


def _strip_units(written: Any, constraints: NumberConstraints) -> Any:
    if isinstance(written, dict):
        items = cast(dict[str, Any], written).items()
        return {key: _strip_units(value, constraints) for key, value in items}
    if isinstance(written, list):
        return [_strip_units(value, constraints) for value in cast(list[Any], written)]
    return constraints.parse(written)


def validate_distribution_bounds(
    source: ResolvedDeclaration, distributions: Distributions
) -> Weather:
    """Return the weather with typical values, after validating it at each distribution's bounds.

    Raises:
        DiagnosticsError: The weather is not valid, or would not be with some draw.
    """
    typical = {path: _round_value(_get_typical_value(d), path) for path, d in distributions.items()}
    data = replace_values(source.data, typical)
    weather = validate_model(Weather, source, data, previous=source.document.diagnostics)
    # One at a time: combinations of bounds would grow exponentially.
    for value_path, distribution in distributions.items():
        for bound in _get_bounds(distribution):
            drawn = typical | {value_path: _round_value(bound, value_path)}
            try:
                validate_model(Weather, source, replace_values(source.data, drawn))
            except DiagnosticsError as error:
                first = error.diagnostics[0]
                message = f"{bound:g} may be drawn, which is not valid: {first.message}"
                raise DiagnosticsError(
                    source.build_diagnostic(value_path, message, hint=first.hint)
                ) from None
    return weather


def draw_weather(
    source: ResolvedDeclaration, distributions: Distributions, seed: int, spec_id: str
) -> Weather:
    """Draw the weather of a spec; each number depends on seed, spec id and its path alone."""
    drawn: dict[ValuePath, float] = {}
    for value_path, distribution in distributions.items():
        rng = create_generator(seed, "weather", spec_id, format_value_path(value_path))
        drawn[value_path] = _round_value(draw_number(distribution, rng), value_path)
    return validate_model(Weather, source, replace_values(source.data, drawn))


def _get_typical_value(distribution: Distribution) -> float:
    if isinstance(distribution, Choice):
        return distribution.choice[0]
    if isinstance(distribution, Uniform):
        return sum(distribution.uniform) / 2
    return distribution.normal.mean


def _get_bounds(distribution: Distribution) -> tuple[float, ...]:
    if isinstance(distribution, Choice):
        return distribution.choice
    if isinstance(distribution, Uniform):
        return distribution.uniform
    return distribution.normal.within


def _round_value(value: float, value_path: ValuePath) -> float:
    constraints = find_number_constraints(Weather, value_path)
    if constraints and constraints.whole:
        # Halves round up; round() would favour even numbers.
        return math.floor(value + 0.5)
    # Fewer digits make specs readable and hide differences between math libraries.
    return float(f"{value:.{DRAW_DIGITS}g}")
