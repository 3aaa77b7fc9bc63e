"""YAML and JSON as datasets hold them: plain types, rounded numbers, no anchors, no times.

What a frame's YAML files say of a viewpoint, the same in every layout.

Everything here is left-handed (see `carla_frame`), in metres, degrees and km/h. Fields that no
loader reads are kept beside those they do: `class`, `bearing`, `lidar_hits`.

What more is known of every annotated object, in a file that no loader of OPV2V opens.

They parse `<frame>.yaml` in pure Python several times over, so it stays short and this lies beside
it. Vectors are left-handed as there; boxes are in pixels, counted from the left upper corner.
"""

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from functools import cache, lru_cache
from typing import Any

import numpy as np
import yaml
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
from advercity.geometry import poses
from advercity.materials import MATERIALS
from advercity.sensors.annotation import Annotation
from advercity.sensors.measurements import GnssFix, ImuSample
from advercity.sensors.sensor_frame import (
    CameraImage,
    ProjectedBox,
    SensorFrame,
    compute_image_intrinsics,
)

UNLIMITED_LINE_WIDTH = 2**30
"""Width of lines."""


def to_plain(values: ArrayLike, *, decimals: int = 9) -> Any:
    """Python floats, rounded; zero without a sign. Short vectors are quickest as tuples."""
    if isinstance(values, float):
        # As NumPy rounds, at a tenth of what it takes for a single number.
        scale = 10.0**decimals
        scaled = values * scale
        return round(scaled) / scale if math.isfinite(scaled) else values
    if isinstance(values, tuple):
        return [to_plain(value, decimals=decimals) for value in values]
    return (np.round(np.asarray(values, dtype=np.float64), decimals) + 0.0).tolist()


def format_yaml(document: Mapping[Any, Any]) -> bytes:
    """A document in the order of its keys; what holds nothing but scalars is on one line.

    PyYAML, which only tells how texts are quoted here, takes six times as long for it all.
    """
    lines: list[str] = []
    if _is_one_line(document):
        lines.append(_format_line(document))
    else:
        _append_lines(lines, document, "")
    return "\n".join([*lines, ""]).encode()


def format_json(document: dict[str, Any]) -> bytes:
    """A document in the order of its keys, without blanks."""
    return json.dumps(document, separators=(",", ":"), allow_nan=False).encode() + b"\n"


def _append_lines(lines: list[str], value: Any, indent: str) -> None:
    """Of a mapping or list that takes several."""
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
    """A scalar between brackets, where commas part."""
    return _format_scalar(value, inside=True)


def _format_scalar(value: Any, *, inside: bool = False) -> str:
    if isinstance(value, float):
        text = repr(value)
        return _format_with_pyyaml(value) if "e" in text or "n" in text else text
    if isinstance(value, str):
        return _format_with_pyyaml(value, inside=inside)
    return json.dumps(value)


@lru_cache(maxsize=4096)
def _format_with_pyyaml(value: str | float, *, inside: bool = False) -> str:
    several_lines = isinstance(value, str) and "\n" in value
    text: str = yaml.dump(
        [value],
        Dumper=yaml.CSafeDumper,
        default_flow_style=inside,
        default_style='"' if several_lines else None,
        width=UNLIMITED_LINE_WIDTH,
    )
    return text[1:-2] if inside else text[2:-1]


def build_frame_description(
    sensor_frame: SensorFrame, annotations: Sequence[Annotation]
) -> dict[str, Any]:
    """What `<frame>.yaml` says of a viewpoint and what it annotates, in plain types."""
    cameras = {
        f"camera{index}": _describe_camera(sensor_frame, picture)
        for index, picture in enumerate(sensor_frame.camera_images)
    }
    return {
        "RSU": sensor_frame.agent.place.kind == "roadside_unit",
        "ego_speed": to_plain(sensor_frame.speed_m_s * KM_H_PER_M_S),
        "true_ego_pos": to_plain(carla_pose_from_matrix(sensor_frame.world_from_agent)),
        "predicted_ego_pos": to_plain(
            carla_pose_from_matrix(sensor_frame.estimated_world_from_agent)
        ),
        "lidar_pose": to_plain(carla_pose_from_matrix(sensor_frame.world_from_lidar)),
        **cameras,
        "plan_trajectory": [
            to_plain((*mirror_xyz(x, y, 0.0)[:2], speed * KM_H_PER_M_S))
            for x, y, speed in sensor_frame.planned_trajectory
        ],
        "vehicles": {
            item.state.actor.id: _describe_object(item)
            for item in annotations
            if not _is_pedestrian(item)
        },
        "walkers": {
            item.state.actor.id: _describe_object(item)
            for item in annotations
            if _is_pedestrian(item)
        },
    }


def _is_pedestrian(item: Annotation) -> bool:
    return item.state.actor.actor_class == "pedestrian"


