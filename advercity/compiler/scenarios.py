"""Scenarios of a suite: its conditions, the steps of its sweep, and the inputs of each scenario."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, TypeVar

from advercity_dsl import (
    DECLARATIONS,
    Blueprint,
    Catalogue,
    Channel,
    Declaration,
    Density,
    Model,
    Rig,
    Road,
    Suite,
    Vehicle,
    Weather,
    get_declaration_kind,
)
from advercity_dsl.base import MAX_ID_LENGTH, ValuePath, suggest_name
from advercity_dsl.suite import MAX_SWEEP_STEPS, Looks, Sweep, ValueRange
from advercity_dsl.weather_components import Sun

from advercity.compiler.distributions import Distributions, draw_weather
from advercity.compiler.extends import ResolvedDeclaration
from advercity.compiler.fields import NumberConstraints, find_field_names, find_number_constraints
from advercity.compiler.library import Library, LibraryEntry
from advercity.compiler.suite_conflicts import RoadConflicts
from advercity.compiler.suites import find_untimely_messages
from advercity.compiler.validation import validate_model
from advercity.diagnostics import Diagnostic, DiagnosticsError

DeclarationT = TypeVar("DeclarationT", bound=Declaration)
SWEEP_DIGITS = 3
"""Significant digits of the computed values between the ends of a sweep."""
ID_DIGITS = 12
"""Significant digits of a swept value in an id: as written, without rounding errors of units."""


@dataclass(frozen=True)
class SweepStep:
    """One value of a sweep."""

    field: str
    value: float

    @property
    def kind(self) -> str:
        """Kind of the changed declaration."""
        return parse_field_path(self.field)[0]

    @property
    def value_path(self) -> ValuePath:
        """Path of the field in the declaration."""
        return parse_field_path(self.field)[1]

    @property
    def suffix(self) -> str:
        """`mor_m_75`: end of the scenario's id, with `p` for a point and `n` for a minus."""
        # Ids are limited to letters, digits and underscores.
        digits = f"{self.value:.{ID_DIGITS}g}"
        number = digits.replace("e+0", "e").replace("e-0", "en").replace("+", "")
        return f"{self.value_path[-1]}_{number.replace('.', 'p').replace('-', 'n')}"


@dataclass(frozen=True)
class SuiteCondition:
    """One condition of a suite's `where`: allowed values, or lowest and highest value."""

    kind: str
    value_path: ValuePath
    allowed: Sequence[Any]
    is_range: bool

    def is_met(self, declarations: Mapping[str, Model | None]) -> bool:
        """Return whether the declarations of a scenario, by kind, meet the condition."""
        value = _get_value(declarations[self.kind], self.value_path)
        if not self.is_range:
            return value in self.allowed
        if not isinstance(value, int | float):
            return False
        low, high = self.allowed
        return (low is None or value >= low) and (high is None or value <= high)


def parse_field_path(field: str) -> tuple[str, ValuePath]:
    """Split `weather.fog.mor_m` into kind and path."""
    kind, *parts = field.split(".")
    return kind, tuple(int(part) if part.isdigit() else part for part in parts)


def parse_conditions(suite: Suite, source: ResolvedDeclaration) -> list[SuiteCondition]:
    """Parse the conditions of a suite's `where`.

    Raises:
        DiagnosticsError: A field is unknown, or a value has an invalid unit.
    """
    conditions: list[SuiteCondition] = []
    diagnostics: list[Diagnostic] = []
    for field, written in suite.where.items():
        at = ("where", field)
        kind, value_path = parse_field_path(field)
        hint = _suggest_path_part(kind, value_path)
        if hint is not None:
            diagnostics.append(source.build_diagnostic(at, "no such field", hint=hint, key=True))
            continue
        is_range = isinstance(written, ValueRange)
        if isinstance(written, ValueRange):
            values = (written.at_least, written.at_most)
        else:
            values = written if isinstance(written, tuple) else (written,)
        constraints = find_number_constraints(DECLARATIONS[kind], value_path) or NumberConstraints()
        try:
            allowed = tuple(constraints.parse(value) for value in values)
            conditions.append(SuiteCondition(kind, value_path, allowed, is_range=is_range))
        except ValueError as error:
            diagnostics.append(source.build_diagnostic(at, str(error)))
    if diagnostics:
        raise DiagnosticsError(*diagnostics)
    return conditions


