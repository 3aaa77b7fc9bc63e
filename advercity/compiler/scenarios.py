"""What a suite does to the plain cross: conditions that thin it out, a sweep that multiplies it.

What one scenario is made of: its declarations, the weather drawn, a sweep's step taken.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from advercity_dsl import (
    Blueprint,
    Catalogue,
    Declaration,
    Density,
    Model,
    Rig,
    Road,
    Suite,
    Weather,
    get_declaration_kind,
)
from advercity_dsl.base import suggest_name
from advercity_dsl.suite import Sweep, ValueRange
from advercity_dsl.weather import Sun

from advercity.compiler.diagnostics import Diagnostic, DiagnosticsError
from advercity.compiler.distributions import Distributions, draw_weather
from advercity.compiler.extends import ResolvedDeclaration
from advercity.compiler.fields import NumberConstraints, find_field_names, find_number_constraints
from advercity.compiler.library import Library, LibraryEntry
from advercity.compiler.source import ValuePath
from advercity.compiler.suite_conflicts import RoadConflicts
from advercity.compiler.validation import validate_model

CROSSED_MODELS: dict[str, type[Model]] = {
    "weather": Weather,
    "road": Road,
    "density": Density,
    "rig": Rig,
    "catalogue": Catalogue,
}
SWEEP_DIGITS = 3
"""Significant digits of a step between the ends of a sweep."""


@dataclass(frozen=True)
class SweepStep:
    """One value of a sweep."""

    field: str
    value: float

    @property
    def kind(self) -> str:
        """Kind of the declaration that it changes."""
        return self.field.split(".")[0]

    @property
    def value_path(self) -> ValuePath:
        """Path of the field in that declaration."""
        return parse_field_path(self.field)[1]

    @property
    def suffix(self) -> str:
        """`mor_m_75`: end of the scenario's id; a point is `p`, a minus `n`."""
        number = f"{self.value:.6g}".replace("e+0", "e").replace("e-0", "en").replace("+", "")
        return f"{self.value_path[-1]}_{number.replace('.', 'p').replace('-', 'n')}"


@dataclass(frozen=True)
class SuiteCondition:
    """What one line of a suite's `where` asks for."""

    kind: str
    value_path: ValuePath
    allowed: tuple[Any, ...] | tuple[float | None, float | None]
    is_range: bool

    def is_met(self, scene: Mapping[str, Model]) -> bool:
        """Whether the declarations of a scenario, by kind, meet it."""
        value = _get_value_at(scene[self.kind], self.value_path)
        if not self.is_range:
            return value in self.allowed
        if not isinstance(value, int | float):
            return False
        low, high = self.allowed
        return (low is None or value >= low) and (high is None or value <= high)


def parse_field_path(field: str) -> tuple[str, ValuePath]:
    """`weather.fog.mor_m` as kind and path."""
    kind, *parts = field.split(".")
    return kind, tuple(int(part) if part.isdigit() else part for part in parts)


def parse_conditions(suite: Suite, source: ResolvedDeclaration) -> list[SuiteCondition]:
    """What the suite's `where` asks for.

    Raises:
        ProblemsError: A field is not there, or a value has a wrong unit.
    """
    found: list[SuiteCondition] = []
    problems: list[Diagnostic] = []
    for field, asked in suite.where.items():
        kind, where = parse_field_path(field)
        at = ("where", field)
        hint = _suggest_field(kind, where)
        if hint is not None:
            problems.append(source.build_diagnostic(at, "no such field", hint=hint, key=True))
            continue
        facts = find_number_constraints(CROSSED_MODELS[kind], where)
        try:
            if isinstance(asked, ValueRange):
                ends = (_parse_value(facts, asked.at_least), _parse_value(facts, asked.at_most))
                found.append(SuiteCondition(kind, where, ends, is_range=True))
            else:
                written = asked if isinstance(asked, tuple) else (asked,)
                values = tuple(_parse_value(facts, value) for value in written)
                found.append(SuiteCondition(kind, where, values, is_range=False))
        except ValueError as error:
            problems.append(source.build_diagnostic(at, str(error)))
    if problems:
        raise DiagnosticsError(problems)
    return found


