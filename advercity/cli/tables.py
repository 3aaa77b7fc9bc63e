"""Scenarios and declarations as facts, and facts as text."""

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from advercity_dsl import Caution, Declaration, Road, Spec, Weather

from advercity.compiler import Entry, compared, load_library, read_spec
from advercity.compiler.comparison import leaves
from advercity.compiler.explanation import Origin
from advercity.compiler.source import dotted
from advercity.errors import InputError
from advercity.sensors.lidar.reach import reach_m
from advercity.weather import extinction
from advercity.weather.daylight import daylight_of
from advercity.weather.stopping import stopping
from advercity.weather.words import in_words, visibility_m

Facts = Mapping[str, str]
TARGETS = (0.1, 0.5, 0.8)
"""Reflectances of the targets that LiDAR reach is told for: dark car, concrete, white paint."""


def rows_of(folder: Path) -> list[dict[str, Any]]:
    """One row per spec of a folder, or per declaration of a library."""
    specs = sorted(folder.glob("*.json")) if folder.is_dir() else []
    if specs:
        return [_spec_row(read_spec(path)) for path in specs]
    if not folder.is_dir():
        found = "is a file; name its folder" if folder.exists() else "there is no such folder"
        raise InputError(f"{folder}: {found}; `advercity compile` makes a folder of specs")
    if not any(folder.iterdir()):
        raise InputError(f"{folder}: no specs (*.json) here; `advercity compile` writes them")
    return [_declaration_row(kind, entry) for kind, entry in _entries(folder)]


def _spec_row(spec: Spec) -> dict[str, Any]:
    return {
        "scenario": spec.id,
        "vehicles": spec.demand.vehicles,
        "walkers": spec.demand.walkers,
        "weather": in_words(spec.weather),
        "crash groups": " ".join(group.typology for group in spec.groups),
    }


def _entries(folder: Path) -> list[tuple[str, Entry[Declaration]]]:
    return [(kind, entry) for (kind, _), entry in sorted(load_library(folder).entries.items())]


def _declaration_row(kind: str, entry: Entry[Declaration]) -> dict[str, Any]:
    declaration = entry.declaration
    file = entry.source.document.path
    return {"kind": kind, "id": declaration.id, "title": declaration.title, "file": str(file)}