def _suggest_path_part(kind: str, value_path: ValuePath) -> str | None:
    """Return the most similar name for the first unknown part of a path; None if all are known."""
    for depth, part in enumerate(value_path):
        names = find_field_names(DECLARATIONS[kind], value_path[:depth])
        if isinstance(part, str) and names and part not in names:
            return suggest_name(part, names)
    return None


def _get_value(model: Model | None, value_path: ValuePath) -> Any:
    """Return the value at a path of nested models; None if a part is absent."""
    value: Any = model
    for part in value_path:
        if isinstance(value, Model):
            value = getattr(value, str(part), None)
        elif isinstance(value, Mapping):
            value = value.get(part)
        elif isinstance(value, tuple) and isinstance(part, int) and part < len(value):
            value = value[part]
        else:
            return None
    return value


SweepSteps = tuple[SweepStep, ...]
"""A step of each of a suite's sweeps."""


def expand_sweeps(suite: Suite, source: ResolvedDeclaration) -> list[SweepSteps]:
    """Return the crossed steps of a suite's sweeps; one empty tuple without a sweep.

    Raises:
        DiagnosticsError: A field is not a number or swept twice, a value has an invalid unit,
            or there are too many steps.
    """
    fields = [sweep.field for sweep in suite.sweeps.values()]
    for index, field in enumerate(fields):
        if field in fields[:index]:
            message, hint = f"'{field}' is swept twice", "join their values"
            at = ("sweep", index, "field")
            raise DiagnosticsError(source.build_diagnostic(at, message, hint=hint))
    expanded = [_expand_sweep(at, sweep, source) for at, sweep in suite.sweeps.items()]
    count = math.prod(map(len, expanded))
    if count > MAX_SWEEP_STEPS:
        message = f"crosses to {count:,} steps; the limit is {MAX_SWEEP_STEPS:,}"
        hint = "give fewer values, or fewer sweeps"
        raise DiagnosticsError(source.build_diagnostic(("sweep",), message, hint=hint))
    return list(product(*expanded))


def _expand_sweep(at: ValuePath, sweep: Sweep, source: ResolvedDeclaration) -> list[SweepStep]:
    kind, value_path = parse_field_path(sweep.field)
    constraints = find_number_constraints(DECLARATIONS[kind], value_path)
    if constraints is None:
        unknown = _suggest_path_part(kind, value_path)
        message = "is not a number" if unknown is None else "no such field"
        hint = unknown or "a sweep varies a number"
        raise DiagnosticsError(source.build_diagnostic((*at, "field"), message, hint=hint))
    try:
        values = _compute_sweep_values(sweep, constraints)
    except ValueError as error:
        raise DiagnosticsError(source.build_diagnostic(at, str(error))) from None
    if len(set(values)) < len(values):
        message, hint = "two steps have the same value", "reduce the count, or widen the range"
        raise DiagnosticsError(source.build_diagnostic(at, message, hint=hint))
    return [SweepStep(sweep.field, value) for value in values]


def _compute_sweep_values(sweep: Sweep, constraints: NumberConstraints) -> list[float]:
    if sweep.values:
        return [_parse_number(constraints, value) for value in sweep.values]
    first, last = (_parse_number(constraints, end) for end in (sweep.from_, sweep.to))
    count = sweep.count or 2
    inner = range(1, count - 1)
    if not sweep.log:
        between = [first + (last - first) * i / (count - 1) for i in inner]
    elif first > 0 and last > 0:
        between = [first * (last / first) ** (i / (count - 1)) for i in inner]
    else:
        raise ValueError("logarithmic steps (log) need both ends above 0")
    rounded = [
        round(value) if constraints.whole else float(f"{value:.{SWEEP_DIGITS}g}")
        for value in between
    ]
    # The author wrote the ends, so they are not rounded.
    return [first, *rounded, last]


def _parse_number(constraints: NumberConstraints, value: Any) -> float:
    number = constraints.parse(value)
    if isinstance(number, str) or number is None or not math.isfinite(number):
        raise ValueError(f"'{value}' is not a number")
    # Fields of integers are strict: 3.0 would be rejected.
    return int(number) if constraints.whole and number == int(number) else number


TrafficKey = tuple[str, str, str | None, SweepSteps, tuple[str, ...]]
"""Road, density, crossed conflict, steps of the sweeps and key of the sample."""


