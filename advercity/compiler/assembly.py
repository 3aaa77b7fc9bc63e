"""What drivers do about a weather, from their tables.

Makes specs of scenes, and of specs under another weather.
"""

import hashlib
from collections.abc import Sequence
from typing import Literal

import numpy as np
from advercity_dsl import (
    Agent,
    Catalogue,
    Density,
    DriverResponse,
    Drivers,
    Rig,
    Road,
    RoadsideUnit,
    SensorSet,
    Spec,
    Suite,
    Weather,
    get_declaration_kind,
)
from advercity_dsl.conflict import StagedConflict
from advercity_dsl.distribution import Distribution
from advercity_dsl.spec import ClassDemand, CrashGroup, Provenance, SpecSeeds, SweepPoint
from advercity_dsl.traffic import ResponseStep

from advercity import __version__
from advercity.compiler.distributions import Distributions
from advercity.compiler.library import Library, LibraryEntry
from advercity.compiler.scenarios import (
    ScenarioInputs,
    SweepStep,
    build_spec_id,
    draw_scenario_weather,
    localize_weather,
)
from advercity.compiler.source import format_value_path
from advercity.digests import compute_json_digest
from advercity.physics.constants import GRAVITY_M_S2
from advercity.physics.extinction import mor_without_precipitation_m
from advercity.physics.stopping import friction_coefficient


def compute_driver_response(drivers: Drivers, weather: Weather) -> DriverResponse:
    """How much slower, farther apart and more gently drivers drive under a weather."""
    tables = _get_response_tables(drivers, weather)
    grip_m_s2 = GRAVITY_M_S2 * friction_coefficient(drivers.grip, weather)
    slower = max(_interpolate_response("slower_percent", *table) for table in tables)
    headway_s = max(_interpolate_response("headway_s", *table) for table in tables)
    return DriverResponse(
        speed_share=round(1 - slower / 100, 4),
        headway_s=round(headway_s, 3),
        usual_m_s2=round(drivers.grip.used_share * grip_m_s2, 3),
        hardest_m_s2=round(grip_m_s2, 3),
    )


ResponseTable = tuple[Sequence[ResponseStep], Sequence[float], float]
"""Steps, the intensity of each, and the intensity that is there."""


def _get_response_tables(drivers: Drivers, weather: Weather) -> tuple[ResponseTable, ...]:
    rain, snow = weather.rain, weather.snow
    rates = [step.rate_mm_h for step in drivers.rain]
    snow_rates = [step.rate_mm_h for step in drivers.snowfall]
    covers = [step.road_coverage for step in drivers.snow_cover]
    nearness = [-step.mor_m for step in drivers.visibility]
    return (
        (drivers.rain, rates, rain.rate_mm_h),
        (drivers.snowfall, snow_rates, snow.rate_mm_h),
        (drivers.snow_cover, covers, snow.road_coverage),
        (drivers.visibility, nearness, -mor_without_precipitation_m(weather)),
    )


def _interpolate_response(
    what: Literal["slower_percent", "headway_s"],
    steps: Sequence[ResponseStep],
    intensities: Sequence[float],
    there: float,
) -> float:
    if not steps or there < intensities[0]:
        return 0.0
    return float(np.interp(there, intensities, [getattr(step, what) for step in steps]))


SPAWN_AREAS = 8
"""A square around each of five agents and a box along each of three paths."""


def build_spec(
    library: Library,
    suite: Suite,
    scene: ScenarioInputs,
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
    digests = {
        f"{get_declaration_kind(item)}/{item.id}": library.find_entry(item).digest for item in parts
    }
    spec = Spec(
        id=scene.id,
        groups=groups,
        road=road,
        weather=scene.weather,
        density=density,
        agents=_build_agents(road, scene.rig, scene.catalogue),
        demand=_compute_demand(road, density),
        conflicts=conflicts,
        drivers=drivers,
        caution=compute_driver_response(drivers, scene.weather) if drivers else None,
        blueprints=scene.blueprints,
        timing=suite.timing,
        seeds=SpecSeeds(
            traffic=_derive_seed(suite.seeds.traffic, "traffic", road.id, density.id),
            sensors=suite.seeds.sensors,
            weather=suite.seeds.weather,
        ),
        provenance=Provenance(
            compiler=__version__,
            suite=suite.id,
            declarations=dict(sorted(digests.items())),
            draws=_format_draws(scene.draws),
            conflict=scene.cell.crossed.id if scene.cell.crossed else None,
            sweep=SweepPoint(field=scene.step.field, value=scene.step.value)
            if scene.step
            else None,
            digest="0" * 64,
        ),
    )
    return with_digest(spec)


def _format_draws(draws: Distributions) -> dict[str, Distribution]:
    return {f"weather.{format_value_path(where)}": item for where, item in draws.items()}


def with_digest(spec: Spec) -> Spec:
    """The spec with its own digest filled in."""
    data = spec.model_dump(mode="json")
    del data["provenance"]["digest"]
    provenance = spec.provenance.model_copy(update={"digest": compute_json_digest(data)})
    return spec.model_copy(update={"provenance": provenance})


def with_weather(spec: Spec, entry: LibraryEntry[Weather]) -> Spec:
    """The same scenario under another weather: what the suite would have compiled to."""
    sources = {
        name: digest
        for name, digest in spec.provenance.declarations.items()
        if not name.startswith("weather/")
    }
    sources[f"weather/{entry.declaration.id}"] = entry.digest
    swept = spec.provenance.sweep
    step = SweepStep(swept.field, swept.value) if swept else None
    crossed = spec.provenance.conflict
    name = build_spec_id(spec.road, entry.declaration, spec.density, step, crossed)
    weather, draws = draw_scenario_weather(entry, spec.seeds.weather, name, step)
    provenance = spec.provenance.model_copy(
        update={"declarations": dict(sorted(sources.items())), "draws": _format_draws(draws)}
    )
    return with_digest(
        spec.model_copy(
            update={
                "id": name,
                "weather": localize_weather(entry, weather, spec.road),
                "caution": compute_driver_response(spec.drivers, weather) if spec.drivers else None,
                "provenance": provenance,
            }
        )
    )


def _build_agents(road: Road, rig: Rig, catalogue: Catalogue) -> tuple[Agent, ...]:
    agents: list[Agent] = []
    units = 0
    for name, place in road.agents.items():
        if isinstance(place, RoadsideUnit):
            units += 1
            sensors = _build_roadside_sensors(rig.roadside_unit, place)
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


def _build_roadside_sensors(carrier: SensorSet, unit: RoadsideUnit) -> SensorSet:
    if unit.lidar_upper_deg is None:
        return carrier
    lidar = carrier.lidar.model_copy(update={"upper_deg": unit.lidar_upper_deg})
    return carrier.model_copy(update={"lidar": lidar})


def _compute_demand(road: Road, density: Density) -> ClassDemand:
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


def _derive_seed(base: int, *purpose: str) -> int:
    digest = hashlib.blake2b("/".join((str(base), *purpose)).encode(), digest_size=4).digest()
    return int.from_bytes(digest, "little")
