"""ASAM Open Simulation Interface 3.8: traces of the truth, for every scenario and vehicle.

    <scenario>/ground_truth_gt.osi    a GroundTruth for every frame
    <scenario>/<agent>_sv.osi         a SensorView of every connected vehicle, with the truth in it
    <scenario>/site.xodr              the map to which GroundTruth.map_reference refers

A trace is a row of messages, each after its length (four bytes, little-endian). The frame is the
world of the dataset, and rotations are right-handed: a positive pitch is nose down. An object is
at the middle of its box; axles are given on the ground.
"""

import bisect
import math
from functools import partial
from typing import IO, Any

import numpy as np
from advercity_dsl import Agent, Spec, Vehicle, Weather
from numpy.typing import NDArray

from advercity.dataset.reader import Dataset, Scenario
from advercity.exports.pieces import Piece, PieceFiles, split_by_scenario
from advercity.exports.registry import Options
from advercity.frames import WHEELBASE_FRACTION, ActorState, Frame, Lamp, Signal
from advercity.geometry.poses import to_yaw_pitch_roll, transform_points
from advercity.physics.atmosphere import compute_atmosphere
from advercity.physics.extinction import compute_extinction
from advercity.roads.road_network import build_road
from advercity.roads.signals import TrafficLight
from advercity.sensors.agent_poses import AgentPoses
from advercity.signal_heads import SIGNAL_HEADS
from advercity_exports.libraries import load_library
from advercity_exports.openscenario import SITE_FILE, load_dataset_traffic
from advercity_exports.site_opendrive import format_projection, format_site

LENGTH_BYTES = 4
VEHICLE_TYPES = {
    "car": "TYPE_CAR",
    "van": "TYPE_DELIVERY_VAN",
    "truck": "TYPE_HEAVY_TRUCK",
    "bicycle": "TYPE_BICYCLE",
    "motorcycle": "TYPE_MOTORCYCLE",
}
TRACTOR_TYPE, TRAILER_TYPE = "TYPE_SEMITRACTOR", "TYPE_SEMITRAILER"
WHEELS = {"bicycle": 2, "motorcycle": 2}
"""Numbers of wheels other than four."""
SEMITRAILER_WHEELS = 6
COLOURS = {
    Signal.RED: "COLOR_RED",
    Signal.YELLOW: "COLOR_YELLOW",
    Signal.GREEN: "COLOR_GREEN",
}
FIRST_LIGHT_ID, FIRST_UNIT_ID = 1_000_000, 2_000_000
"""Ids are unique in a scenario; actors have the dataset's, which are lower."""
VISIBILITIES_M = (50.0, 200.0, 1000.0, 2000.0, 4000.0, 10_000.0, 40_000.0)
FOGS = (
    *("DENSE", "THICK", "LIGHT", "MIST"),
    *("POOR_VISIBILITY", "MODERATE_VISIBILITY", "GOOD_VISIBILITY", "EXCELLENT_VISIBILITY"),
)
"""Grades of fog between these visibilities; these and all others from osi_environment.proto."""
RATES_MM_H = (0.1, 0.5, 1.9, 8.1, 34.0, 149.0)
PRECIPITATIONS = ("NONE", "VERY_LIGHT", "LIGHT", "MODERATE", "HEAVY", "VERY_HEAVY", "EXTREME")
ILLUMINANCES_LX = (0.01, 1.0, 3.0, 10.0, 20.0, 400.0, 1000.0, 10_000.0)
OKTAS = ("ZERO", "ONE", "TWO", "THREE", "FOUR", "FIVE", "SIX", "SEVEN", "EIGHT")


def list_pieces(dataset: Dataset, options: Options) -> list[Piece]:
    """Make a piece of every scenario; InputError if osi-python is not installed."""
    load_library("osi3.osi_sensorview_pb2", "osi")
    return split_by_scenario(dataset, _write_scenario)


def _write_scenario(scenario: Scenario, files: PieceFiles) -> None:
    spec, traffic = scenario.spec, load_dataset_traffic(scenario)
    builder = TruthBuilder(spec, AgentPoses(spec, traffic.trace))
    folder = scenario.path.name
    vehicles = [agent for agent in spec.agents if isinstance(agent.place, Vehicle)]
    frames = range(len(scenario))
    with files.open(f"{folder}/ground_truth_gt.osi") as stream:
        for frame in files.track(scenario):
            _write_message(stream, builder.build_truth(frame.index))
    for agent in vehicles:
        with files.open(f"{folder}/{agent.id}_sv.osi") as stream:
            for position in frames:
                index = scenario.frame_numbers[position]
                _write_message(stream, builder.build_view(index, agent))
    files.write(f"{folder}/{SITE_FILE}", format_site(spec.road, traffic.network_path))


def _write_message(stream: IO[bytes], message: Any) -> None:
    raw = message.SerializeToString(deterministic=True)
    stream.write(len(raw).to_bytes(LENGTH_BYTES, "little"))
    stream.write(raw)


