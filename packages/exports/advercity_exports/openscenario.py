"""OpenSCENARIO XML 1.2 and OpenDRIVE 1.7: the whole traffic of a scenario, by time.

    <scenario>/<scenario>.xosc    entities, trajectories, weather, traffic lights
    <scenario>/site.xodr          the site

Both are right-handed with x east, y north, z up, and headings counter-clockwise from east, as here.
An entity is at its rear axle on the ground; its bounding box has its own centre. All
ticks are there, whichever frames the dataset has: the traffic is simulated again and compared.
"""

import datetime
import math
from collections.abc import Iterator, Mapping
from typing import Any
from xml.etree import ElementTree

import numpy as np
from advercity_dsl import Blueprint, Spec, Vehicle, Weather
from numpy.typing import NDArray

from advercity.dataset.reader import Dataset, Scenario
from advercity.errors import InputError
from advercity.exports.pieces import Piece, PieceFiles, split_by_scenario
from advercity.exports.registry import Options
from advercity.frames import WHEELBASE_FRACTION, Actor, Signal
from advercity.geometry.poses import pose_matrix, transform_points
from advercity.physics.extinction import compute_extinction
from advercity.physics.sky import daylight_for_weather
from advercity.physics.stopping import DEFAULT_GRIP, friction_coefficient
from advercity.pipeline.preparation import TrafficResult, load_or_simulate_traffic
from advercity.roads.network_file import read_signal_groups
from advercity_exports.libraries import load_library
from advercity_exports.site_opendrive import FIXED_DATE, format_site

SITE_FILE = "site.xodr"
EGO_NAME = "ego"
CATEGORIES = {
    "car": "car",
    "van": "van",
    "truck": "truck",
    "bicycle": "bicycle",
    "motorcycle": "motorbike",
}
TRAILER_CATEGORY = "semitrailer"
LAMPS = {Signal.RED: "on;off;off", Signal.YELLOW: "off;on;off", Signal.GREEN: "off;off;on"}
"""States of the lamps of a light, red first."""
OKTAS = ("zero", "one", "two", "three", "four", "five", "six", "seven", "eight")
CLEAR_RANGE_M = 100_000.0
"""Visual range of perfectly clear air."""
PEDESTRIAN_MASS_KG = 80.0
MAX_SPEED_M_S, MAX_ACCELERATION_M_S2 = 100.0, 15.0
"""Bounds of vehicles, required by the format; trajectories stay below them."""
MAX_STEERING_RAD, WHEEL_DIAMETER_M = 0.7, 0.65


def list_pieces(dataset: Dataset, options: Options) -> list[Piece]:
    """Make a piece of every scenario; InputError if scenariogeneration is not installed."""
    load_library("scenariogeneration.xosc", "openscenario")
    return split_by_scenario(dataset, _write_scenario)


def _write_scenario(scenario: Scenario, files: PieceFiles) -> None:
    traffic = load_dataset_traffic(scenario)
    name = scenario.path.name
    files.write(f"{name}/{name}.xosc", format_scenario(scenario.spec, traffic))
    files.write(f"{name}/{SITE_FILE}", format_site(scenario.spec.road, traffic.network_path))
    for _ in files.track(scenario):
        pass  # every frame is in the one file


def load_dataset_traffic(scenario: Scenario) -> TrafficResult:
    """Load or simulate the traffic of a scenario.

    Raises:
        InputError: It differs from the dataset's, made by another version.
    """
    identity = scenario.manifest.identity
    traffic = load_or_simulate_traffic(scenario.spec)
    if traffic.trace_sha256 != identity.trace_sha256:
        raise InputError(
            f"{scenario.path}: this version simulates other traffic than the version of the"
            " dataset; export it with that version, or make the dataset again"
        )
    return traffic


def format_scenario(spec: Spec, traffic: TrafficResult) -> bytes:
    """Format the traffic and the weather of a scenario, whose site is in `site.xodr`."""
    return _ScenarioWriter(spec, traffic).format()


