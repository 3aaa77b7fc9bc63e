"""Assembly of specs from the inputs of a scenario, and of specs with another weather."""

import hashlib
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from advercity_dsl import (
    Agent,
    Blueprint,
    Density,
    DriverResponse,
    Drivers,
    Model,
    Rig,
    Road,
    RoadsideUnit,
    SensorSet,
    Spec,
    Suite,
    TimedDriverResponse,
    Timing,
    Weather,
    get_declaration_kind,
)
from advercity_dsl.conflict import StagedConflict
from advercity_dsl.distribution import Distribution
from advercity_dsl.spec import ClassDemand, CrashGroup, Provenance, SpecSeeds, SweepPoint
from advercity_dsl.traffic import ReactionConditions, ResponseStep, TyreFriction

from advercity import __version__
from advercity.compiler.distributions import Distributions
from advercity.compiler.library import Library, LibraryEntry
from advercity.compiler.scenarios import (
    ScenarioInputs,
    SweepStep,
    SweepSteps,
    build_spec_id,
    draw_scenario_weather,
    localize_weather,
)
from advercity.compiler.settling import SolvedTraffic
from advercity.compiler.source import format_value_path
from advercity.compiler.suites import ResolvedSuite, compute_demand_counts, select_sensors
from advercity.digests import compute_json_digest
from advercity.identity_cache import cache_by_identity
from advercity.physics.constants import GRAVITY_M_S2
from advercity.physics.extinction import compute_extinction, mor_without_precipitation_m
from advercity.physics.stopping import DEFAULT_GRIP, friction_coefficient

MAX_RESPONSES = 1000
"""Number of responses of drivers to a changing weather, at most one a second."""
MAX_DUMPED_MODELS = 4096
FIRST_VEHICLE_NUMBER = 101
"""Number of the first connected vehicle in annotations; roadside units count down from -1."""


def build_spec(
    library: Library,
    inputs: ScenarioInputs,
    groups: tuple[CrashGroup, ...],
    traffic: SolvedTraffic,
    resolved: ResolvedSuite,
    assets: Mapping[str, str],
) -> Spec:
    """Build the spec of a scenario, with its digest.

    Args:
        library: Library of all declarations.
        inputs: Declarations of the scenario, with the road of its traffic.
        groups: Crash groups for which its road was selected; the spec has the staged ones.
        traffic: Its suite, and the solved conflicts.
        resolved: Declarations of the suite.
        assets: Checksums of the scenario's foreign files.
    """
    suite, conflicts = traffic.suite, traffic.conflicts
    road, density, drivers = inputs.road, inputs.density, resolved.drivers
    declarations = [suite, road, inputs.weather, density, inputs.rig, inputs.catalogue]
    declarations += [*inputs.conflicts.conflicts, *([drivers] if drivers else [])]
    declarations += resolved.agent_rigs.values()
    declarations += [resolved.channel] if resolved.channel else []
    digests = {
        f"{get_declaration_kind(item)}/{item.id}": library.find_entry(item).digest
        for item in declarations
    }
    staged = {conflict.typology for conflict in conflicts}
    spec = Spec(
        id=inputs.id,
        groups=tuple(group for group in groups if group.typology in staged),
        road=road,
        weather=inputs.weather,
        density=density,
        agents=_build_agents(suite, inputs, resolved.agent_rigs),
        demand=_compute_demand(road, density),
        conflicts=conflicts,
        drivers=drivers,
        **_compute_driver_responses(drivers, inputs.weather, suite.timing),
        reaction=_find_reaction_conditions(library, suite, resolved, inputs.weather, conflicts),
        channel=inputs.channel,
        blueprints=inputs.blueprints,
        assets=dict(sorted(assets.items())),
        timing=suite.timing,
        seeds=SpecSeeds(
            traffic=_derive_seed(suite.seeds.traffic, "traffic", inputs),
            sensors=suite.seeds.sensors
            if inputs.is_paired
            else _derive_seed(suite.seeds.sensors, "sensors", inputs),
            weather=suite.seeds.weather,
        ),
        provenance=Provenance(
            compiler=__version__,
            suite=suite.id,
            declarations=dict(sorted(digests.items())),
            draws=_format_draws(inputs.draws),
            conflict=inputs.conflicts.crossed_id,
            sweep=_record_sweeps(inputs.steps),
            repeat=inputs.repeat,
            settled=traffic.settlement,
            # Replaced below, since the digest covers everything but itself.
            digest="0" * 64,
        ),
    )
    return with_digest(spec)


def _record_sweeps(steps: SweepSteps) -> SweepPoint | tuple[SweepPoint, ...] | None:
    points = tuple(SweepPoint(field=step.field, value=step.value) for step in steps)
    return points if len(points) > 1 else next(iter(points), None)