def expand_sweep(suite: Suite, source: ResolvedDeclaration) -> list[SweepStep | None]:
    """The values of the suite's sweep; one None where there is no sweep.

    Raises:
        ProblemsError: The field is no number, or a value has a wrong unit.
    """
    sweep = suite.sweep
    if sweep is None:
        return [None]
    kind, where = parse_field_path(sweep.field)
    facts = find_number_constraints(CROSSED_MODELS[kind], where)
    if facts is None:
        unknown = _suggest_field(kind, where)
        message = "is no number" if unknown is None else "no such field"
        hint = unknown or "a sweep takes a number through values"
        raise DiagnosticsError.from_diagnostic(
            source.build_diagnostic(("sweep", "field"), message, hint=hint)
        )
    try:
        values = _compute_sweep_values(sweep, facts)
    except ValueError as error:
        raise DiagnosticsError.from_diagnostic(
            source.build_diagnostic(("sweep",), str(error))
        ) from None
    if len(set(values)) < len(values):
        message = "two steps have the same value"
        hint = "ask for fewer, or spread them further"
        raise DiagnosticsError.from_diagnostic(
            source.build_diagnostic(("sweep",), message, hint=hint)
        )
    return [SweepStep(sweep.field, value) for value in values]


def _compute_sweep_values(sweep: Sweep, facts: NumberConstraints) -> list[float]:
    if sweep.values:
        return [_parse_number(facts, value) for value in sweep.values]
    first, last = _parse_number(facts, sweep.from_), _parse_number(facts, sweep.to)
    count = sweep.count or 2
    if not sweep.log:
        between = [first + (last - first) * i / (count - 1) for i in range(1, count - 1)]
    elif first > 0 and last > 0:
        between = [first * (last / first) ** (i / (count - 1)) for i in range(1, count - 1)]
    else:
        raise ValueError("equal factors (log) need both ends above 0")
    rounded = [
        round(value) if facts.whole else float(f"{value:.{SWEEP_DIGITS}g}") for value in between
    ]
    return [first, *rounded, last]


def _parse_number(facts: NumberConstraints, value: Any) -> float:
    number = _parse_value(facts, value)
    if isinstance(number, str) or number is None or not math.isfinite(number):
        raise ValueError(f"'{value}' is no number")
    return int(number) if facts.whole and number == int(number) else number


def _parse_value(facts: NumberConstraints | None, value: Any) -> Any:
    return facts.unit.parse(value) if facts and facts.unit else value


def _suggest_field(kind: str, where: ValuePath) -> str | None:
    """The nearest name where a path leaves the model, else None."""
    for depth, part in enumerate(where):
        names = find_field_names(CROSSED_MODELS[kind], where[:depth])
        if isinstance(part, str) and names and part not in names:
            return suggest_name(part, names)
    return None


def _get_value_at(model: Any, where: ValuePath) -> Any:
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


DeclarationT = TypeVar("DeclarationT", bound=Declaration)
MAX_ID_LENGTH = 64


@dataclass(frozen=True)
class ScenarioInputs:
    """What one scenario is made of, its weather drawn and its step of the sweep taken."""

    id: str
    road: Road
    weather: Weather
    density: Density
    rig: Rig
    catalogue: Catalogue
    draws: Distributions
    step: SweepStep | None
    cell: RoadConflicts

    @property
    def by_kind(self) -> dict[str, Model]:
        """What the conditions of a suite ask about."""
        return {
            "road": self.road,
            "weather": self.weather,
            "density": self.density,
            "rig": self.rig,
            "catalogue": self.catalogue,
        }

    @property
    def blueprints(self) -> dict[str, Blueprint]:
        """Bodies that are at home on the road."""
        return {
            name: blueprint
            for name, blueprint in self.catalogue.blueprints.items()
            if blueprint.land_use in ("any", self.road.land_use)
        }

    @property
    def traffic_key(self) -> tuple[str, str, str | None, SweepStep | None]:
        """Scenes in which it is the same have the same traffic, whatever their weather."""
        crossed = self.cell.crossed.id if self.cell.crossed else None
        return self.road.id, self.density.id, crossed, self.step


CrossedDeclarations = tuple[RoadConflicts, Weather, Density, Rig, Catalogue]