class _ScenarioWriter:
    def __init__(self, spec: Spec, traffic: TrafficResult) -> None:
        self._xosc = load_library("scenariogeneration.xosc", "openscenario")
        self._spec, self._trace = spec, traffic.trace
        self._groups = read_signal_groups(traffic.network_path)
        self._agents = {
            agent.number: agent for agent in spec.agents if isinstance(agent.place, Vehicle)
        }

    def format(self) -> bytes:
        """Format the document."""
        xosc, trace = self._xosc, self._trace
        init, act = xosc.Init(), xosc.Act("traffic", self._start_at(0.0))
        init.add_global_action(self._build_environment(self._spec.weather.at(0.0)))
        entities = xosc.Entities()
        for actor in trace.actors:
            entities.add_scenario_object(self._name(actor), self._build_entity(actor))
            self._add_motion(actor, init, act)
        for group in (*self._list_weather_changes(), *self._list_signal_changes()):
            act.add_maneuver_group(group)
        board = xosc.StoryBoard(init, self._stop_at((len(trace) - 1) * trace.tick_s))
        board.add_act(act)
        scenario = xosc.Scenario(
            self._spec.id,
            "advercity",
            xosc.ParameterDeclarations(),
            entities,
            board,
            xosc.RoadNetwork(SITE_FILE),
            xosc.Catalog(),
            osc_minor_version=2,
            creation_date=datetime.datetime.fromisoformat(FIXED_DATE),
        )
        root = scenario.get_element()
        ElementTree.indent(root)
        return ElementTree.tostring(root, encoding="utf-8", xml_declaration=True) + b"\n"

    def _name(self, actor: Actor) -> str:
        agent = self._agents.get(actor.id)
        if agent is None:
            return f"{actor.actor_class}_{actor.id}"
        return EGO_NAME if agent.is_ego else agent.id

    def _build_entity(self, actor: Actor) -> Any:
        xosc = self._xosc
        length, width, height = actor.size
        behind_m, wheelbase_m = measure_reference(actor, self._spec.blueprints)
        box = xosc.BoundingBox(width, length, height, behind_m, 0.0, height / 2)
        if actor.actor_class == "pedestrian":
            category = xosc.PedestrianCategory.pedestrian
            entity = xosc.Pedestrian(actor.blueprint, PEDESTRIAN_MASS_KG, category, box)
        else:
            name = TRAILER_CATEGORY if actor.towed_by else CATEGORIES[actor.actor_class]
            category = getattr(xosc.VehicleCategory, name)
            steering_rad = 0.0 if actor.towed_by else MAX_STEERING_RAD
            wheel = WHEEL_DIAMETER_M
            entity = xosc.Vehicle(
                actor.blueprint,
                category,
                box,
                xosc.Axle(steering_rad, wheel, width, wheelbase_m, wheel / 2),
                xosc.Axle(0.0, wheel, width, 0.0, wheel / 2),
                MAX_SPEED_M_S,
                MAX_ACCELERATION_M_S2,
                MAX_ACCELERATION_M_S2,
            )
        entity.add_property("actor", str(actor.id))
        entity.add_property("paint", actor.paint)
        if actor.towed_by:
            entity.add_property("towed_by", str(actor.towed_by))
        if actor.id in self._agents:
            entity.add_property("agent", self._agents[actor.id].id)
        return entity

    def _add_motion(self, actor: Actor, init: Any, act: Any) -> None:
        """Place an actor at its start; it follows its trajectory until it is gone."""
        xosc, name = self._xosc, self._name(actor)
        _, track = self._trace.get_track(actor.id)
        tick_s = self._trace.tick_s
        times = [round(tick * tick_s, 6) for tick in track["tick"].tolist()]
        places = [
            xosc.WorldPosition(*place)
            for place in list_reference_points(actor, track, self._spec.blueprints)
        ]
        begins_s, ends_s = times[0], times[-1]
        maneuver = xosc.Maneuver(f"{name}_motion")
        if begins_s == 0.0:
            init.add_init_action(name, xosc.TeleportAction(places[0]))
        else:
            added = xosc.AddEntityAction(name, places[0])
            maneuver.add_event(self._build_event(f"{name}_comes", begins_s, added))
        if len(times) > 1:
            trajectory = xosc.Trajectory(f"{name}_trajectory", False)
            trajectory.add_shape(xosc.Polyline(times, places))
            follow = xosc.FollowTrajectoryAction(
                trajectory, xosc.FollowingMode.position, xosc.ReferenceContext.absolute, 1, 0
            )
            maneuver.add_event(self._build_event(f"{name}_drives", begins_s, follow))
        if track["tick"][-1] < len(self._trace) - 1:
            gone = xosc.DeleteEntityAction(name)
            maneuver.add_event(self._build_event(f"{name}_goes", ends_s, gone))
        group = xosc.ManeuverGroup(f"{name}_maneuvers")
        group.add_actor(name)
        group.add_maneuver(maneuver)
        act.add_maneuver_group(group)

    def _list_weather_changes(self) -> Iterator[Any]:
        weather = self._spec.weather
        events = [
            self._build_event(
                f"weather_{number}", frame.at_s, self._build_environment(weather.at(frame.at_s))
            )
            for number, frame in enumerate(weather.keyframes)
        ]
        if events:
            yield self._build_global_group("weather", events)

    def _list_signal_changes(self) -> Iterator[Any]:
        """Build a group for every light of the map, with an event whenever it changes."""
        trace = self._trace
        for column, group in enumerate(trace.signal_ids):
            shown = trace.signals[:, column]
            changes = [0, *(np.flatnonzero(np.diff(shown)) + 1).tolist()] if len(shown) else []
            for light, link in self._groups[group]:
                name = f"{light}_{link}"
                events = [
                    self._build_event(
                        f"{name}_{number}",
                        round(tick * trace.tick_s, 6),
                        self._xosc.TrafficSignalStateAction(name, LAMPS[Signal(int(shown[tick]))]),
                    )
                    for number, tick in enumerate(changes)
                ]
                yield self._build_global_group(name, events)

    def _build_global_group(self, name: str, events: list[Any]) -> Any:
        maneuver = self._xosc.Maneuver(f"{name}_changes")
        for event in events:
            maneuver.add_event(event)
        group = self._xosc.ManeuverGroup(f"{name}_maneuvers")
        group.add_maneuver(maneuver)
        return group

    def _build_event(self, name: str, time_s: float, action: Any) -> Any:
        event = self._xosc.Event(name, self._xosc.Priority.parallel)
        event.add_trigger(self._start_at(time_s))
        event.add_action(name, action)
        return event

    def _start_at(self, time_s: float) -> Any:
        return self._build_trigger(time_s, "start")

    def _stop_at(self, time_s: float) -> Any:
        return self._build_trigger(time_s, "stop")

    def _build_trigger(self, time_s: float, kind: str) -> Any:
        xosc = self._xosc
        condition = xosc.SimulationTimeCondition(round(time_s, 6), xosc.Rule.greaterOrEqual)
        return xosc.ValueTrigger(kind, 0, xosc.ConditionEdge.none, condition, kind)

    def _build_environment(self, weather: Weather) -> Any:
        """Build an `EnvironmentAction`: sight, precipitation, wind, clouds, sun and road."""
        xosc = self._xosc
        mor_m = compute_extinction(weather).mor_m
        by_kind = {"rain": weather.rain.rate_mm_h, "snow": weather.snow.rate_mm_h}
        kind = max(by_kind, key=by_kind.__getitem__) if any(by_kind.values()) else "dry"
        # OpenSCENARIO has the direction to which the wind blows, counter-clockwise from east.
        towards_rad = math.radians(270 - weather.wind.from_deg) % math.tau
        sun = weather.sun
        made = xosc.Weather(
            cloudstate=getattr(xosc.FractionalCloudCover, f"{OKTAS[weather.sky.oktas]}Oktas"),
            temperature=round(weather.temperature_c + 273.15, 2),
            sun=xosc.Sun(
                round(daylight_for_weather(weather).direct_lx, 1),
                round(math.radians(sun.azimuth_deg % 360), 9),
                round(math.radians(sun.elevation_deg), 9),
            ),
            fog=xosc.Fog(round(min(mor_m, CLEAR_RANGE_M), 3)),
            precipitation=xosc.Precipitation(
                getattr(xosc.PrecipitationType, kind), by_kind.get(kind, 0.0)
            ),
            wind=xosc.Wind(round(towards_rad, 9), weather.wind.speed_m_s),
        )
        dry = DEFAULT_GRIP.dry
        friction = round(friction_coefficient(DEFAULT_GRIP, weather) / dry, 4)
        road = xosc.RoadCondition(friction, wetness=getattr(xosc.Wetness, grade_wetness(weather)))
        hour = 12 if weather.time == "day" else 0
        time = xosc.TimeOfDay(False, 2000, 1, 1, hour, 0, 0)
        return xosc.EnvironmentAction(xosc.Environment(weather.id, time, made, road))