def with_weather(spec: Spec, entry: LibraryEntry[Weather]) -> Spec:
    """Return the scenario under another weather, equal to its suite's own spec for it."""
    provenance, declared = spec.provenance, entry.declaration
    steps = tuple(SweepStep(point.field, point.value) for point in provenance.sweep_points)
    name = build_spec_id(
        spec.road, declared, spec.density, steps, provenance.conflict, provenance.repeat
    )
    weather, draws = draw_scenario_weather(entry, spec.seeds.weather, name, steps)
    digests = {
        key: digest
        for key, digest in provenance.declarations.items()
        if not key.startswith("weather/")
    }
    digests[f"weather/{declared.id}"] = entry.digest
    changes = {
        "id": name,
        "weather": localize_weather(entry, weather, spec.road),
        **_compute_driver_responses(spec.drivers, weather, spec.timing),
        "reaction": _replay_reaction_conditions(spec, weather),
        "provenance": provenance.model_copy(
            update={"declarations": dict(sorted(digests.items())), "draws": _format_draws(draws)}
        ),
    }
    replayed = spec.model_copy(update=changes)
    # An edited spec stays one under every weather.
    return replayed if is_edited(spec) else with_digest(replayed)


def _format_draws(draws: Distributions) -> dict[str, Distribution]:
    return {f"weather.{format_value_path(path)}": item for path, item in draws.items()}


def with_digest(spec: Spec) -> Spec:
    """Return the spec with the digest of its content, as a compiler of other specs would."""
    data = dump_spec(spec)
    del data["provenance"]["digest"]
    # In their order, which streets and blueprints are drawn in: another one is other traffic.
    digest = compute_json_digest(data, sort_keys=False)
    provenance = spec.provenance.model_copy(update={"digest": digest})
    return spec.model_copy(update={"provenance": provenance})


def dump_spec(spec: Spec) -> dict[str, Any]:
    """Convert a spec to plain data, as for JSON; common parts of specs are converted once."""
    data = spec.model_dump(mode="json", exclude={"road", "agents", "blueprints"})
    data["road"] = _dump_model(spec.road)
    data["agents"] = [_dump_model(agent) for agent in spec.agents]
    data["blueprints"] = {name: _dump_model(item) for name, item in spec.blueprints.items()}
    return {name: data[name] for name in type(spec).model_fields if name in data}


@cache_by_identity(MAX_DUMPED_MODELS)
def _dump_model(model: Model) -> dict[str, Any]:
    return model.model_dump(mode="json")


def is_edited(spec: Spec) -> bool:
    """Return whether a spec was changed since its compilation, by its digest."""
    # Files of earlier versions lack fields with a default now.
    dumps = (spec.model_dump(mode="json", exclude_unset=unset) for unset in (False, True))
    return not any(map(has_own_digest, dumps))


def has_own_digest(data: dict[str, Any]) -> bool:
    """Return whether a spec's JSON matches its digest, which is removed.

    Release 0.1.0 computed it without sorting keys.
    """
    digest = data["provenance"].pop("digest")
    return digest in (compute_json_digest(data, sort_keys=False), compute_json_digest(data))


def _find_reaction_conditions(
    library: Library,
    suite: Suite,
    resolved: ResolvedSuite,
    weather: Weather,
    conflicts: Sequence[StagedConflict],
) -> ReactionConditions | None:
    """Find the ego's reaction conditions: the suite's weather for it, or the scenario's own."""
    if not any(conflict.resolved_by in ("ego", "both") for conflict in conflicts):
        return None
    grip = resolved.drivers.grip if resolved.drivers else DEFAULT_GRIP
    if suite.pairing == "none":
        return compute_reaction_conditions(grip, weather)
    reference = resolved.reaction_weather
    if reference is None:
        return ReactionConditions(friction=grip.dry, is_paired=True)
    entry, seed = library.find_entry(reference), suite.seeds.weather
    drawn, _ = draw_scenario_weather(entry, seed, reference.id, ())
    conditions = compute_reaction_conditions(grip, drawn)
    return conditions.model_copy(update={"is_paired": True})


def _replay_reaction_conditions(spec: Spec, weather: Weather) -> ReactionConditions | None:
    if spec.reaction is None or spec.reaction.is_paired:
        return spec.reaction
    grip = spec.drivers.grip if spec.drivers else DEFAULT_GRIP
    return compute_reaction_conditions(grip, weather)


def compute_reaction_conditions(grip: TyreFriction, weather: Weather) -> ReactionConditions:
    """Compute the ego's reaction conditions in a weather, rounded like the response of drivers.

    For a changing weather, they are the worst of its keyframes.
    """
    times_s = [0.0, *(keyframe.at_s for keyframe in weather.keyframes)]
    moments = [weather.at(time_s) for time_s in times_s]
    mor_m = min(compute_extinction(moment).mor_m for moment in moments)
    return ReactionConditions(
        friction=round(min(friction_coefficient(grip, moment) for moment in moments), 4),
        visibility_m=round(mor_m, 1) if math.isfinite(mor_m) else None,
    )


