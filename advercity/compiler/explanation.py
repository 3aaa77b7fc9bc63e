"""Where every value of a spec comes from: a line of a file, a default, or a rule."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import Any

from advercity_dsl import Declaration, RoadsideUnit, Spec

from advercity.compiler.comparison import leaves
from advercity.compiler.library import Entry, Library
from advercity.compiler.source import Where
from advercity.errors import InputError

RULES = {
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
class Origin:
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


def explained(spec: Spec, library: Library) -> list[Origin]:
    """The origin of every value of a spec.

    Raises:
        InputError: The library is not what the spec was compiled from.
    """
    entries = _entries(spec, library)
    found = leaves(spec.model_dump(mode="json"))
    return [Origin(path, value, _origin(path, spec, entries)) for path, value in found.items()]


def _entries(spec: Spec, library: Library) -> dict[str, Entry[Declaration]]:
    entries: dict[str, Entry[Declaration]] = {}
    for name, digest in spec.provenance.declarations.items():
        kind, identifier = name.split("/")
        entry = library.entries.get((kind, identifier))
        if entry is None or entry.digest != digest:
            what = "is not in this library" if entry is None else "has changed since"
            raise InputError(f"{spec.id}: {kind} '{identifier}' {what}; compile the library again")
        entries[kind] = entry
    return entries


def _origin(path: str, spec: Spec, entries: Mapping[str, Entry[Declaration]]) -> str:
    provenance = spec.provenance
    if path in provenance.draws:
        drawn = provenance.draws[path].model_dump(exclude_none=True)
        return f"drawn from {drawn}, {_written(path, spec, entries)}"
    if provenance.sweep and path == provenance.sweep.field:
        source = entries["suite"].source
        return f"step of the sweep, {source.document.path}:{source.place(('sweep',)).line}"
    for beginning, rule in RULES.items():
        if path == beginning or path.startswith(f"{beginning}."):
            return f"rule: {rule}"
    return _written(path, spec, entries)


def _written(path: str, spec: Spec, entries: Mapping[str, Entry[Declaration]]) -> str:
    kind, where = _declared(path, spec)
    if kind is None:
        return "rule: written by the compiler"
    source = entries[kind].source
    own_sun = ("sun_at", spec.road.id, *where[1:])
    if kind == "weather" and where[:1] == ("sun",) and source.has(own_sun[:2]):
        where = own_sun
    if not source.has(where):
        return "default"
    at = source.place(where)
    return f"{source.document_of(where).path}:{at.line}:{at.column}"


def _declared(path: str, spec: Spec) -> tuple[str | None, Where]:
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
            return _agent(spec, where)
        case _:
            return None, ()


def _agent(spec: Spec, where: Where) -> tuple[str | None, Where]:
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