def table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Rows below their heads, numbers to the right."""
    heads = list(rows[0])
    widths = [max(len(head), *(len(str(row[head])) for row in rows)) for head in heads]
    lines = [dict(zip(heads, heads, strict=True)), *rows]
    numbers = [isinstance(rows[0][head], int | float) for head in heads]
    cells = zip(heads, widths, numbers, strict=True)
    columns = [
        [f"{line[head]!s:>{width}}" if number else f"{line[head]!s:<{width}}" for line in lines]
        for head, width, number in cells
    ]
    return "\n".join("  ".join(row).rstrip() for row in zip(*columns, strict=True))


def as_json(data: Any) -> str:
    """The same for programs."""
    return json.dumps(data, indent=2, ensure_ascii=False)


def declaration_facts(entry: Entry[Declaration]) -> Facts:
    """What a declaration holds."""
    declaration = entry.declaration
    if isinstance(declaration, Weather):
        drawn = {
            f"drawn {dotted(where)}": str(item.model_dump())
            for where, item in entry.distributions.items()
        }
        return {**weather_facts(declaration), **drawn}
    if isinstance(declaration, Road):
        return road_facts(declaration)
    plain = declaration.model_dump(mode="json", exclude_unset=True)
    return {name: str(value) for name, value in leaves(plain).items()}


def weather_facts(weather: Weather) -> Facts:
    """A weather in words, and what follows from its figures."""
    total = extinction.of_weather(weather)
    reach = [reach_m(target, total.at_905nm) for target in TARGETS]
    facts = {
        "weather": _named(weather),
        "in words": in_words(weather),
        "visibility": _visibility(weather, visibility_m(total)),
        "extinction": f"{total.at_550nm:.5f} 1/m at 550 nm, {total.at_905nm:.5f} 1/m at 905 nm",
        "LiDAR reach": f"{', '.join(f'{item:.0f}' for item in reach)} m for targets of "
        f"{', '.join(f'{target:.0%}' for target in TARGETS)}, in the dark",
        "light": _light(weather),
        "ground": f"wetness {weather.surface.wetness:g}, "
        f"puddles {weather.surface.puddle_coverage:.0%}, "
        f"snow {weather.snow.depth_mm:g} mm on {weather.snow.road_coverage:.0%} of the road",
        "source": weather.source or "none given",
    }
    return facts | ({"assumption": weather.assumption} if weather.assumption else {})


def _named(declaration: Declaration) -> str:
    return f"{declaration.id}: {declaration.title}" if declaration.title else declaration.id


def _visibility(weather: Weather, total_m: float) -> str:
    snow, rain = weather.snow, weather.rain
    falling = {
        "rain": extinction.of_rain(rain.rate_mm_h, q_ext=rain.q_ext),
        "snow": extinction.of_snow(snow.rate_mm_h, density_g_cm3=snow.density_g_cm3),
    }
    parts = {"air": weather.air.mor_m, "fog": weather.fog.mor_m, "dust": weather.dust.mor_m}
    parts |= {name: extinction.KOSCHMIEDER / item for name, item in falling.items() if item}
    alone = [f"{name} {metres:.0f} m" for name, metres in parts.items() if metres is not None]
    if math.isinf(total_m):
        return "unlimited"
    return f"{total_m:.0f} m ({', '.join(alone)} alone)"


def _light(weather: Weather) -> str:
    if weather.time == "night":
        night = weather.night
        return (
            f"street lamps {night.street_lx.urban:g} lx in town, {night.street_lx.rural:g} lx"
            f" outside; sky {night.glow_cd_m2.urban:g}, {night.glow_cd_m2.rural:g} cd/m2"
        )
    if weather.sun.in_view_of is not None:
        found = ", ".join(weather.sun_at) or "no road yet"
        return f"sun in view of the {weather.sun.in_view_of}, found for {found}"
    light = daylight_of(weather)
    return (
        f"sun {light.direct_lx:.0f} lx at {weather.sun.elevation_deg:g} deg, "
        f"sky {light.diffuse_lx:.0f} lx"
    )


def difference_rows(first: Spec, second: Spec) -> list[dict[str, Any]]:
    """What differs between two specs, a row per field."""
    return [
        {"field": path, first.id: _shown(one), second.id: _shown(other)}
        for path, one, other in compared(first, second)
    ]


def origin_rows(origins: Sequence[Origin]) -> list[dict[str, Any]]:
    """Values of a spec and where they come from, a row each."""
    return [
        {"field": item.path, "value": _shown(item.value), "origin": item.text} for item in origins
    ]


def _shown(value: Any) -> str:
    if value is None:
        return "-"
    return f"{value:.9g}" if isinstance(value, float) else str(value)


def road_facts(road: Road) -> Facts:
    """What a road holds."""
    return {
        "road": _named(road),
        "place": f"{road.land_use}, {road.junction}, {road.alignment}, {road.profile}",
        "streets": ", ".join(road.streets),
        "junctions": ", ".join(f"{name} ({item.control})" for name, item in road.junctions.items()),
        "agents": ", ".join(road.agents),
    }


def spec_facts(spec: Spec) -> Facts:
    """What a spec holds."""
    road = spec.road
    facts = {
        "scenario": spec.id,
        "road": _named(road),
        "place": f"{road.land_use}, {road.junction}, {road.alignment}, {road.profile}",
        "crash groups": ", ".join(group.typology for group in spec.groups),
        **weather_facts(spec.weather),
        "stopping": str(stopping(spec)),
        "traffic": f"{spec.demand.vehicles} vehicles, {spec.demand.walkers} walkers "
        f"({spec.density.id})",
        "agents": ", ".join(f"{agent.id} ({agent.number})" for agent in spec.agents),
        "seeds": f"traffic {spec.seeds.traffic}, sensors {spec.seeds.sensors}, "
        f"weather {spec.seeds.weather}",
        "digest": spec.provenance.digest,
    }
    if spec.drivers and spec.caution:
        facts["drivers"] = f"{spec.drivers.id}: {_cautious(spec.caution)}"
    swept = spec.provenance.sweep
    drawn = {f"drawn {path}": str(item) for path, item in spec.provenance.draws.items()}
    return facts | drawn | ({"sweep": f"{swept.field} at {swept.value:g}"} if swept else {})


def _cautious(caution: Caution) -> str:
    return (
        f"{1 - caution.speed_share:.0%} slower, {caution.headway_s:.2f} s more headway; they use"
        f" {caution.usual_m_s2:.1f} m/s2, {caution.hardest_m_s2:.1f} in an emergency"
    )


def aligned(facts: Facts) -> str:
    """One line per fact."""
    width = max(len(name) for name in facts)
    return "\n".join(f"{name:<{width}}  {value}" for name, value in facts.items())