def _compute_driver_responses(
    drivers: Drivers | None, weather: Weather, timing: Timing
) -> dict[str, Any]:
    """Compute the fields of a spec for the response of its drivers to its weather."""
    if drivers is None:
        return {"caution": None, "caution_changes": ()}
    first = last = compute_driver_response(drivers, weather.at(0.0))
    changes: list[TimedDriverResponse] = []
    end_s = max((keyframe.at_s for keyframe in weather.keyframes), default=0.0)
    end_s = min(end_s, timing.max_ticks * timing.tick_s)
    step_s = max(1.0, end_s / MAX_RESPONSES)
    for number in range(1, math.ceil(end_s / step_s) + 1):
        at_s = min(number * step_s, end_s)
        response = compute_driver_response(drivers, weather.at(at_s))
        if response != last:
            changes.append(TimedDriverResponse(at_s=at_s, **response.model_dump()))
        last = response
    return {"caution": first, "caution_changes": tuple(changes)}


def compute_driver_response(drivers: Drivers, weather: Weather) -> DriverResponse:
    """Compute speed, headway and accelerations of drivers under a weather from their tables."""
    # Intensities must rise from step to step, and the effect rises as visibility falls.
    nearness = -mor_without_precipitation_m(weather)
    tables: list[tuple[Sequence[ResponseStep], list[float], float]] = [
        (drivers.rain, [step.rate_mm_h for step in drivers.rain], weather.rain.rate_mm_h),
        (drivers.snowfall, [step.rate_mm_h for step in drivers.snowfall], weather.snow.rate_mm_h),
        (
            drivers.snow_cover,
            [step.road_coverage for step in drivers.snow_cover],
            weather.snow.road_coverage,
        ),
        (drivers.visibility, [-step.mor_m for step in drivers.visibility], nearness),
    ]
    effects = [_interpolate(*table) for table in tables]
    # Effects were observed together in the field: adding them would count each twice.
    slower_percent, headway_s = (max(values) for values in zip(*effects, strict=True))
    grip_m_s2 = GRAVITY_M_S2 * friction_coefficient(drivers.grip, weather)
    # Rounded: the last bits of a machine's arithmetic must not change specs.
    return DriverResponse(
        speed_share=round(1 - slower_percent / 100, 4),
        headway_s=round(headway_s, 3),
        usual_m_s2=round(drivers.grip.used_share * grip_m_s2, 3),
        hardest_m_s2=round(grip_m_s2, 3),
    )


def _interpolate(
    steps: Sequence[ResponseStep], intensities: Sequence[float], intensity: float
) -> tuple[float, float]:
    """Interpolate reduction of speed in percent and headway in s; 0 below the first step."""
    if not steps or intensity < intensities[0]:
        return 0.0, 0.0
    slower_percent = [step.slower_percent for step in steps]
    headways_s = [step.headway_s for step in steps]
    return (
        float(np.interp(intensity, intensities, slower_percent)),
        float(np.interp(intensity, intensities, headways_s)),
    )


def find_ego_blueprint(suite: Suite, inputs: ScenarioInputs) -> Blueprint:
    """Find the blueprint of the ego, which a suite may choose."""
    name = next(name for name, place in inputs.road.agents.items() if place is inputs.road.ego)
    return inputs.catalogue.blueprints[_name_blueprint(suite, inputs, name)]


def _name_blueprint(suite: Suite, inputs: ScenarioInputs, agent: str) -> str:
    return suite.bodies.get(agent, inputs.catalogue.ego)


def _build_agents(
    suite: Suite, inputs: ScenarioInputs, rigs: Mapping[str, Rig]
) -> tuple[Agent, ...]:
    agents: list[Agent] = []
    units = 0
    for name, place in inputs.road.agents.items():
        sensors = select_sensors(place, rigs.get(name, inputs.rig))
        assert sensors is not None, f"{name} has no sensors, which the suite's check finds"
        if isinstance(place, RoadsideUnit):
            units += 1
            sensors = _limit_lidar(sensors, place)
            agents.append(Agent(id=name, number=-units, place=place, sensors=sensors))
            continue
        number = FIRST_VEHICLE_NUMBER + len(agents) - units
        blueprint = _name_blueprint(suite, inputs, name)
        agents.append(
            Agent(id=name, number=number, place=place, sensors=sensors, blueprint=blueprint)
        )
    return tuple(agents)


def _limit_lidar(sensors: SensorSet, unit: RoadsideUnit) -> SensorSet:
    if unit.lidar_upper_deg is None or sensors.lidar is None:
        return sensors
    lidar = sensors.lidar.model_copy(update={"upper_deg": unit.lidar_upper_deg})
    return sensors.model_copy(update={"lidar": lidar})


def _compute_demand(road: Road, density: Density) -> ClassDemand:
    traffic = road.traffic
    vehicles, walkers = compute_demand_counts(road, density)
    return ClassDemand(
        vehicles=vehicles,
        walkers=walkers,
        crossing_share=traffic.crossing_share,
        classes=traffic.classes,
        around_agent_m=traffic.around_agent_m,
        around_path_m=traffic.around_path_m,
        speed_offset_percent=traffic.speed_offset_percent,
    )


def _derive_seed(seed: int, purpose: str, inputs: ScenarioInputs) -> int:
    key = [str(seed), purpose, inputs.road.id, inputs.density.id, *inputs.sample_key]
    # hash() differs from process to process; 32 bits as for the seeds of suites.
    digest = hashlib.blake2b("/".join(key).encode(), digest_size=4).digest()
    return int.from_bytes(digest, "little")
