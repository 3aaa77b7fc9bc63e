"""The YAML and JSON documents of a frame: poses, calibration, annotated objects, GNSS and IMU.

Documents hold plain types and rounded numbers. They are left-handed (see `carla_frame`), in metres,
degrees and km/h; boxes in images are in pixels from the upper left corner.

Loaders of OPV2V parse `<frame>.yaml` in pure Python several times over, so it stays short: it has
the fields that they read, and what objects are filtered by. All else that is known of an object is
in `<frame>_objects.json`, which none of them opens.
"""

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from functools import cache, lru_cache
from typing import Any

import numpy as np
import yaml
from advercity_dsl import Weather
from advercity_dsl.lens import CameraLens
from advercity_dsl.units import KM_H_PER_M_S
from numpy.typing import ArrayLike

from advercity.dataset.carla_frame import (
    carla_pose_from_matrix,
    compute_carla_angles_deg,
    mirror_angle,
    mirror_angular_rate,
    mirror_points,
    mirror_pose,
    mirror_xyz,
)
from advercity.dataset.weather_truth import WeatherTruth
from advercity.frames import Actor
from advercity.geometry import poses
from advercity.materials import MATERIALS
from advercity.sensors.annotation import Annotation
from advercity.sensors.measurements import (
    KELVIN_PER_COUNT,
    CanSample,
    GnssFix,
    ImuSample,
    SolutionQuality,
)
from advercity.sensors.rolling_shutter import RollingCamera
from advercity.sensors.sensor_frame import ProjectedBox, SensorFrame

UNLIMITED_LINE_WIDTH = 2**30
"""Line width at which PyYAML never folds a text."""


def to_plain(values: ArrayLike, *, decimals: int = 9) -> Any:
    """Convert numbers to rounded Python floats, zeros to +0.0; short vectors go best as tuples."""
    if isinstance(values, float):
        # Rounds as `np.round` does, which takes ten times as long for a single number. `round`
        # returns an int, and so loses the sign of zero.
        scale = 10.0**decimals
        scaled = values * scale
        return round(scaled) / scale if math.isfinite(scaled) else values
    if isinstance(values, tuple):
        return [to_plain(value, decimals=decimals) for value in values]
    return (np.round(np.asarray(values, dtype=np.float64), decimals) + 0.0).tolist()


def format_yaml(document: Mapping[Any, Any]) -> bytes:
    """Format a document in the order of its keys; what holds only scalars is on one line.

    PyYAML takes six times as long for a whole document; here it only quotes texts.
    """
    lines: list[str] = []
    if _is_one_line(document):
        lines.append(_format_line(document))
    else:
        _append_lines(lines, document, "")
    return "\n".join([*lines, ""]).encode()


def format_json(document: dict[str, Any]) -> bytes:
    """Format a document in the order of its keys, without blanks."""
    return json.dumps(document, separators=(",", ":"), allow_nan=False).encode() + b"\n"


def _append_lines(lines: list[str], value: Any, indent: str) -> None:
    """Append the lines of a mapping or list that takes several."""
    if isinstance(value, Mapping):
        for key, item in value.items():
            if _is_one_line(item):
                lines.append(f"{indent}{_format_scalar(key)}: {_format_line(item)}")
            else:
                lines.append(f"{indent}{_format_scalar(key)}:")
                _append_lines(lines, item, f"{indent}  " if isinstance(item, Mapping) else indent)
        return
    for item in value:
        if _is_one_line(item):
            lines.append(f"{indent}- {_format_line(item)}")
        else:
            first = len(lines)
            _append_lines(lines, item, f"{indent}  ")
            lines[first] = f"{indent}- {lines[first][len(indent) + 2 :]}"


def _is_one_line(value: Any) -> bool:
    inside: Iterable[Any] = ()
    if isinstance(value, Mapping):
        inside = value.values()
    elif isinstance(value, list | tuple):
        inside = value
    return not any(isinstance(item, Mapping | list | tuple) for item in inside)


def _format_line(value: Any) -> str:
    if isinstance(value, Mapping):
        items = [f"{_format_scalar(k)}: {_format_flow_item(v)}" for k, v in value.items()]
        return f"{{{', '.join(items)}}}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_format_flow_item, value))}]"
    return _format_scalar(value)


def _format_flow_item(value: Any) -> str:
    """Format a scalar inside brackets, where a text with a comma needs quotes."""
    return _format_scalar(value, inside=True)


def _format_scalar(value: Any, *, inside: bool = False) -> str:
    if isinstance(value, float):
        text = repr(value)
        # YAML 1.1 reads `1e-09` as a text, and writes `.nan` and `.inf`: PyYAML knows how.
        return _format_with_pyyaml(value) if "e" in text or "n" in text else text
    if isinstance(value, str):
        return _format_with_pyyaml(value, inside=inside)
    return json.dumps(value)