def build_scenario_inputs(
    library: Library,
    suite: Suite,
    parts: CrossedDeclarations,
    step: SweepStep | None,
    *,
    require_sun: bool,
) -> ScenarioInputs:
    """The scene of one crossing of a suite, under one step of its sweep.

    Raises:
        ProblemsError: The id is too long, a drawn or swept value does not fit, or a sun in
            somebody's view is asked for as `solved` and is not.
    """
    cell, weather, density, rig, catalogue = parts
    road, crossed = cell.road, cell.crossed.id if cell.crossed else None
    name = _build_checked_id(library, suite, road, weather, density, step, crossed)
    try:
        drawn, draws = draw_scenario_weather(
            library.find_entry(weather), suite.seeds.weather, name, step
        )
        road = _apply_sweep_step(library, road, step)
        density = _apply_sweep_step(library, density, step)
        rig, catalogue = (
            _apply_sweep_step(library, rig, step),
            _apply_sweep_step(library, catalogue, step),
        )
    except DiagnosticsError as error:
        if step is None:
            raise
        raise DiagnosticsError.from_diagnostic(
            _build_step_diagnostic(library, suite, step, error.diagnostics[0])
        ) from None
    drawn = localize_weather(library.find_entry(weather), drawn, road, require_sun=require_sun)
    cell = replace(cell, road=road)
    return ScenarioInputs(name, road, drawn, density, rig, catalogue, draws, step, cell)


def draw_scenario_weather(
    entry: LibraryEntry[Weather], seed: int, spec_id: str, step: SweepStep | None
) -> tuple[Weather, Distributions]:
    """The weather of one spec, and what its numbers were drawn from."""
    if step is None or step.kind != "weather":
        if not entry.distributions:
            return entry.declaration, {}
        return draw_weather(entry.source, entry.distributions, seed, spec_id), entry.distributions
    source = entry.source.replace_value(step.value_path, step.value)
    left = {where: item for where, item in entry.distributions.items() if where != step.value_path}
    return draw_weather(source, left, seed, spec_id), left


def _apply_sweep_step(library: Library, item: DeclarationT, step: SweepStep | None) -> DeclarationT:
    if step is None or step.kind != get_declaration_kind(item):
        return item
    source = library.find_entry(item).source.replace_value(step.value_path, step.value)
    stepped = validate_model(type(item), source)
    if isinstance(item, Road):
        kept = {"imported": item.imported, "agents": item.agents, "ego_routes": item.ego_routes}
        return stepped.model_copy(update=kept)
    return stepped


def _build_step_diagnostic(
    library: Library, suite: Suite, step: SweepStep, found: Diagnostic
) -> Diagnostic:
    source = library.find_entry(suite).source
    message = f"{step.field} of {step.value:g} does not fit: {found.message}"
    return source.build_diagnostic(("sweep",), message, hint=found.hint)


def _build_checked_id(
    library: Library,
    suite: Suite,
    road: Road,
    weather: Weather,
    density: Density,
    step: SweepStep | None,
    crossed: str | None,
) -> str:
    name = build_spec_id(road, weather, density, step, crossed)
    if len(name) > MAX_ID_LENGTH:
        message = f"makes the id '{name}', which is longer than {MAX_ID_LENGTH} characters"
        hint = "shorten the ids that it is made of"
        raise DiagnosticsError.from_diagnostic(
            library.build_diagnostic(suite, "id", message=message, hint=hint)
        )
    return name


def build_spec_id(
    road: Road, weather: Weather, density: Density, step: SweepStep | None, crossed: str | None
) -> str:
    """`<road>_<weather>_<density>`, a crossed conflict after the road, a sweep's step last."""
    middle = [crossed] if crossed else []
    parts = (road.id, *middle, weather.id, density.id, *([step.suffix] if step else []))
    return "_".join(parts)


def localize_weather(
    entry: LibraryEntry[Weather], weather: Weather, road: Road, *, require_sun: bool = True
) -> Weather:
    """The weather as it is at a road: its own sun in place of `sun_at`.

    Raises:
        ProblemsError: The sun is to be in somebody's view, and is not found yet.
    """
    sun = weather.sun_at.get(road.id, weather.sun)
    if sun.in_view_of is not None and require_sun:
        where = ("sun", "in_view_of") if sun is weather.sun else ("sun_at", road.id, "in_view_of")
        message = f"where the sun is in view of the ego at road '{road.id}' is not known yet"
        hint = "`advercity solve LIBRARY` finds it, and writes it to sun_at"
        raise DiagnosticsError.from_diagnostic(
            entry.source.build_diagnostic(where, message, hint=hint)
        )
    if sun.in_view_of is not None:
        sun = Sun()
    return weather.model_copy(update={"sun": sun, "sun_at": {}})