def grade_wetness(weather: Weather) -> str:
    """Grade the water on a road as OpenSCENARIO does, without its floods."""
    if weather.surface.puddle_coverage > 0:
        return "wetWithPuddles"
    return "moist" if weather.surface.wetness > 0 else "dry"


def measure_reference(actor: Actor, blueprints: Mapping[str, Blueprint]) -> tuple[float, float]:
    """Measure how far the middle of an actor is ahead of its reference point, and its wheelbase.

    For a semi-trailer, the wheelbase is from its kingpin to the middle of its axles.
    """
    if actor.actor_class == "pedestrian":
        return 0.0, 0.0
    running = blueprints[actor.blueprint].semitrailer if actor.towed_by else None
    if running:
        return running.kingpin_m + running.wheelbase_m - actor.size[0] / 2, running.wheelbase_m
    return WHEELBASE_FRACTION * actor.size[0] / 2, WHEELBASE_FRACTION * actor.size[0]


def list_reference_points(
    actor: Actor, track: NDArray[np.void], blueprints: Mapping[str, Blueprint]
) -> Iterator[list[float]]:
    """List x, y, z, heading, pitch and roll of an actor's reference point, tick by tick."""
    behind = np.array([-measure_reference(actor, blueprints)[0], 0.0, 0.0])
    for row in track:
        yaw, pitch, roll = (float(row[name]) for name in ("yaw", "pitch", "roll"))
        pose = pose_matrix((row["x"], row["y"], row["z"]), yaw=yaw, pitch=pitch, roll=roll)
        point = transform_points(pose, behind[None])[0]
        heading = math.remainder(yaw, math.tau)
        yield [round(value, 6) for value in (*point.tolist(), heading, pitch, roll)]