@dataclass(frozen=True)
class ScenarioInputs:
    """Declarations of one scenario, with its weather drawn and its sweep steps applied."""

    id: str
    road: Road
    weather: Weather
    density: Density
    rig: Rig
    catalogue: Catalogue
    channel: Channel | None
    draws: Distributions
    steps: SweepSteps
    conflicts: RoadConflicts
    looks: Looks
    repeat: int | None
    is_paired: bool

    @property
    def by_kind(self) -> dict[str, Model | None]:
        """Declarations to which the conditions of a suite apply."""
        return {
            "road": self.road,
            "weather": self.weather,
            "density": self.density,
            "rig": self.rig,
            "catalogue": self.catalogue,
            "channel": self.channel,
        }

    @property
    def origin(self) -> dict[str, str]:
        """Declarations and values in the id."""
        return {
            "road": self.road.id,
            "conflict": self.conflicts.crossed_id or "none",
            "weather": self.weather.id,
            "density": self.density.id,
            **{step.field: repr(step.value) for step in self.steps},
            "repeat": str(self.repeat),
        }

    @property
    def blueprints(self) -> dict[str, Blueprint]:
        """Blueprints for the road's surroundings, without models of unused packages."""
        return {
            name: blueprint if self.looks == "full" else _remove_package_model(blueprint)
            for name, blueprint in self.catalogue.blueprints.items()
            if blueprint.land_use in ("any", self.road.land_use)
        }

    @property
    def traffic_key(self) -> TrafficKey:
        """Key shared by scenarios with the same traffic."""
        return self.road.id, self.density.id, self.conflicts.crossed_id, self.steps, self.sample_key

    @property
    def sample_key(self) -> tuple[str, ...]:
        """Part of the random numbers' keys: differs between samples of a road and density.

        Weathers are samples of their own unless they are paired, repeats from the second on.
        """
        weather = () if self.is_paired else (self.weather.id,)
        return (*weather, f"r{self.repeat}") if self.repeat and self.repeat > 1 else weather


def _remove_package_model(blueprint: Blueprint) -> Blueprint:
    is_packaged = blueprint.model is not None and blueprint.model.file is None
    return blueprint.model_copy(update={"model": None}) if is_packaged else blueprint


CrossedDeclarations = tuple[RoadConflicts, Weather, Density, Rig, Catalogue, Channel | None]


def build_scenario_inputs(
    library: Library,
    suite: Suite,
    crossed: CrossedDeclarations,
    steps: SweepSteps,
    repeat: int | None,
    *,
    require_sun: bool,
) -> ScenarioInputs:
    """Build the inputs of one crossing of a suite at one step of each sweep and one repeat.

    Raises:
        DiagnosticsError: The id is too long, a drawn or swept value is not valid, or
            `require_sun` is set and a sun in view of the ego has not been computed.
    """
    conflicts, weather, density, rig, catalogue, channel = crossed
    entry = library.find_entry(weather)
    name = build_spec_id(conflicts.road, weather, density, steps, conflicts.crossed_id, repeat)
    if len(name) > MAX_ID_LENGTH:
        message = f"makes the id '{name}', which is longer than {MAX_ID_LENGTH} characters"
        hint = "shorten the ids of which it consists"
        raise DiagnosticsError(library.build_diagnostic(suite, "id", message=message, hint=hint))
    try:
        drawn, draws = draw_scenario_weather(entry, suite.seeds.weather, name, steps)
        density = _apply_sweep_steps(library, density, steps)
        # Conflicts are solved on the road with the sweep and the limits applied.
        conflicts = conflicts.change_roads(
            lambda road: apply_speed_limits(_apply_sweep_steps(library, road, steps), density)
        )
        rig = _apply_sweep_steps(library, rig, steps)
        catalogue = _apply_sweep_steps(library, catalogue, steps)
        channel = _apply_channel_steps(library, suite, channel, steps)
    except DiagnosticsError as error:
        if not steps:
            raise
        first = error.diagnostics[0]
        swept = " with ".join(f"{step.field} of {step.value:g}" for step in steps)
        message = f"{swept} is not valid: {first.message}"
        raise DiagnosticsError(
            library.build_diagnostic(suite, "sweep", message=message, hint=first.hint)
        ) from None
    road = conflicts.road
    weather = localize_weather(entry, drawn, road, require_sun=require_sun)
    return ScenarioInputs(
        *(name, road, weather, density, rig, catalogue, channel, draws, steps, conflicts),
        *(suite.looks, repeat, suite.pairing == "weather"),
    )