# Texts repeat from frame to frame: classes, blueprints, keys.
@lru_cache(maxsize=4096)
def _format_with_pyyaml(value: str | float, *, inside: bool = False) -> str:
    is_multiline = isinstance(value, str) and "\n" in value
    text: str = yaml.dump(
        [value],
        Dumper=yaml.CSafeDumper,
        default_flow_style=inside,
        default_style='"' if is_multiline else None,
        width=UNLIMITED_LINE_WIDTH,
    )
    return text[1:-2] if inside else text[2:-1]  # `[x]\n` or `- x\n`


def build_frame_description(
    sensor_frame: SensorFrame, annotations: Sequence[Annotation]
) -> dict[str, Any]:
    """Build the document `<frame>.yaml` of an agent and what it annotates."""
    agent_pose = carla_pose_from_matrix(sensor_frame.world_from_agent)
    estimated_pose = carla_pose_from_matrix(sensor_frame.estimated_world_from_agent)
    cameras = range(len(sensor_frame.camera_images))
    pedestrians = [item for item in annotations if _is_pedestrian(item)]
    vehicles = [item for item in annotations if not _is_pedestrian(item)]
    return {
        "RSU": sensor_frame.agent.place.kind == "roadside_unit",
        "ego_speed": to_plain(sensor_frame.speed_m_s * KM_H_PER_M_S),
        "true_ego_pos": to_plain(agent_pose),
        "predicted_ego_pos": to_plain(estimated_pose),
        **{
            f"lidar{index or ''}_pose": to_plain(carla_pose_from_matrix(scan.world_from_lidar))
            for index, scan in enumerate(sensor_frame.lidar_scans)
        },
        **{
            f"radar{index}_pose": to_plain(carla_pose_from_matrix(scan.world_from_radar))
            for index, scan in enumerate(sensor_frame.radar_scans)
        },
        **{f"camera{index}": _describe_camera(sensor_frame, index) for index in cameras},
        **{
            f"thermal{index}": _describe_thermal(sensor_frame, index)
            for index in range(len(sensor_frame.thermal_images))
        },
        "plan_trajectory": [
            to_plain((*mirror_xyz(x, y, 0.0)[:2], speed * KM_H_PER_M_S))
            for x, y, speed in sensor_frame.planned_trajectory
        ],
        **_describe_weather(sensor_frame.weather),
        **_describe_stamps(sensor_frame),
        "vehicles": {item.state.actor.id: _describe_object(item) for item in vehicles},
        "walkers": {item.state.actor.id: _describe_object(item) for item in pedestrians},
    }


def _describe_weather(weather: Weather | None) -> dict[str, Any]:
    """Describe the weather of the frame, if it is not that of the manifest for all frames."""
    if weather is None:
        return {}
    truth = WeatherTruth.from_weather(weather).model_dump(exclude={"id"})
    rounded = {
        name: to_plain(value, decimals=6) if isinstance(value, float) else value
        for name, value in truth.items()
    }
    return {"weather": rounded}


def _describe_stamps(sensor_frame: SensorFrame) -> dict[str, Any]:
    """Describe when sensors with rates of their own measured; nothing without such sensors."""
    stamps = {name: to_plain(time_s) for name, time_s in sensor_frame.stamps.items()}
    return {"stamps": stamps} if stamps else {}


def _is_pedestrian(item: Annotation) -> bool:
    return item.state.actor.actor_class == "pedestrian"


def _describe_object(item: Annotation) -> dict[str, Any]:
    actor = item.state.actor
    offset = item.centre - item.location
    length, width, height = item.state.box.size
    on_foot = _is_pedestrian(item)
    return {
        "class": "walker" if on_foot else actor.actor_class,
        "bp_id": actor.blueprint,
        "color": _format_paint_colour(actor.paint),
        "location": to_plain(mirror_xyz(*item.location.tolist())),
        # Loaders add `center` to `location` without rotating it, so it is in the world's axes.
        "center": to_plain(mirror_xyz(*offset.tolist())),
        "angle": to_plain(compute_carla_angles_deg(item.state.world_from_body)),
        "extent": to_plain((length / 2, width / 2, height / 2)),
        "speed": to_plain(item.state.speed_m_s * KM_H_PER_M_S),
        "dist": to_plain(item.distance_m),
        "bearing": to_plain(mirror_angle(math.degrees(item.bearing_rad))),
        "relative_angle": to_plain(mirror_angle(math.degrees(item.relative_yaw_rad))),
        "lidar_hits": item.lidar_hits,
        "lidar_points": item.lidar_points,
        "visible_fraction": to_plain(item.visible_fraction, decimals=4),
        **({"umbrella": item.state.umbrella} if on_foot else {"parked": item.state.is_parked}),
        **_describe_towing(actor),
    }


