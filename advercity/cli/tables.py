"""Scenarios as text."""

from collections.abc import Mapping
from pathlib import Path

from advercity_dsl import Road, Spec

from advercity.compiler import read_spec
from advercity.errors import InputError


def spec_table(folder: Path) -> str:
    """One line per spec of a folder: id, crash groups, vehicles, walkers."""
    paths = sorted(folder.glob("*.json")) if folder.is_dir() else []
    if not paths:
        raise InputError(f"{folder}: no specs (*.json) here; `advercity compile` writes them")
    rows = [("scenario", "vehicles", "walkers", "crash groups")]
    for path in paths:
        spec = read_spec(path)
        groups = " ".join(group.typology for group in spec.groups)
        rows.append((spec.id, str(spec.demand.vehicles), str(spec.demand.walkers), groups))
    widths = [max(len(row[column]) for row in rows) for column in range(3)]
    return "\n".join(
        f"{row[0]:<{widths[0]}}  {row[1]:>{widths[1]}}  {row[2]:>{widths[2]}}  {row[3]}"
        for row in rows
    )


def road_summary(road: Road) -> str:
    """What a road holds, line by line."""
    facts = {
        "road": f"{road.id}: {road.title}",
        "place": f"{road.land_use}, {road.junction}, {road.alignment}, {road.profile}",
        "streets": ", ".join(road.streets),
        "junctions": ", ".join(f"{name} ({item.control})" for name, item in road.junctions.items()),
        "agents": ", ".join(road.agents),
    }
    return _aligned(facts)


def summary(spec: Spec) -> str:
    """What a spec holds, line by line."""
    weather = spec.weather
    air = [f"air {weather.air.mor_m:g} m"] if weather.air.mor_m else []
    air += [f"fog {weather.fog.mor_m:g} m"] if weather.fog.mor_m else []
    air += [f"dust {weather.dust.mor_m:g} m"] if weather.dust.mor_m else []
    facts = {
        "scenario": spec.id,
        "road": f"{spec.road.id}: {spec.road.title}",
        "place": f"{spec.road.land_use}, {spec.road.junction}, {spec.road.alignment}, "
        f"{spec.road.profile}",
        "crash groups": ", ".join(group.typology for group in spec.groups),
        "weather": f"{weather.id}: {weather.title}",
        "visibility": ", ".join(air) or "unlimited",
        "rain, snow": f"{weather.rain.rate_mm_h:g}, {weather.snow.rate_mm_h:g} mm/h",
        "sun": f"elevation {weather.sun.elevation_deg:g} deg, "
        f"azimuth {weather.sun.azimuth_deg:g} deg",
        "traffic": f"{spec.demand.vehicles} vehicles, {spec.demand.walkers} walkers "
        f"({spec.density.id})",
        "agents": ", ".join(f"{agent.id} ({agent.number})" for agent in spec.agents),
        "seeds": f"traffic {spec.seeds.traffic}, sensors {spec.seeds.sensors}",
        "digest": spec.provenance.digest,
    }
    return _aligned(facts)


def _aligned(facts: Mapping[str, str]) -> str:
    width = max(len(name) for name in facts)
    return "\n".join(f"{name:<{width}}  {value}" for name, value in facts.items())
