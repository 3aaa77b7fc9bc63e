"""Makes specs of scenes, and of specs under another weather."""

import hashlib

from advercity_dsl import (
    Agent,
    Carrier,
    Catalogue,
    Density,
    Drivers,
    Rig,
    Road,
    RoadsideUnit,
    Spec,
    Suite,
    Weather,
    kind_of,
)
from advercity_dsl.distribution import Distribution
from advercity_dsl.spec import ClassDemand, CrashGroup, Provenance, SpecSeeds, StagedConflict, Swept

from advercity import __version__
from advercity.compiler.caution import caution
from advercity.compiler.distributions import Distributions
from advercity.compiler.library import Entry, Library, digest_of
from advercity.compiler.scenes import Scene, spec_id, weather_at, weather_of
from advercity.compiler.source import dotted
from advercity.compiler.variation import Step

SPAWN_AREAS = 8
"""A square around each of five agents and a box along each of three paths."""


def assembled(
    library: Library,
    suite: Suite,
    scene: Scene,
    groups: tuple[CrashGroup, ...],
    conflicts: tuple[StagedConflict, ...],
    drivers: Drivers | None,
) -> Spec:
    """The spec of a scene, its digest filled in.

    Args:
        library: Where the declarations are.
        suite: What was crossed.
        scene: What the scenario is made of.
        groups: The typologies that its road is here for.
        conflicts: As they are staged in its traffic.
        drivers: How weather makes people drive; None leaves them as they are.
    """
    road, density = scene.road, scene.density
    parts = (suite, road, scene.weather, density, scene.rig, scene.catalogue)
    parts += (*scene.cell.conflicts, *([drivers] if drivers else []))
    digests = {f"{kind_of(item)}/{item.id}": library.entry(item).digest for item in parts}
    spec = Spec(
        id=scene.id,
        groups=groups,
        road=road,
        weather=scene.weather,
        density=density,
        agents=_agents(road, scene.rig, scene.catalogue),
        demand=_demand(road, density),
        conflicts=conflicts,
        drivers=drivers,
        caution=caution(drivers, scene.weather) if drivers else None,
        blueprints=scene.blueprints,
        timing=suite.timing,
        seeds=SpecSeeds(
            traffic=_seed(suite.seeds.traffic, "traffic", road.id, density.id),
            sensors=suite.seeds.sensors,
            weather=suite.seeds.weather,
        ),
        provenance=Provenance(
            compiler=__version__,
            suite=suite.id,
            declarations=dict(sorted(digests.items())),
            draws=_recorded(scene.draws),
            conflict=scene.cell.crossed.id if scene.cell.crossed else None,
            sweep=Swept(field=scene.step.field, value=scene.step.value) if scene.step else None,
            digest="0" * 64,
        ),
    )
    return sealed(spec)


def _recorded(draws: Distributions) -> dict[str, Distribution]:
    return {f"weather.{dotted(where)}": item for where, item in draws.items()}


def sealed(spec: Spec) -> Spec:
    """The spec with its own digest filled in."""
    data = spec.model_dump(mode="json")
    del data["provenance"]["digest"]
    provenance = spec.provenance.model_copy(update={"digest": digest_of(data)})
    return spec.model_copy(update={"provenance": provenance})


def under(spec: Spec, entry: Entry[Weather]) -> Spec:
    """The same scenario under another weather: what the suite would have compiled to."""
    sources = {
        name: digest
        for name, digest in spec.provenance.declarations.items()
        if not name.startswith("weather/")
    }
    sources[f"weather/{entry.declaration.id}"] = entry.digest
    swept = spec.provenance.sweep
    step = Step(swept.field, swept.value) if swept else None
    crossed = spec.provenance.conflict
    name = spec_id(spec.road, entry.declaration, spec.density, step, crossed)
    weather, draws = weather_of(entry, spec.seeds.weather, name, step)
    provenance = spec.provenance.model_copy(
        update={"declarations": dict(sorted(sources.items())), "draws": _recorded(draws)}
    )
    return sealed(
        spec.model_copy(
            update={
                "id": name,
                "weather": weather_at(entry, weather, spec.road),
                "caution": caution(spec.drivers, weather) if spec.drivers else None,
                "provenance": provenance,
            }
        )
    )


def _agents(road: Road, rig: Rig, catalogue: Catalogue) -> tuple[Agent, ...]:
    agents: list[Agent] = []
    units = 0
    for name, place in road.agents.items():
        if isinstance(place, RoadsideUnit):
            units += 1
            sensors = _unit_sensors(rig.roadside_unit, place)
            agents.append(Agent(id=name, number=-units, place=place, sensors=sensors))
        else:
            number = 101 + len(agents) - units
            agents.append(
                Agent(
                    id=name,
                    number=number,
                    place=place,
                    sensors=rig.vehicle,
                    blueprint=catalogue.ego,
                )
            )
    return tuple(agents)


def _unit_sensors(carrier: Carrier, unit: RoadsideUnit) -> Carrier:
    if unit.lidar_upper_deg is None:
        return carrier
    lidar = carrier.lidar.model_copy(update={"upper_deg": unit.lidar_upper_deg})
    return carrier.model_copy(update={"lidar": lidar})


def _demand(road: Road, density: Density) -> ClassDemand:
    asked = road.traffic
    return ClassDemand(
        vehicles=SPAWN_AREAS * round(asked.vehicles_per_area * density.vehicles),
        walkers=round(asked.walkers * density.walkers),
        crossing_share=asked.crossing_share,
        classes=asked.classes,
        around_agent_m=asked.around_agent_m,
        around_path_m=asked.around_path_m,
        speed_offset_percent=asked.speed_offset_percent,
    )


def _seed(base: int, *purpose: str) -> int:
    digest = hashlib.blake2b("/".join((str(base), *purpose)).encode(), digest_size=4).digest()
    return int.from_bytes(digest, "little")
