"""Describes specs and declarations as rows and facts for the command line."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from advercity_dsl import (
    Agent,
    Channel,
    Declaration,
    DriverResponse,
    Lidar,
    Road,
    Spec,
    StagedConflict,
    Timing,
    TrajectorySet,
    Weather,
)
from advercity_dsl.sensor_kinds import load_sensor_kinds
from advercity_dsl.sun_position import is_without_zone
from advercity_dsl.weather_components import Sun

from advercity.compiler import LibraryEntry, compare_specs, load_library, read_spec
from advercity.compiler.explain import ValueOrigin, flatten_values
from advercity.compiler.source import format_value_path
from advercity.documents import suggest_path
from advercity.errors import InputError
from advercity.foreign.ledger import describe_left_out
from advercity.output_files import is_dataset_or_scenario
from advercity.physics.extinction import (
    AirExtinction,
    compute_extinction,
    mor_from_extinction,
)
from advercity.physics.moonlight import compute_moonlight
from advercity.physics.sky import daylight_for_weather, derive_daylight
from advercity.physics.stopping import compute_stopping_distance
from advercity.physics.weather_parts.part import list_deposits
from advercity.physics.weather_text import format_weather
from advercity.recordings.track_file import unpack_tracks
from advercity.roads.junction_arms import JunctionArms
from advercity.roads.plan_frame import to_plan_frame
from advercity.roads.routes import RoutePlanner
from advercity.sensors.lidar.received_power import Receiver

ICE_DENSITY = 0.917
"""Of clear ice, relative to water."""

Description = Mapping[str, str]
TARGET_REFLECTANCES = (0.1, 0.5, 0.8)
"""Reflectances of the targets of LiDAR ranges: dark car, concrete, white paint."""


def load_rows(folder: Path) -> list[dict[str, Any]]:
    """Load one row per spec of a folder, or per declaration of a library."""
    if is_dataset_or_scenario(folder):
        raise InputError(
            f"{folder}: is a dataset; `advercity stats` describes it, and `advercity list` lists"
            " specs and declarations"
        )
    specs = sorted(folder.glob("*.json")) if folder.is_dir() else []
    if specs:
        return [_build_spec_row(read_spec(path)) for path in specs]
    if not folder.is_dir():
        near = suggest_path(folder) or "`advercity compile` makes a folder of specs"
        found = "is a file; name its folder" if folder.exists() else f"no such folder; {near}"
        raise InputError(f"{folder}: {found}")
    if not any(folder.iterdir()):
        raise InputError(f"{folder}: no specs (*.json) here; `advercity compile` writes them")
    return [_build_declaration_row(kind, entry) for kind, entry in _load_entries(folder)]


def _build_spec_row(spec: Spec) -> dict[str, Any]:
    vehicles, walkers = _count_actors(spec)
    return {
        "scenario": spec.id,
        "vehicles": vehicles,
        "walkers": walkers,
        "weather": format_weather(spec.weather),
        "crash groups": " ".join(group.typology for group in spec.groups),
    }


def _count_actors(spec: Spec) -> tuple[int, int]:
    """Count the demanded or recorded vehicles and pedestrians of a spec."""
    recorded = spec.road.trajectories
    if not isinstance(recorded, TrajectorySet):
        return spec.demand.vehicles, spec.demand.walkers
    classes = [track.actor_class for track in unpack_tracks(recorded)]
    walkers = classes.count("pedestrian")
    return len(classes) - walkers, walkers


def _describe_traffic(spec: Spec) -> str:
    vehicles, walkers = _count_actors(spec)
    recorded = spec.road.trajectories
    if recorded is not None:
        span = f"{recorded.from_s:g} to {recorded.to_s:g} s"
        return f"recorded, {span}: {vehicles} vehicles, {walkers} on foot"
    density = spec.density
    return (
        f"{vehicles} vehicles, {walkers} walkers: density {density.id}, {density.vehicles:g} and"
        f" {density.walkers:g} times the road's own"
    )


def _load_entries(folder: Path) -> list[tuple[str, LibraryEntry[Declaration]]]:
    return [(kind, entry) for (kind, _), entry in sorted(load_library(folder).entries.items())]


def _build_declaration_row(kind: str, entry: LibraryEntry[Declaration]) -> dict[str, Any]:
    declaration = entry.declaration
    file = entry.source.document.path
    return {"kind": kind, "id": declaration.id, "title": declaration.title, "file": str(file)}


def describe_declaration(entry: LibraryEntry[Declaration]) -> Description:
    """Describe a declaration."""
    declaration = entry.declaration
    if isinstance(declaration, Weather):
        drawn = {
            f"drawn {format_value_path(where)}": str(item.model_dump())
            for where, item in entry.distributions.items()
        }
        return {**describe_weather(declaration), **drawn}
    if isinstance(declaration, Road):
        left_out = {f"no agents at {name}": reason for name, reason in entry.left_out.items()}
        return {**describe_road(declaration), **left_out}
    plain = declaration.model_dump(mode="json", exclude_unset=True)
    return {name: str(value) for name, value in flatten_values(plain).items()}


def describe_weather(weather: Weather) -> Description:
    """Describe a weather and the values derived from it."""
    air = compute_extinction(weather)
    receiver = Receiver.from_lidar(Lidar())
    ranges_m = [receiver.detection_range_m(item, air.at_905nm) for item in TARGET_REFLECTANCES]
    facts = {
        "weather": _format_title(weather),
        "summary": format_weather(weather),
        "visibility": _describe_visibility(air),
        "extinction": f"{air.at_550nm:.5f} 1/m at 550 nm, {air.at_905nm:.5f} 1/m at 905 nm",
        "LiDAR range": f"{', '.join(f'{item:.0f}' for item in ranges_m)} m for targets of "
        f"{', '.join(f'{target:.0%}' for target in TARGET_REFLECTANCES)}, in the dark",
        "light": _describe_light(weather),
        **_describe_sun_time(weather.sun),
        "ground": _describe_ground(weather),
        "source": weather.source or "none given",
    }
    later = {
        f"at {keyframe.at_s:g} s": f"{format_weather(state)}; visibility"
        f" {_describe_visibility(compute_extinction(state))}; {_describe_light(state)}"
        for keyframe in weather.keyframes
        for state in [weather.at(keyframe.at_s)]
    }
    return facts | later | ({"assumption": weather.assumption} if weather.assumption else {})


def _format_title(declaration: Declaration) -> str:
    return f"{declaration.id}: {declaration.title}" if declaration.title else declaration.id


def _describe_visibility(air: AirExtinction) -> str:
    """Format the visibility, in total and with each part alone."""
    alone = [
        f"{part.name} {mor_from_extinction(part.extinction.at_550nm):.0f} m" for part in air.parts
    ]
    if math.isinf(air.mor_m):
        return "unlimited"
    return f"{air.mor_m:.0f} m ({', '.join(alone)} alone)"


def _describe_sun_time(sun: Sun) -> Description:
    """Describe the date and time of the sun position, if one is given."""
    if sun.at is None or sun.time_utc is None:
        return {}
    told = f"{sun.time_utc:%Y-%m-%d %H:%M} UTC"
    if is_without_zone(sun.at):
        told += " by longitude; legal time has its zone after it, such as Europe/Madrid"
    return {"sun's time": told}


def _describe_ground(weather: Weather) -> str:
    surface, rain = weather.surface, weather.rain
    facts = [
        f"wetness {surface.wetness:g}",
        f"puddles {surface.puddle_coverage:.0%}",
        *(
            f"{item.name} {1000 * item.depth_m:g} mm on {item.road_coverage:.0%} of the road"
            for item in list_deposits(weather)
        ),
    ]
    if surface.ice_mm:
        facts.append(f"ice {surface.ice_mm:g} mm")
    if rain.rate_mm_h and weather.temperature_c < 0:
        facts.append(f"freezing rain makes up to {rain.rate_mm_h / ICE_DENSITY:.2g} mm an hour")
    return ", ".join(facts)


def _describe_light(weather: Weather) -> str:
    if weather.time == "night":
        night, twilight_lx = weather.night, derive_daylight(weather).diffuse_lx
        sun = f"sun at {weather.sun.elevation_deg:.3g} deg, sky {twilight_lx:.2g} lx; "
        moonlight, height_deg = compute_moonlight(weather), weather.moon.elevation_deg
        moon = f"moon {moonlight.direct_lx:.2g} lx at {height_deg:.3g} deg; "
        shining = (sun if twilight_lx else "") + (moon if moonlight.diffuse_lx else "")
        return shining + (
            f"street lamps {night.street_lx.urban:g} lx in town, {night.street_lx.rural:g} lx"
            f" outside; sky {night.glow_cd_m2.urban:g}, {night.glow_cd_m2.rural:g} cd/m2"
        )
    if weather.sun.in_view_of is not None:
        found = ", ".join(weather.sun_at) or "no road yet"
        return f"sun in view of the {weather.sun.in_view_of}, found for {found}"
    light = daylight_for_weather(weather)
    return (
        f"sun {light.direct_lx:.0f} lx at {weather.sun.elevation_deg:.3g} deg, "
        f"sky {light.diffuse_lx:.0f} lx"
    )


def build_difference_rows(first: Spec, second: Spec) -> list[dict[str, Any]]:
    """List the differences between two specs, a row per field."""
    return [
        {"field": path, first.id: _format_value(one), second.id: _format_value(other)}
        for path, one, other in compare_specs(first, second)
    ]


def build_origin_rows(origins: Sequence[ValueOrigin]) -> list[dict[str, Any]]:
    """List the values of a spec with their origins, a row each."""
    return [
        {"field": item.path, "value": _format_value(item.value), "origin": item.text}
        for item in origins
    ]


def _format_value(value: Any) -> str:
    if value is None:
        return "-"
    return f"{value:.9g}" if isinstance(value, float) else str(value)


def describe_road(road: Road) -> Description:
    """Describe a road; an imported map with the arms of junctions of three arms or more."""
    planner = RoutePlanner(to_plan_frame(road))
    arms = {
        f"junction {name}": f"{planner.controls[name]}: {found.describe()}"
        for name in planner.movements
        if len((found := JunctionArms.of_road(road, name)).directions) > 2
    }
    declared = {
        "junctions": ", ".join(f"{name} ({item.control})" for name, item in road.junctions.items())
    }
    return {
        "road": _format_title(road),
        "place": f"{road.land_use}, {road.junction}, {road.alignment}, {road.profile}",
        "driving side": _describe_side(road),
        "streets": ", ".join(planner.streets),
        **(arms if road.imported else declared),
        "agents": ", ".join(road.agents),
        **_describe_left_out(road),
    }


def _describe_side(road: Road) -> str:
    return "left" if road.is_left_hand else "right"


def _describe_left_out(road: Road) -> Description:
    return {"left out": describe_left_out(road.left_out)} if road.left_out else {}


def describe_spec(spec: Spec) -> Description:
    """Describe a spec."""
    road = spec.road
    facts = {
        "scenario": spec.id,
        "road": _format_title(road),
        "place": f"{road.land_use}, {road.junction}, {road.alignment}, {road.profile}",
        "driving side": _describe_side(road),
        "crash groups": ", ".join(group.typology for group in spec.groups) or "none",
        "conflicts": ", ".join(_describe_conflict(item, spec.timing) for item in spec.conflicts)
        or "none",
        **_describe_left_out(road),
        **describe_weather(spec.weather),
        "stopping": str(compute_stopping_distance(spec)),
        "traffic": _describe_traffic(spec),
        **{f"agent {agent.id}": _describe_agent(agent) for agent in spec.agents},
        "seeds": f"traffic {spec.seeds.traffic}, sensors {spec.seeds.sensors}, "
        f"weather {spec.seeds.weather}",
        "digest": spec.provenance.digest,
    }
    if spec.drivers and spec.caution:
        facts["drivers"] = f"{spec.drivers.id}: {_describe_driver_response(spec.caution)}"
    if spec.channel:
        facts["channel"] = _describe_channel(spec.channel)
    swept = [f"{point.field} at {point.value:g}" for point in spec.provenance.sweep_points]
    drawn = {f"drawn {path}": str(item) for path, item in spec.provenance.draws.items()}
    return facts | drawn | ({"sweep": ", ".join(swept)} if swept else {})


def _describe_conflict(conflict: StagedConflict, timing: Timing) -> str:
    """Describe a conflict and the frame in which an unhindered ego would meet it."""
    frame = round(conflict.window_s[0] / timing.tick_s) - timing.warm_up_ticks
    return f"{conflict.conflict}, expected from frame {frame} on"


def _describe_agent(agent: Agent) -> str:
    """Describe an agent and its sensors: `101, ego, box_truck: 4 cameras, 1 LiDAR`."""
    sensors = agent.sensors
    carried = [
        f"{len(items)} {kind.title}{'s' if len(items) > 1 else ''}"
        for kind in load_sensor_kinds().found.values()
        if kind.has_place and (items := sensors.list_sensors(kind.name))
    ]
    role = ["ego"] if agent.is_ego else []
    kind = [agent.blueprint or "roadside unit"]
    return f"{', '.join([str(agent.number), *role, *kind])}: {', '.join(carried)}"


def _describe_channel(channel: Channel) -> str:
    """Describe the messages of a channel and its limits."""
    kinds = {"CAM": channel.cam, "CPM": channel.cpm, "data": channel.data}
    limits = {
        "radio": channel.radio is not None,
        f"{channel.range_m or 0:g} m": channel.range_m is not None,
        f"{channel.rate_mbit_s or 0:g} Mbit/s": channel.rate_mbit_s is not None,
        f"{channel.loss.total_rate:.1%} lost": channel.loss.total_rate > 0,
    }
    sent = ", ".join(name for name, item in kinds.items() if item)
    limited = ", ".join(name for name, is_set in limits.items() if is_set)
    return f"{channel.id}: {sent}; {limited or 'everything arrives'}"


def _describe_driver_response(caution: DriverResponse) -> str:
    return (
        f"{1 - caution.speed_share:.0%} slower, {caution.headway_s:.2f} s more headway; they use"
        f" {caution.usual_m_s2:.1f} m/s2, {caution.hardest_m_s2:.1f} in an emergency"
    )
