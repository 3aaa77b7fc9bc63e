"""Distributions in weathers: found in the data, validated at their bounds, drawn once per spec."""

import math
from collections.abc import Iterator, Mapping
from itertools import chain
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


def find_distributions(
    source: ResolvedDeclaration,
) -> tuple[dict[ValuePath, Distribution], dict[ValuePath, tuple[Diagnostic, ...]]]:
    """Find every distribution in a weather's data, by the path of the replaced number.

    Returns:
        The distributions, and the errors of those that are malformed or replace no number.
    """
    distributions: dict[ValuePath, Distribution] = {}
    malformed: dict[ValuePath, tuple[Diagnostic, ...]] = {}
    for value_path, name, written in _iterate_candidates(source.data):
        constraints = find_number_constraints(Weather, value_path)
        if constraints is None:
            message, hint = f"'{name}' is not allowed here", "distributions replace numbers"
            malformed[value_path] = (source.build_diagnostic(value_path, message, hint=hint),)
            continue
        model = DISTRIBUTIONS[name]
        try:
            plain = _strip_units(written, constraints)
            distributions[value_path] = model.model_validate(plain)
        except ValidationError as error:
            malformed[value_path] = tuple(build_diagnostics(model, source, error, at=value_path))
        except ValueError as error:
            malformed[value_path] = (source.build_diagnostic(value_path, str(error)),)
    return distributions, malformed


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


def build_typical_weather(
    source: ResolvedDeclaration,
) -> tuple[Weather, dict[ValuePath, Distribution]]:
    """Build a weather with typical values, and find its distributions.

    Raises:
        DiagnosticsError: A distribution is malformed, or the weather is not valid, or would not be
            with some draw.
    """
    distributions, malformed = find_distributions(source)
    typical = {path: _round_value(_get_typical_value(d), path) for path, d in distributions.items()}
    data = replace_values(source.data, typical)
    previous = (*source.document.diagnostics, *chain.from_iterable(malformed.values()))
    invalid = list(_find_invalid_bounds(source, distributions, typical))
    try:
        weather = validate_model(Weather, source, data, previous=previous, malformed=malformed)
    except DiagnosticsError as error:
        # The typical value is not in the file; a wrong bound of it is reported instead.
        reported = {item.value_path for item in invalid}
        others = [item for item in error.diagnostics if item.value_path not in reported]
        raise DiagnosticsError(*others, *invalid) from None
    if invalid:
        raise DiagnosticsError(*invalid)
    return weather, distributions


def _find_invalid_bounds(
    source: ResolvedDeclaration, distributions: Distributions, typical: Mapping[ValuePath, float]
) -> Iterator[Diagnostic]:
    """Find the first bound of each distribution at which the weather has errors of its own."""
    known = _find_problems(source, typical) if distributions else ()
    # One at a time: combinations of bounds would grow exponentially.
    for value_path, distribution in distributions.items():
        for bound in _get_bounds(distribution):
            drawn = {**typical, value_path: _round_value(bound, value_path)}
            found = [item for item in _find_problems(source, drawn) if item not in known]
            if found:
                message = f"{bound:g} may be drawn, which is not valid: {found[0].message}"
                yield source.build_diagnostic(value_path, message, hint=found[0].hint)
                break


def _find_problems(
    source: ResolvedDeclaration, drawn: Mapping[ValuePath, float]
) -> tuple[Diagnostic, ...]:
    try:
        validate_model(Weather, source, replace_values(source.data, drawn))
    except DiagnosticsError as error:
        return error.diagnostics
    return ()


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
