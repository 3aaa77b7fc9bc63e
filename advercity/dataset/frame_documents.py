"""The YAML and JSON documents of a frame: poses, calibration, annotated objects, GNSS and IMU.

Documents hold plain types and rounded numbers. They are left-handed (see `carla_frame`), in metres,
degrees and km/h; boxes in images are in pixels from the upper left corner.

Loaders of OPV2V parse `<frame>.yaml` in pure Python several times over, so it stays short: it
has the fields they read, and the fields for filtering objects. All other facts of an object are
in `<frame>_objects.json`, which none of them opens.
"""

import math
from collections.abc import Iterable, Sequence
from functools import cache
from typing import Any

import numpy as np
from advercity_dsl import Weather
from advercity_dsl.units import KM_H_PER_M_S

from advercity.dataset.carla_frame import (
    carla_pose_from_matrix,
    compute_carla_angles_deg,
    mirror_angle,
    mirror_xyz,
)
from advercity.dataset.plain_documents import to_plain
from advercity.dataset.sensor_files import iterate_readings, load_all_files
from advercity.dataset.weather_truth import WeatherTruth
from advercity.frames import Actor
from advercity.materials import MATERIALS
from advercity.sensors.annotation import Annotation
from advercity.sensors.sensor_frame import SensorFrame

DESCRIPTION_ORDER = ("lidar", "radar", "camera", "thermal")
"""Order of sensors in `<frame>.yaml`; all others come after."""


def build_frame_description(
    sensor_frame: SensorFrame, annotations: Sequence[Annotation]
) -> dict[str, Any]:
    """Build the document `<frame>.yaml` of an agent and its annotations."""
    agent_pose = carla_pose_from_matrix(sensor_frame.world_from_agent)
    estimated_pose = carla_pose_from_matrix(sensor_frame.estimated_world_from_agent)
    pedestrians = [item for item in annotations if _is_pedestrian(item)]
    vehicles = [item for item in annotations if not _is_pedestrian(item)]
    return {
        "RSU": sensor_frame.agent.place.kind == "roadside_unit",
        "ego_speed": to_plain(sensor_frame.speed_m_s * KM_H_PER_M_S),
        "true_ego_pos": to_plain(agent_pose),
        "predicted_ego_pos": to_plain(estimated_pose),
        # Loaders place everything by this pose; the pose of a LiDAR replaces it.
        "lidar_pose": to_plain(carla_pose_from_matrix(sensor_frame.world_from_reference)),
        **_merge(
            files.describe(sensor_frame, number)
            for files, number in iterate_readings(sensor_frame, first=DESCRIPTION_ORDER)
        ),
        "plan_trajectory": [
            to_plain((*mirror_xyz(x, y, 0.0)[:2], speed * KM_H_PER_M_S))
            for x, y, speed in sensor_frame.planned_trajectory
        ],
        **_describe_weather(sensor_frame.weather),
        **_describe_stamps(sensor_frame),
        "vehicles": {item.state.actor.id: _describe_object(item) for item in vehicles},
        "walkers": {item.state.actor.id: _describe_object(item) for item in pedestrians},
    }


def _merge(entries: Iterable[dict[str, Any]]) -> dict[str, Any]:
    return {key: value for one in entries for key, value in one.items()}


def _describe_weather(weather: Weather | None) -> dict[str, Any]:
    """Describe the weather of the frame if it differs from the manifest's."""
    if weather is None:
        return {}
    truth = WeatherTruth.from_weather(weather).model_dump(exclude={"id"})
    rounded = {
        name: to_plain(value, decimals=6) if isinstance(value, float) else value
        for name, value in truth.items()
    }
    return {"weather": rounded}


def _describe_stamps(sensor_frame: SensorFrame) -> dict[str, Any]:
    """Describe the times of sensors with rates of their own; empty without such sensors."""
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
    """Describe the actor towing a semi-trailer; empty for all other actors."""
    return {"towed_by": actor.towed_by} if actor.towed_by else {}


@cache
def _format_paint_colour(material: str) -> str:
    """Format a material's albedo as `r, g, b` from 0 to 255, in sRGB's transfer (IEC 61966-2-1)."""
    linear = np.array(MATERIALS[material].albedo)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return ", ".join(str(value) for value in np.rint(encoded * 255).astype(int))


def build_object_extras(
    sensor_frame: SensorFrame, annotations: Sequence[Annotation]
) -> dict[str, Any]:
    """Build the document `<frame>_objects.json`: an agent's annotations, by id as in its YAML.

    `lidar_points` counts the points returned in this weather, `lidar_ghosts` the points of its
    mirror images, `lidar_hits` the beams hitting it in clear air. `towed_by` of a semi-trailer is
    its tractor unit. `size_m` of a pedestrian is the size of the box around all poses of its gait.
    `roles` are the object's roles in staged conflicts, by conflict id. `lamps` are the names of
    lit lamps in `Lamp`. `cameras` has the cameras with the object's outline in their image.
    `readouts` explains the values of linear and raw images, by camera.
    """
    return {
        "frame": sensor_frame.frame.index,
        "time_s": to_plain(sensor_frame.frame.time_s),
        **_merge(files.annotate(sensor_frame) for files in load_all_files().values()),
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
        **_merge(files.label(sensor_frame, state.actor.id) for files in load_all_files().values()),
    }


def build_motion_document(sensor_frame: SensorFrame) -> dict[str, Any]:
    """Build the document of the receiver, inertial unit and bus with a report."""
    return _merge(
        files.report(sensor_frame, number) for files, number in iterate_readings(sensor_frame)
    )
