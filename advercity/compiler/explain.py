"""What differs between two specs, field by field.

Where every value of a spec comes from: a line of a file, a default, or a rule.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import Any, cast

from advercity_dsl import Declaration, RoadsideUnit, Spec

from advercity.compiler.library import Library, LibraryEntry
from advercity.compiler.source import ValuePath
from advercity.errors import InputError

IGNORED_FIELDS = ("provenance",)
"""Says where a spec comes from, not what it is."""


def flatten_values(data: Any, path: str = "") -> dict[str, Any]:
    """Every value of nested data that is no mapping or list, by its dotted path."""
    if isinstance(data, dict) and data:
        items = cast(dict[str, Any], data).items()
    elif isinstance(data, list) and data:
        items = enumerate(cast(list[Any], data))
    else:
        return {path: data}
    found: dict[str, Any] = {}
    for key, value in items:
        found |= flatten_values(value, f"{path}.{key}" if path else str(key))
    return found


def compare_specs(first: Spec, second: Spec) -> list[tuple[str, Any, Any]]:
    """Path and both values of every field that differs; None where one has none."""
    one, other = (
        flatten_values(spec.model_dump(mode="json", exclude=set(IGNORED_FIELDS)))
        for spec in (first, second)
    )
    paths = [*one, *(path for path in other if path not in one)]
    return [
        (path, one.get(path), other.get(path))
        for path in paths
        if path not in one or path not in other or one[path] != other[path]
    ]


DERIVATION_RULES = {
    "spec_version": "version of the format",
    "id": "ids of road, weather and density, and the step of a sweep",
    "groups": "typologies that the suite selects and that call for such a road",
    "demand.vehicles": "8 areas of round(road.traffic.vehicles_per_area x density.vehicles)",
    "demand.walkers": "round(road.traffic.walkers x density.walkers)",
    "seeds.traffic": "from the suite's seeds.traffic, the road's id and the density's",
    "caution": "from the tables of the drivers, by the weather",
    "road.imported": "built from the map that the road names",
    "provenance": "written by the compiler",
}
"""What is derived, by the beginning of its path."""


@dataclass(frozen=True)
class ValueOrigin:
    """One value of a spec and where it comes from."""

    path: str
    value: Any
    text: str

    def is_within(self, fields: Sequence[str]) -> bool:
        """Whether it is one of the fields, or part of one."""
        return not set(fields).isdisjoint(self.fields)

    @property
    def fields(self) -> list[str]:
        """All that it is part of, from the outermost to itself: `a`, `a.b`, `a.b.c`."""
        return list(accumulate(self.path.split("."), "{}.{}".format))


def explain_spec(spec: Spec, library: Library) -> list[ValueOrigin]:
    """The origin of every value of a spec.

    Raises:
        InputError: The library is not what the spec was compiled from.
    """
    entries = _find_provenance_entries(spec, library)
    found = flatten_values(spec.model_dump(mode="json"))
    return [
        ValueOrigin(path, value, _describe_origin(path, spec, entries))
        for path, value in found.items()
    ]


def _find_provenance_entries(spec: Spec, library: Library) -> dict[str, LibraryEntry[Declaration]]:
    entries: dict[str, LibraryEntry[Declaration]] = {}
    for name, digest in spec.provenance.declarations.items():
        kind, identifier = name.split("/")
        entry = library.entries.get((kind, identifier))
        if entry is None or entry.digest != digest:
            what = "is not in this library" if entry is None else "has changed since"
            raise InputError(f"{spec.id}: {kind} '{identifier}' {what}; compile the library again")
        entries[kind] = entry
    return entries


def _describe_origin(
    path: str, spec: Spec, entries: Mapping[str, LibraryEntry[Declaration]]
) -> str:
    provenance = spec.provenance
    if path in provenance.draws:
        drawn = provenance.draws[path].model_dump(exclude_none=True)
        return f"drawn from {drawn}, {_describe_source(path, spec, entries)}"
    if provenance.sweep and path == provenance.sweep.field:
        source = entries["suite"].source
        return f"step of the sweep, {source.document.path}:{source.find_position(('sweep',)).line}"
    for beginning, rule in DERIVATION_RULES.items():
        if path == beginning or path.startswith(f"{beginning}."):
            return f"rule: {rule}"
    return _describe_source(path, spec, entries)


def _describe_source(
    path: str, spec: Spec, entries: Mapping[str, LibraryEntry[Declaration]]
) -> str:
    kind, where = _find_declared_path(path, spec)
    if kind is None:
        return "rule: written by the compiler"
    source = entries[kind].source
    own_sun = ("sun_at", spec.road.id, *where[1:])
    if kind == "weather" and where[:1] == ("sun",) and source.has_value(own_sun[:2]):
        where = own_sun
    if not source.has_value(where):
        return "default"
    at = source.find_position(where)
    return f"{source.find_document(where).path}:{at.line}:{at.column}"


def _find_declared_path(path: str, spec: Spec) -> tuple[str | None, ValuePath]:
    """Kind of the declaration that says a value, and the path there."""
    first, *rest = (int(part) if part.isdigit() else part for part in path.split("."))
    where = tuple(rest)
    match first:
        case "road" | "weather" | "density" | "drivers":
            return first, where
        case "demand":
            return "road", ("traffic", *where)
        case "timing" | "seeds":
            return "suite", (first, *where)
        case "blueprints":
            return "catalogue", ("blueprints", *where)
        case "agents":
            return _find_agent_path(spec, where)
        case _:
            return None, ()


def _find_agent_path(spec: Spec, where: ValuePath) -> tuple[str | None, ValuePath]:
    index, field, *rest = where
    agent = spec.agents[int(index)]
    place = agent.place
    match field:
        case "place":
            return "road", ("agents", agent.id, *rest)
        case "sensors" if isinstance(place, RoadsideUnit):
            if place.lidar_upper_deg is not None and rest == ["lidar", "upper_deg"]:
                return "road", ("agents", agent.id, "lidar_upper_deg")
            return "rig", ("roadside_unit", *rest)
        case "sensors":
            return "rig", ("vehicle", *rest)
        case "blueprint" if agent.blueprint is not None:
            return "catalogue", ("ego",)
        case _:
            return None, ()