class TruthBuilder:
    """Builds the messages of a scenario, frame by frame."""

    def __init__(self, spec: Spec, poses: AgentPoses) -> None:
        self._spec, self._poses = spec, poses
        self._lights = list(build_road(spec.road).traffic_lights)
        self._conditions: dict[str, Any] = {}
        load = partial(load_library, format="osi")
        self._views: Any = load("osi3.osi_sensorview_pb2")
        self._truths: Any = load("osi3.osi_groundtruth_pb2")
        self._objects: Any = load("osi3.osi_object_pb2")
        self._bulbs: Any = load("osi3.osi_trafficlight_pb2")
        self._environment: Any = load("osi3.osi_environment_pb2")
        self._version = [int(part) for part in load("osi3").__version__.split(".")[:3]]

    def build_truth(self, index: int) -> Any:
        """Build the `GroundTruth` of a frame."""
        frame = self._poses.load_frame(index)
        truth = self._truths.GroundTruth(
            proj_string=format_projection(self._spec.road), map_reference=SITE_FILE
        )
        self._stamp(truth, frame)
        truth.host_vehicle_id.value = self._spec.ego.number
        trailers = {one.actor.towed_by: one.actor.id for one in frame.states if one.actor.towed_by}
        for state in frame.states:
            item = truth.moving_object.add()
            self._fill_object(item, state)
            if state.actor.id in trailers:
                self._couple(item, trailers[state.actor.id])
        for number, light in enumerate(self._lights):
            for signal in SIGNAL_HEADS[light.governs].lens_heights_m:
                item = truth.traffic_light.add()
                item.id.value = FIRST_LIGHT_ID + number * len(COLOURS) + signal
                self._fill_bulb(item, light, signal, frame.signals.get(light.id))
        weather = self._spec.weather.at(index * self._spec.timing.tick_s)
        truth.environmental_conditions.CopyFrom(self._get_conditions(weather))
        return truth

    def build_view(self, index: int, agent: Agent) -> Any:
        """Build the `SensorView` of a connected vehicle, mounted at its origin, in a frame."""
        view = self._views.SensorView()
        view.global_ground_truth.CopyFrom(self.build_truth(index))
        view.global_ground_truth.host_vehicle_id.value = agent.number
        view.version.CopyFrom(view.global_ground_truth.version)
        view.timestamp.CopyFrom(view.global_ground_truth.timestamp)
        view.sensor_id.value = FIRST_UNIT_ID + agent.number
        view.host_vehicle_id.value = agent.number
        return view

    def _stamp(self, message: Any, frame: Frame) -> None:
        version = message.version
        version.version_major, version.version_minor, version.version_patch = self._version
        seconds, nanos = divmod(round(frame.time_s * 1e9), 1_000_000_000)
        message.timestamp.seconds, message.timestamp.nanos = seconds, nanos

    def _fill_object(self, item: Any, state: ActorState) -> None:
        actor, box = state.actor, state.steady_box
        item.id.value = actor.id
        item.model_reference = actor.blueprint
        base = item.base
        base.dimension.length, base.dimension.width, base.dimension.height = box.size
        _fill_vector(base.position, transform_points(state.world_from_body, box.centre))
        yaw, pitch, roll = to_yaw_pitch_roll(state.world_from_body)
        orientation = base.orientation
        orientation.roll, orientation.pitch, orientation.yaw = roll, pitch, yaw
        motion, rotation = state.motion, state.world_from_body[:3, :3]
        # The middle of a turning box moves in another way than the origin on the ground.
        arm = np.asarray(box.centre, dtype=np.float64)
        turning = rotation @ np.cross(motion.angular_rate, arm)
        _fill_vector(base.velocity, motion.velocity + turning)
        inwards = rotation @ np.cross(motion.angular_rate, np.cross(motion.angular_rate, arm))
        _fill_vector(base.acceleration, motion.acceleration + inwards)
        rate = base.orientation_rate
        rate.roll, rate.pitch, rate.yaw = _compute_angle_rates(motion.angular_rate, pitch, roll)
        if actor.actor_class == "pedestrian":
            item.type = self._objects.MovingObject.TYPE_PEDESTRIAN
        else:
            item.type = self._objects.MovingObject.TYPE_VEHICLE
            self._fill_vehicle(item, state)

    def _fill_vehicle(self, item: Any, state: ActorState) -> None:
        actor = state.actor
        kinds = self._objects.MovingObject.VehicleClassification
        lights = kinds.LightState
        kind = TRAILER_TYPE if actor.towed_by else VEHICLE_TYPES[actor.actor_class]
        item.vehicle_classification.type = getattr(kinds, kind)
        attributes = item.vehicle_attributes
        running = self._spec.blueprints[actor.blueprint].semitrailer if actor.towed_by else None
        if running:
            # A semi-trailer has no axle in front; its kingpin takes the place of a steered axle.
            ahead_m = actor.size[0] / 2 - running.kingpin_m
            behind_m = running.wheelbase_m - ahead_m
            attributes.number_wheels = SEMITRAILER_WHEELS
        else:
            ahead_m = behind_m = WHEELBASE_FRACTION * actor.size[0] / 2
            attributes.number_wheels = WHEELS.get(actor.actor_class, 4)
        attributes.bbcenter_to_front.x, attributes.bbcenter_to_rear.x = ahead_m, -behind_m
        attributes.bbcenter_to_front.z = attributes.bbcenter_to_rear.z = -state.box.centre[2]
        shown = item.vehicle_classification.light_state

        def switch(lamp: Lamp) -> Any:
            on = bool(state.lamps & lamp)
            return lights.GENERIC_LIGHT_STATE_ON if on else lights.GENERIC_LIGHT_STATE_OFF

        shown.head_light, shown.front_fog_light = switch(Lamp.LOW_BEAM), switch(Lamp.FOG)
        shown.rear_fog_light, shown.high_beam = switch(Lamp.FOG), switch(Lamp.HIGH_BEAM)
        brakes = bool(state.lamps & Lamp.BRAKE)
        shown.brake_light_state = (
            lights.BRAKE_LIGHT_STATE_NORMAL if brakes else lights.BRAKE_LIGHT_STATE_OFF
        )
        left, right = bool(state.lamps & Lamp.LEFT), bool(state.lamps & Lamp.RIGHT)
        names = {(True, True): "WARNING", (True, False): "LEFT", (False, True): "RIGHT"}
        name = names.get((left, right), "OFF")
        shown.indicator_state = getattr(lights, f"INDICATOR_STATE_{name}")

    def _couple(self, item: Any, trailer: int) -> None:
        """Link a tractor unit to its semi-trailer."""
        shown = item.vehicle_classification
        kinds = self._objects.MovingObject.VehicleClassification
        shown.type, shown.has_trailer = getattr(kinds, TRACTOR_TYPE), True
        shown.trailer_id.value = trailer

    def _fill_bulb(
        self, item: Any, light: TrafficLight, colour: Signal, shown: Signal | None
    ) -> None:
        kinds = self._bulbs.TrafficLight.Classification
        head = SIGNAL_HEADS[light.governs]
        x, y, z = np.add(light.position_m, (*np.multiply(light.facing, head.face_m), -head.drop_m))
        _fill_vector(item.base.position, np.array([x, y, z + head.lens_heights_m[colour]]))
        item.base.orientation.yaw = math.atan2(light.facing[1], light.facing[0])
        size = item.base.dimension
        size.length = size.width = size.height = 2 * head.lens_radius_m
        classification = item.classification
        classification.color = getattr(kinds, COLOURS[colour])
        is_figure = light.governs == "pedestrians"
        classification.icon = kinds.ICON_PEDESTRIAN if is_figure else kinds.ICON_NONE
        classification.mode = kinds.MODE_CONSTANT if shown == colour else kinds.MODE_OFF

    def _get_conditions(self, weather: Weather) -> Any:
        key = weather.model_dump_json()
        if key not in self._conditions:
            self._conditions[key] = self._build_conditions(weather)
        return self._conditions[key]

    def _build_conditions(self, weather: Weather) -> Any:
        kinds = self._environment.EnvironmentalConditions
        falling_mm_h = weather.rain.rate_mm_h + weather.snow.rate_mm_h + weather.hail.rate_mm_h
        rain = PRECIPITATIONS[bisect.bisect_right(RATES_MM_H, falling_mm_h)]
        fog = FOGS[bisect.bisect_right(VISIBILITIES_M, compute_extinction(weather).mor_m)]
        light_lx = compute_atmosphere(weather, self._spec.road.land_use).ground_lx
        level = bisect.bisect_right(ILLUMINANCES_LX, light_lx) + 1
        clouds = kinds.CloudLayer
        cover = getattr(clouds, f"FRACTIONAL_CLOUD_COVER_{OKTAS[weather.sky.oktas]}_OKTAS")
        return kinds(
            precipitation=getattr(kinds, f"PRECIPITATION_{rain}"),
            fog=getattr(kinds, f"FOG_{fog}"),
            ambient_illumination=getattr(kinds, f"AMBIENT_ILLUMINATION_LEVEL{level}"),
            temperature=weather.temperature_c + 273.15,
            clouds=clouds(fractional_cloud_cover=cover),
            wind=kinds.Wind(
                origin_direction=math.radians(weather.wind.from_deg), speed=weather.wind.speed_m_s
            ),
            sun=kinds.Sun(
                azimuth=math.radians(weather.sun.azimuth_deg),
                elevation=math.radians(weather.sun.elevation_deg),
            ),
        )


def _compute_angle_rates(
    rate: NDArray[np.float64], pitch: float, roll: float
) -> tuple[float, float, float]:
    """Compute the rates of roll, pitch and yaw of a body turning at `rate` (3,) in its frame."""
    p, q, r = rate.tolist()
    yaw_rate = (q * math.sin(roll) + r * math.cos(roll)) / math.cos(pitch)
    pitch_rate = q * math.cos(roll) - r * math.sin(roll)
    return p + yaw_rate * math.sin(pitch), pitch_rate, yaw_rate


def _fill_vector(target: Any, values: NDArray[np.float64]) -> None:
    target.x, target.y, target.z = values.tolist()
