"""Explanations of specs: the origin of every value, and the differences between two specs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from itertools import accumulate
from typing import Any

from advercity_dsl import Declaration, RoadsideUnit, Spec, Suite, Weather
from advercity_dsl.base import ValuePath

from advercity.compiler.extends import ResolvedDeclaration
from advercity.compiler.library import Library, LibraryEntry
from advercity.compiler.source import format_value_path, iterate_values
from advercity.errors import InputError

DERIVATION_RULES = {
    "spec_version": "version of the format",
    "id": "ids of road, weather and density, the step of a sweep and the number of a repeat",
    "groups": "selected typologies that require such a road",
    "demand.vehicles": "8 areas of round(road.traffic.vehicles_per_area x density.vehicles)",
    "demand.walkers": "round(road.traffic.walkers x density.walkers)",
    "seeds.traffic": "from the suite's seeds.traffic, the ids of road and density, and the repeat",
    "assets": "checksums in the lock of the catalogue, and of photographs",
    "caution": "from the tables of the drivers, by the weather",
    "road.imported": "built from the road's map",
    "road.trajectories": "taken from the road's table",
    "provenance": "written by the compiler",
}
"""Rules for derived values, by the beginning of their paths."""
Entries = Mapping[str, LibraryEntry[Declaration]]
"""Library entries behind a spec, by kind; rigs by `rig/<id>`."""


def flatten_values(data: Any) -> dict[str, Any]:
    """Return the scalars and empty collections of nested data, by dotted path."""
    return {
        format_value_path(value_path): value
        for value_path, value in iterate_values(data)
        if not (isinstance(value, dict | list) and value)
    }


def compare_specs(first: Spec, second: Spec) -> list[tuple[str, Any, Any]]:
    """Return path and both values of every different field, None for an absent one.

    Provenance is ignored: it is the origin of a spec, not its content.
    """
    one, other = (
        flatten_values(spec.model_dump(mode="json", exclude={"provenance"}))
        for spec in (first, second)
    )
    return [
        (path, one.get(path), other.get(path))
        for path in one | other
        if path not in one or path not in other or one[path] != other[path]
    ]


@dataclass(frozen=True)
class ValueOrigin:
    """A value of a spec and a text on its origin."""

    path: str
    value: Any
    text: str

    def is_within(self, fields: Sequence[str]) -> bool:
        """Return whether the value is one of some fields, or part of one."""
        return not set(fields).isdisjoint(self.fields)

    @property
    def fields(self) -> list[str]:
        """Dotted paths of the value and of all around it: `a`, `a.b`, `a.b.c`."""
        return list(accumulate(self.path.split("."), "{}.{}".format))


def explain_spec(spec: Spec, library: Library) -> list[ValueOrigin]:
    """Return the origin of every value of a spec.

    Raises:
        InputError: The spec was compiled from another state of the library.
    """
    entries = _find_provenance_entries(spec, library)
    return [
        ValueOrigin(path, value, _describe_origin(path, spec, entries))
        for path, value in flatten_values(spec.model_dump(mode="json")).items()
    ]


def _find_provenance_entries(spec: Spec, library: Library) -> Entries:
    entries: dict[str, LibraryEntry[Declaration]] = {}
    for key, digest in spec.provenance.declarations.items():
        kind, name = key.split("/")
        entry = library.entries.get((kind, name))
        if entry is None or entry.digest != digest:
            what = "is not in this library" if entry is None else "has changed since"
            raise InputError(f"{spec.id}: {kind} '{name}' {what}; compile the library again")
        # A scenario may have several rigs.
        entries[key if kind == "rig" else kind] = entry
    return entries


def _describe_origin(path: str, spec: Spec, entries: Entries) -> str:
    provenance = spec.provenance
    if path in provenance.draws:
        distribution = provenance.draws[path].model_dump(exclude_none=True)
        return f"drawn from {distribution}, {_describe_source(path, spec, entries)}"
    if any(path == point.field for point in provenance.sweep_points):
        source = entries["suite"].source
        return f"step of the sweep, {source.document.path}:{source.find_position(('sweep',)).line}"
    for beginning, rule in DERIVATION_RULES.items():
        if path == beginning or path.startswith(f"{beginning}."):
            return f"rule: {rule}"
    return _describe_source(path, spec, entries)


def _describe_source(path: str, spec: Spec, entries: Entries) -> str:
    suite = entries["suite"].declaration
    assert isinstance(suite, Suite)
    kind, value_path = _find_declared_path(path, spec, suite)
    if kind is None:
        return "rule: written by the compiler"
    source = entries[kind].source
    sun_at = ("sun_at", spec.road.id)
    if kind == "weather" and value_path[:1] == ("sun",) and source.has_value(sun_at):
        value_path = (*sun_at, *value_path[1:])
    then = _find_sun_time(entries[kind].declaration) if value_path[:1] == ("sun",) else None
    if then is not None and not source.has_value(value_path):
        return f"rule: of {then:%Y-%m-%d %H:%M} UTC, {_format_place(source, ('sun', 'at'))}"
    return _format_place(source, value_path) if source.has_value(value_path) else "default"


def _find_sun_time(declaration: Declaration) -> datetime | None:
    """Find the instant of the sun's position; None if it is given by angles."""
    return declaration.sun.time_utc if isinstance(declaration, Weather) else None


def _format_place(source: ResolvedDeclaration, value_path: ValuePath) -> str:
    position = source.find_position(value_path)
    return f"{source.find_document(value_path).path}:{position.line}:{position.column}"


def _find_declared_path(path: str, spec: Spec, suite: Suite) -> tuple[str | None, ValuePath]:
    """Return the key of the entry with a value, and the value's path in it."""
    first, *rest = (int(part) if part.isdigit() else part for part in path.split("."))
    value_path = tuple(rest)
    match first:
        case "road" | "weather" | "density" | "drivers" | "channel":
            return first, value_path
        case "demand":
            return "road", ("traffic", *value_path)
        case "timing" | "seeds":
            return "suite", (first, *value_path)
        case "blueprints":
            return "catalogue", ("blueprints", *value_path)
        case "agents":
            return _find_agent_path(spec, suite, value_path)
        case _:
            return None, ()


def _find_agent_path(
    spec: Spec, suite: Suite, value_path: ValuePath
) -> tuple[str | None, ValuePath]:
    index, field, *rest = value_path
    agent = spec.agents[int(index)]
    place, rig = agent.place, f"rig/{suite.agents.get(agent.id, suite.rig)}"
    match field:
        case "place":
            return "road", ("agents", agent.id, *rest)
        case "sensors" if isinstance(place, RoadsideUnit):
            if place.lidar_upper_deg is not None and rest == ["lidar", "upper_deg"]:
                return "road", ("agents", agent.id, "lidar_upper_deg")
            return rig, ("roadside_unit", *rest)
        case "sensors":
            return rig, ("vehicle", *rest)
        case "blueprint" if agent.id in suite.bodies:
            return "suite", ("bodies", agent.id)
        case "blueprint" if agent.blueprint is not None:
            return "catalogue", ("ego",)
        case _:
            return None, ()