def _describe_object(item: Annotation) -> dict[str, Any]:
    """Loaders add `center` to `location` without turning it, so it is written turned."""
    actor = item.state.actor
    offset = item.centre - item.location
    length, width, height = actor.size
    return {
        "class": "walker" if _is_pedestrian(item) else actor.actor_class,
        "bp_id": actor.blueprint,
        "color": _format_paint_colour(actor.paint),
        "location": to_plain(mirror_xyz(*item.location.tolist())),
        "center": to_plain(mirror_xyz(*offset.tolist())),
        "angle": to_plain(compute_carla_angles_deg(item.state.world_from_body)),
        "extent": to_plain((length / 2, width / 2, height / 2)),
        "speed": to_plain(item.state.speed_m_s * KM_H_PER_M_S),
        "dist": to_plain(item.distance_m),
        "bearing": to_plain(mirror_angle(math.degrees(item.bearing_rad))),
        "relative_angle": to_plain(mirror_angle(math.degrees(item.relative_yaw_rad))),
        "lidar_hits": item.lidar_hits,
    }


def _describe_camera(reading: SensorFrame, picture: CameraImage) -> dict[str, Any]:
    """`extrinsic` leads from the LiDAR to the camera, in body axes, as loaders compute it."""
    camera_from_lidar = poses.invert_pose(picture.world_from_camera) @ reading.world_from_lidar
    field_of_view = reading.agent.sensors.camera.horizontal_fov_deg
    return {
        "cords": to_plain(carla_pose_from_matrix(picture.world_from_camera)),
        "extrinsic": to_plain(mirror_pose(camera_from_lidar)),
        "intrinsic": to_plain(compute_image_intrinsics(picture, horizontal_fov_deg=field_of_view)),
    }


def build_motion_document(sensor_frame: SensorFrame) -> dict[str, Any]:
    """What satellite receiver and inertial unit say, each where there is one."""
    gnss = {} if sensor_frame.gnss is None else {"gnss": _describe_gnss(sensor_frame.gnss)}
    imu = {} if sensor_frame.imu is None else {"imu": _describe_imu(sensor_frame.imu)}
    return gnss | imu


def _describe_gnss(fix: GnssFix) -> dict[str, Any]:
    return {
        "lat": to_plain(fix.latitude_deg, decimals=12),
        "lon": to_plain(fix.longitude_deg, decimals=12),
        "alt": to_plain(fix.altitude_m),
        "timestamp": to_plain(fix.time_s),
    }


def _describe_imu(sample: ImuSample) -> dict[str, Any]:
    """Of a unit that is faster than the frames, `earlier` has what came since the last one."""
    return {
        **(
            {"earlier": [_describe_timed_sample(one) for one in sample.earlier]}
            if sample.earlier
            else {}
        ),
        "accelerometer": dict(
            zip("xyz", to_plain(mirror_points(sample.specific_force)), strict=True)
        ),
        "gyroscope": dict(
            zip("xyz", to_plain(mirror_angular_rate(sample.angular_rate)), strict=True)
        ),
        "compass": to_plain(sample.compass_rad),
    }


def _describe_timed_sample(sample: ImuSample) -> dict[str, Any]:
    return {"time_offset": to_plain(sample.time_s), **_describe_imu(sample)}


@cache
def _format_paint_colour(material: str) -> str:
    """`r, g, b` from 0 to 255: a material's albedo in sRGB's transfer (IEC 61966-2-1)."""
    linear = np.array(MATERIALS[material].albedo)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return ", ".join(str(value) for value in np.rint(encoded * 255).astype(int))


def build_object_extras(
    sensor_frame: SensorFrame, annotations: Sequence[Annotation]
) -> dict[str, Any]:
    """Document of one viewpoint and what it annotates, in plain types; by id as in its YAML.

    `lidar_points` are those that came back through the weather, `lidar_hits` those that would have
    in none. `roles` are an object's parts in staged conflicts, by their ids. `cameras` has those
    whose pictures its outline reaches into.
    """
    numbers, counts = np.unique(sensor_frame.point_cloud.instance, return_counts=True)
    points = dict(zip(numbers.tolist(), counts.tolist(), strict=True))
    return {
        "frame": sensor_frame.frame.index,
        "time_s": to_plain(sensor_frame.frame.time_s),
        "objects": {
            str(item.state.actor.id): _describe_object_extras(
                item, sensor_frame, points.get(item.state.actor.id, 0)
            )
            for item in annotations
        },
    }


def _describe_object_extras(
    item: Annotation, reading: SensorFrame, lidar_points: int
) -> dict[str, Any]:
    state = item.state
    velocity = mirror_xyz(*(state.world_from_body[:3, 0] * state.speed_m_s).tolist())
    return {
        "class": state.actor.actor_class,
        "roles": dict(reading.conflict_roles.get(state.actor.id, {})),
        "velocity_m_s": to_plain(velocity, decimals=6),
        "acceleration_m_s2": to_plain(state.acceleration_m_s2, decimals=6),
        "lidar_hits": item.lidar_hits,
        "lidar_points": lidar_points,
        "cameras": {
            f"camera{index}": _describe_projected_box(picture.projected_boxes[state.actor.id])
            for index, picture in enumerate(reading.camera_images)
            if state.actor.id in picture.projected_boxes
        },
    }


def _describe_projected_box(sighting: ProjectedBox) -> dict[str, Any]:
    box = sighting.visible_box
    return {
        "visible_px": sighting.visible_px,
        "visible_fraction": to_plain(sighting.visible_fraction, decimals=4),
        "occlusion": to_plain(sighting.occlusion, decimals=4),
        "truncation": to_plain(sighting.truncation, decimals=4),
        "visible_box": None if box is None else to_plain(box, decimals=2),
        "outline_box": to_plain(sighting.outline_box, decimals=2),
    }