def apply_speed_limits(road: Road, density: Density) -> Road:
    """Return the road with the speed limits of a density, if it has any."""
    if density.speed_limits_km_h is None:
        return road
    limit = getattr(density.speed_limits_km_h, road.land_use)
    streets = {
        name: street.model_copy(update={"speed_limit_km_h": limit})
        for name, street in road.streets.items()
    }
    agents = {
        name: place.model_copy(update={"max_speed_km_h": limit})
        if isinstance(place, Vehicle)
        else place
        for name, place in road.agents.items()
    }
    return road.model_copy(update={"streets": streets, "agents": agents})


def draw_scenario_weather(
    entry: LibraryEntry[Weather], seed: int, spec_id: str, steps: SweepSteps
) -> tuple[Weather, Distributions]:
    """Draw the weather of one spec; return it with the drawn distributions."""
    source, distributions = entry.source, entry.distributions
    swept = [step for step in steps if step.kind == "weather"]
    for step in swept:
        # The swept value replaces a distribution at its path, which then is not drawn.
        source = source.replace_value(step.value_path, step.value)
        distributions = {
            path: item for path, item in distributions.items() if path != step.value_path
        }
    if not swept and not distributions:
        return entry.declaration, {}
    return draw_weather(source, distributions, seed, spec_id), distributions


def _apply_sweep_steps(library: Library, item: DeclarationT, steps: SweepSteps) -> DeclarationT:
    swept = [step for step in steps if step.kind == get_declaration_kind(item)]
    if not swept:
        return item
    source = library.find_entry(item).source
    for step in swept:
        source = source.replace_value(step.value_path, step.value)
    changed = validate_model(type(item), source)
    if isinstance(item, Road) and isinstance(changed, Road):
        # The road came with map, agents and surroundings of its style, and its ego set; keep them.
        names = ("id", "imported", "agents", "at_junction", "ego_routes", "style", "trajectories")
        grown = item.surroundings[len(changed.surroundings) :]
        kept = {name: getattr(item, name) for name in names}
        kept["surroundings"] = (*changed.surroundings, *grown)
        return changed.model_copy(update=kept)
    return changed


def _apply_channel_steps(
    library: Library, suite: Suite, channel: Channel | None, steps: SweepSteps
) -> Channel | None:
    if channel is None or all(step.kind != "channel" for step in steps):
        return channel
    changed = _apply_sweep_steps(library, channel, steps)
    untimely = [*find_untimely_messages(library, suite, changed)]
    if untimely:
        raise DiagnosticsError(*untimely)
    return changed


def build_spec_id(
    road: Road,
    weather: Weather,
    density: Density,
    steps: SweepSteps,
    crossed: str | None,
    repeat: int | None,
) -> str:
    """Build `<road>_<weather>_<density>`.

    A crossed conflict comes after the road, steps of sweeps and the number of a repeat at the
    end: `ui_clear_day_dense_r2`.
    """
    suffixes = *(step.suffix for step in steps), f"r{repeat}" if repeat else None
    parts = (road.id, crossed, weather.id, density.id, *suffixes)
    return "_".join(part for part in parts if part)


def localize_weather(
    entry: LibraryEntry[Weather], weather: Weather, road: Road, *, require_sun: bool = True
) -> Weather:
    """Replace the sun of a weather by the road's sun in `sun_at`.

    Raises:
        DiagnosticsError: The sun in view of the ego is required but has not been computed.
    """
    sun = weather.sun_at.get(road.id, weather.sun)
    if sun.in_view_of is not None and require_sun:
        field = ("sun",) if sun is weather.sun else ("sun_at", road.id)
        message = f"the sun in view of the ego at road '{road.id}' has not been computed"
        hint = "`advercity solve LIBRARY` computes it and writes it to sun_at"
        raise DiagnosticsError(
            entry.source.build_diagnostic((*field, "in_view_of"), message, hint=hint)
        )
    if sun.in_view_of is not None:
        # `advercity solve` compiles before it knows the sun, for the traffic alone.
        sun = Sun()
    # A spec has one road, so the suns of other roads would only change its digest.
    return weather.model_copy(update={"sun": sun, "sun_at": {}})
