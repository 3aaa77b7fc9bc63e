"""What one scenario is made of: its declarations, the weather drawn, a sweep's step taken."""

from dataclasses import dataclass, replace
from typing import TypeVar

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
    kind_of,
)
from advercity_dsl.weather import Sun

from advercity.compiler.conflicts import Cell
from advercity.compiler.distributions import Distributions, draw
from advercity.compiler.library import Entry, Library
from advercity.compiler.problems import Problem, ProblemsError
from advercity.compiler.validation import validate
from advercity.compiler.variation import Step

DeclarationT = TypeVar("DeclarationT", bound=Declaration)
MAX_ID = 64


@dataclass(frozen=True)
class Scene:
    """What one scenario is made of, its weather drawn and its step of the sweep taken."""

    id: str
    road: Road
    weather: Weather
    density: Density
    rig: Rig
    catalogue: Catalogue
    draws: Distributions
    step: Step | None
    cell: Cell

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
    def traffic_key(self) -> tuple[str, str, str | None, Step | None]:
        """Scenes in which it is the same have the same traffic, whatever their weather."""
        crossed = self.cell.crossed.id if self.cell.crossed else None
        return self.road.id, self.density.id, crossed, self.step


Parts = tuple[Cell, Weather, Density, Rig, Catalogue]


def scene(
    library: Library, suite: Suite, parts: Parts, step: Step | None, *, solved: bool
) -> Scene:
    """The scene of one crossing of a suite, under one step of its sweep.

    Raises:
        ProblemsError: The id is too long, a drawn or swept value does not fit, or a sun in
            somebody's view is asked for as `solved` and is not.
    """
    cell, weather, density, rig, catalogue = parts
    road, crossed = cell.road, cell.crossed.id if cell.crossed else None
    name = _name(library, suite, road, weather, density, step, crossed)
    try:
        drawn, draws = weather_of(library.entry(weather), suite.seeds.weather, name, step)
        road = _stepped(library, road, step)
        density = _stepped(library, density, step)
        rig, catalogue = _stepped(library, rig, step), _stepped(library, catalogue, step)
    except ProblemsError as error:
        if step is None:
            raise
        raise ProblemsError.of(_bad_step(library, suite, step, error.problems[0])) from None
    drawn = weather_at(library.entry(weather), drawn, road, solved=solved)
    cell = replace(cell, road=road)
    return Scene(name, road, drawn, density, rig, catalogue, draws, step, cell)


def weather_of(
    entry: Entry[Weather], seed: int, spec_id: str, step: Step | None
) -> tuple[Weather, Distributions]:
    """The weather of one spec, and what its numbers were drawn from."""
    if step is None or step.kind != "weather":
        if not entry.distributions:
            return entry.declaration, {}
        return draw(entry.source, entry.distributions, seed, spec_id), entry.distributions
    source = entry.source.with_value(step.where, step.value)
    left = {where: item for where, item in entry.distributions.items() if where != step.where}
    return draw(source, left, seed, spec_id), left


def _stepped(library: Library, item: DeclarationT, step: Step | None) -> DeclarationT:
    if step is None or step.kind != kind_of(item):
        return item
    source = library.entry(item).source.with_value(step.where, step.value)
    stepped = validate(type(item), source)
    if isinstance(item, Road):
        kept = {"imported": item.imported, "agents": item.agents, "ego_routes": item.ego_routes}
        return stepped.model_copy(update=kept)
    return stepped


def _bad_step(library: Library, suite: Suite, step: Step, found: Problem) -> Problem:
    source = library.entry(suite).source
    message = f"{step.field} of {step.value:g} does not fit: {found.message}"
    return source.problem(("sweep",), message, hint=found.hint)


def _name(
    library: Library,
    suite: Suite,
    road: Road,
    weather: Weather,
    density: Density,
    step: Step | None,
    crossed: str | None,
) -> str:
    name = spec_id(road, weather, density, step, crossed)
    if len(name) > MAX_ID:
        message = f"makes the id '{name}', which is longer than {MAX_ID} characters"
        hint = "shorten the ids that it is made of"
        raise ProblemsError.of(library.problem(suite, "id", message=message, hint=hint))
    return name


def spec_id(
    road: Road, weather: Weather, density: Density, step: Step | None, crossed: str | None
) -> str:
    """`<road>_<weather>_<density>`, a crossed conflict after the road, a sweep's step last."""
    middle = [crossed] if crossed else []
    parts = (road.id, *middle, weather.id, density.id, *([step.suffix] if step else []))
    return "_".join(parts)


def weather_at(
    entry: Entry[Weather], weather: Weather, road: Road, *, solved: bool = True
) -> Weather:
    """The weather as it is at a road: its own sun in place of `sun_at`.

    Raises:
        ProblemsError: The sun is to be in somebody's view, and is not found yet.
    """
    sun = weather.sun_at.get(road.id, weather.sun)
    if sun.in_view_of is not None and solved:
        where = ("sun", "in_view_of") if sun is weather.sun else ("sun_at", road.id, "in_view_of")
        message = f"where the sun is in view of the ego at road '{road.id}' is not known yet"
        hint = "`advercity solve LIBRARY` finds it, and writes it to sun_at"
        raise ProblemsError.of(entry.source.problem(where, message, hint=hint))
    if sun.in_view_of is not None:
        sun = Sun()
    return weather.model_copy(update={"sun": sun, "sun_at": {}})
