"""What a suite does to the plain cross: conditions that thin it out, a sweep that multiplies it."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from advercity_dsl import Catalogue, Density, Model, Rig, Road, Suite, Weather
from advercity_dsl.suite import Range, Sweep

from advercity.compiler.extension import Resolved
from advercity.compiler.fields import Facts, facts_at, field_names
from advercity.compiler.problems import Problem, ProblemsError, nearest
from advercity.compiler.source import Where

CROSSED: dict[str, type[Model]] = {
    "weather": Weather,
    "road": Road,
    "density": Density,
    "rig": Rig,
    "catalogue": Catalogue,
}
DIGITS = 3
"""Significant digits of a step between the ends of a sweep."""


@dataclass(frozen=True)
class Step:
    """One value of a sweep."""

    field: str
    value: float

    @property
    def kind(self) -> str:
        """Kind of the declaration that it changes."""
        return self.field.split(".")[0]

    @property
    def where(self) -> Where:
        """Path of the field in that declaration."""
        return path_of(self.field)[1]

    @property
    def suffix(self) -> str:
        """`mor_m_75`: end of the scenario's id; a point is `p`, a minus `n`."""
        number = f"{self.value:.6g}".replace("e+0", "e").replace("e-0", "en").replace("+", "")
        return f"{self.where[-1]}_{number.replace('.', 'p').replace('-', 'n')}"


@dataclass(frozen=True)
class Condition:
    """What one line of a suite's `where` asks for."""

    kind: str
    where: Where
    allowed: tuple[Any, ...] | tuple[float | None, float | None]
    in_range: bool

    def holds(self, scene: Mapping[str, Model]) -> bool:
        """Whether the declarations of a scenario, by kind, meet it."""
        value = _value_at(scene[self.kind], self.where)
        if not self.in_range:
            return value in self.allowed
        if not isinstance(value, int | float):
            return False
        low, high = self.allowed
        return (low is None or value >= low) and (high is None or value <= high)


def path_of(field: str) -> tuple[str, Where]:
    """`weather.fog.mor_m` as kind and path."""
    kind, *parts = field.split(".")
    return kind, tuple(int(part) if part.isdigit() else part for part in parts)


def conditions(suite: Suite, source: Resolved) -> list[Condition]:
    """What the suite's `where` asks for.

    Raises:
        ProblemsError: A field is not there, or a value has a wrong unit.
    """
    found: list[Condition] = []
    problems: list[Problem] = []
    for field, asked in suite.where.items():
        kind, where = path_of(field)
        at = ("where", field)
        hint = _unknown(kind, where)
        if hint is not None:
            problems.append(source.problem(at, "no such field", hint=hint, key=True))
            continue
        facts = facts_at(CROSSED[kind], where)
        try:
            if isinstance(asked, Range):
                ends = (_read(facts, asked.at_least), _read(facts, asked.at_most))
                found.append(Condition(kind, where, ends, in_range=True))
            else:
                written = asked if isinstance(asked, tuple) else (asked,)
                values = tuple(_read(facts, value) for value in written)
                found.append(Condition(kind, where, values, in_range=False))
        except ValueError as error:
            problems.append(source.problem(at, str(error)))
    if problems:
        raise ProblemsError(problems)
    return found


def steps(suite: Suite, source: Resolved) -> list[Step | None]:
    """The values of the suite's sweep; one None where there is no sweep.

    Raises:
        ProblemsError: The field is no number, or a value has a wrong unit.
    """
    sweep = suite.sweep
    if sweep is None:
        return [None]
    kind, where = path_of(sweep.field)
    facts = facts_at(CROSSED[kind], where)
    if facts is None:
        unknown = _unknown(kind, where)
        message = "is no number" if unknown is None else "no such field"
        hint = unknown or "a sweep takes a number through values"
        raise ProblemsError.of(source.problem(("sweep", "field"), message, hint=hint))
    try:
        values = _values(sweep, facts)
    except ValueError as error:
        raise ProblemsError.of(source.problem(("sweep",), str(error))) from None
    if len(set(values)) < len(values):
        message = "two steps have the same value"
        hint = "ask for fewer, or spread them further"
        raise ProblemsError.of(source.problem(("sweep",), message, hint=hint))
    return [Step(sweep.field, value) for value in values]


def _values(sweep: Sweep, facts: Facts) -> list[float]:
    if sweep.values:
        return [_number(facts, value) for value in sweep.values]
    first, last = _number(facts, sweep.from_), _number(facts, sweep.to)
    count = sweep.count or 2
    if not sweep.log:
        between = [first + (last - first) * i / (count - 1) for i in range(1, count - 1)]
    elif first > 0 and last > 0:
        between = [first * (last / first) ** (i / (count - 1)) for i in range(1, count - 1)]
    else:
        raise ValueError("equal factors (log) need both ends above 0")
    rounded = [round(value) if facts.whole else float(f"{value:.{DIGITS}g}") for value in between]
    return [first, *rounded, last]


def _number(facts: Facts, value: Any) -> float:
    number = _read(facts, value)
    if isinstance(number, str) or number is None or not math.isfinite(number):
        raise ValueError(f"'{value}' is no number")
    return int(number) if facts.whole and number == int(number) else number


def _read(facts: Facts | None, value: Any) -> Any:
    return facts.unit.read(value) if facts and facts.unit else value


def _unknown(kind: str, where: Where) -> str | None:
    """The nearest name where a path leaves the model, else None."""
    for depth, part in enumerate(where):
        names = field_names(CROSSED[kind], where[:depth])
        if isinstance(part, str) and names and part not in names:
            return nearest(part, names)
    return None


def _value_at(model: Any, where: Where) -> Any:
    value = model
    for part in where:
        if isinstance(value, Model):
            value = getattr(value, str(part), None)
        elif isinstance(value, Mapping):
            value = value.get(part)
        elif isinstance(value, tuple) and isinstance(part, int) and part < len(value):
            value = value[part]
        else:
            return None
    return value