def _describe_towing(actor: Actor) -> dict[str, int]:
    """Describe which actor tows a semi-trailer; nothing of all others."""
    return {"towed_by": actor.towed_by} if actor.towed_by else {}


def _describe_camera(sensor_frame: SensorFrame, camera: int) -> dict[str, Any]:
    """Describe a camera; `extrinsic` maps the first LiDAR to it in body axes, as loaders do."""
    world_from_camera = sensor_frame.camera_images[camera].world_from_camera
    camera_from_lidar = poses.invert_pose(world_from_camera) @ sensor_frame.world_from_lidar
    return {
        "cords": to_plain(carla_pose_from_matrix(world_from_camera)),
        "extrinsic": to_plain(mirror_pose(camera_from_lidar)),
        "intrinsic": to_plain(sensor_frame.build_camera_model(camera).matrix),
        **_describe_lens(sensor_frame.agent.sensors.cameras[camera].model.lens),
        **_describe_shutter(sensor_frame.camera_images[camera].rolling),
    }


def _describe_thermal(sensor_frame: SensorFrame, number: int) -> dict[str, Any]:
    """Describe a thermal camera as other cameras, and what a step of its values is."""
    world_from_camera = sensor_frame.thermal_images[number].world_from_camera
    camera_from_lidar = poses.invert_pose(world_from_camera) @ sensor_frame.world_from_lidar
    return {
        "cords": to_plain(carla_pose_from_matrix(world_from_camera)),
        "extrinsic": to_plain(mirror_pose(camera_from_lidar)),
        "intrinsic": to_plain(sensor_frame.build_thermal_model(number).matrix),
        "kelvin_per_count": KELVIN_PER_COUNT,
    }


def _describe_lens(lens: CameraLens | None) -> dict[str, Any]:
    """Describe a lens by the keys of ROS, which readers of OPV2V ignore; nothing of a pinhole."""
    if lens is None:
        return {}
    return {
        "distortion_model": lens.model,
        "distortion_coefficients": to_plain(lens.coefficients, decimals=12),
    }


def _describe_shutter(rolling: RollingCamera | None) -> dict[str, Any]:
    """Describe a rolling shutter by its readout and the poses at the image's edges."""
    if rolling is None:
        return {}
    return {
        "readout": to_plain(rolling.readout_s),
        "cords_upper_edge": to_plain(carla_pose_from_matrix(rolling.upper)),
        "cords_lower_edge": to_plain(carla_pose_from_matrix(rolling.lower)),
    }


def build_motion_document(sensor_frame: SensorFrame) -> dict[str, Any]:
    """Build the document of GNSS, IMU and bus, with those of them that the agent has."""
    gnss = {} if sensor_frame.gnss is None else {"gnss": _describe_gnss(sensor_frame.gnss)}
    imu = {} if sensor_frame.imu is None else {"imu": _describe_imu(sensor_frame.imu)}
    can = {} if sensor_frame.can is None else {"can": _describe_can(sensor_frame.can)}
    return gnss | imu | can


def _describe_gnss(fix: GnssFix) -> dict[str, Any]:
    """Describe a fix; `earlier` has those since the last frame, of a faster receiver."""
    earlier = [_describe_gnss(one) for one in fix.earlier]
    return {
        **({"earlier": earlier} if earlier else {}),
        # 1e-12 degrees are 0.1 micrometres; 1e-9 degrees would be 0.1 millimetres.
        "lat": to_plain(fix.latitude_deg, decimals=12),
        "lon": to_plain(fix.longitude_deg, decimals=12),
        "alt": to_plain(fix.altitude_m),
        "timestamp": to_plain(fix.time_s),
        **({} if fix.heading_rad is None else {"heading": to_plain(fix.heading_rad)}),
        **({} if fix.quality is None else _describe_quality(fix.quality)),
    }


def _describe_quality(quality: SolutionQuality) -> dict[str, Any]:
    return {
        "solution": quality.solution.value,
        "satellites": quality.satellites,
        "visible": quality.visible,
        "pdop": to_plain(quality.pdop),
        "hdop": to_plain(quality.hdop),
        "vdop": to_plain(quality.vdop),
    }


def _describe_imu(sample: ImuSample) -> dict[str, Any]:
    """Describe a sample; `earlier` has those since the last frame, of a unit with a higher rate."""
    earlier = [_describe_imu(one) for one in sample.earlier]
    acceleration = to_plain(mirror_points(sample.specific_force))
    rate = to_plain(mirror_angular_rate(sample.angular_rate))
    return {
        **({"time_offset": to_plain(sample.time_s)} if sample.time_s else {}),
        **({"earlier": earlier} if earlier else {}),
        "accelerometer": dict(zip("xyz", acceleration, strict=True)),
        "gyroscope": dict(zip("xyz", rate, strict=True)),
        "compass": to_plain(sample.compass_rad),
    }


def _describe_can(sample: CanSample) -> dict[str, Any]:
    """Describe signals of a bus in its own convention: metres, radians, positive to the left."""
    earlier = [_describe_can(one) for one in sample.earlier]
    return {
        **({"time_offset": to_plain(sample.time_s)} if sample.time_s else {}),
        **({"earlier": earlier} if earlier else {}),
        "wheel_speeds_m_s": to_plain(sample.wheel_speeds_m_s),
        "speed_m_s": to_plain(sample.speed_m_s),
        "steering_wheel_rad": to_plain(sample.steering_wheel_rad),
        "yaw_rate_rad_s": to_plain(sample.yaw_rate_rad_s),
        "brake": sample.is_braking,
        "indicator": sample.indicator.value,
    }


@cache
def _format_paint_colour(material: str) -> str:
    """Format a material's albedo as `r, g, b` from 0 to 255, in sRGB's transfer (IEC 61966-2-1)."""
    linear = np.array(MATERIALS[material].albedo)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return ", ".join(str(value) for value in np.rint(encoded * 255).astype(int))


def build_object_extras(
    sensor_frame: SensorFrame, annotations: Sequence[Annotation]
) -> dict[str, Any]:
    """Build the document `<frame>_objects.json`: what an agent annotates, by id as in its YAML.

    `lidar_points` counts the points returned in this weather, `lidar_ghosts` those of its mirror
    images, `lidar_hits` the beams that would hit in none. `towed_by` of a semi-trailer is its
    tractor unit. `size_m` of a pedestrian is that of the box around all poses of its gait. `roles`
    are the object's roles in staged conflicts, by conflict id. `lamps` are the names of `Lamp` that
    are lit. `cameras` has the cameras whose image the object's outline overlaps. `readouts` is what
    the values of linear and raw images mean, by cameras that write them.
    """
    readouts = {
        f"camera{index}": asdict(image.readout)
        for index, image in enumerate(sensor_frame.camera_images)
        if image.readout is not None
    }
    return {
        "frame": sensor_frame.frame.index,
        "time_s": to_plain(sensor_frame.frame.time_s),
        **({"readouts": readouts} if readouts else {}),
        "objects": {
            str(item.state.actor.id): _describe_object_extras(item, sensor_frame)
            for item in annotations
        },
    }


def _describe_object_extras(item: Annotation, sensor_frame: SensorFrame) -> dict[str, Any]:
    state = item.state
    velocity = mirror_xyz(*state.motion.velocity.tolist())
    return {
        "class": state.actor.actor_class,
        **_describe_towing(state.actor),
        "roles": dict(sensor_frame.conflict_roles.get(state.actor.id, {})),
        "velocity_m_s": to_plain(velocity, decimals=6),
        **({"size_m": to_plain(state.actor.size)} if _is_pedestrian(item) else {}),
        "acceleration_m_s2": to_plain(state.acceleration_m_s2, decimals=6),
        "lamps": [str(lamp.name).lower() for lamp in state.lamps],
        "lidar_hits": item.lidar_hits,
        "lidar_points": item.lidar_points,
        "lidar_ghosts": item.lidar_ghosts,
        "cameras": {
            f"camera{index}": _describe_projected_box(image.projected_boxes[state.actor.id])
            for index, image in enumerate(sensor_frame.camera_images)
            if state.actor.id in image.projected_boxes
        },
        **_describe_thermal_boxes(state.actor.id, sensor_frame),
    }


def _describe_thermal_boxes(actor: int, sensor_frame: SensorFrame) -> dict[str, Any]:
    """Describe an object in thermal images; nothing for agents without such cameras."""
    if not sensor_frame.thermal_images:
        return {}
    boxes = {
        f"thermal{index}": _describe_projected_box(image.projected_boxes[actor])
        for index, image in enumerate(sensor_frame.thermal_images)
        if actor in image.projected_boxes
    }
    return {"thermals": boxes}


def _describe_projected_box(box: ProjectedBox) -> dict[str, Any]:
    visible_box = box.visible_box
    return {
        "visible_px": box.visible_px,
        "visible_fraction": to_plain(box.visible_fraction, decimals=4),
        "occlusion": to_plain(box.occlusion, decimals=4),
        "truncation": to_plain(box.truncation, decimals=4),
        "visible_box": None if visible_box is None else to_plain(visible_box, decimals=2),
        "outline_box": to_plain(box.outline_box, decimals=2),
    }
