"""What a frame's YAML files say of a viewpoint, the same in every layout.

Everything here is left-handed (see `carla_frame`), in metres, degrees and km/h. Fields that no
loader reads are kept beside those they do: `class`, `bearing`, `lidar_hits`.
"""

import math
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np

from advercity import poses
from advercity.dataset.annotation import Annotation
from advercity.dataset.carla_frame import (
    angles_deg,
    mirror,
    mirror_pose,
    mirror_rate,
    pose_from_matrix,
)
from advercity.dataset.documents import plain
from advercity.dataset.reading import Picture, Reading, intrinsic
from advercity.sensors.gnss import GnssFix
from advercity.sensors.imu import ImuSample
from advercity.world.materials import MATERIALS

KM_H_PER_M_S = 3.6


def describe(reading: Reading, objects: Sequence[Annotation]) -> dict[str, Any]:
    """What `<frame>.yaml` says of a viewpoint and what it annotates, in plain types."""
    cameras = {
        f"camera{index}": _camera(reading, picture)
        for index, picture in enumerate(reading.pictures)
    }
    return {
        "RSU": reading.agent.place.kind == "roadside_unit",
        "ego_speed": plain(reading.speed_m_s * KM_H_PER_M_S),
        "true_ego_pos": plain(pose_from_matrix(reading.world_from_agent)),
        "predicted_ego_pos": plain(pose_from_matrix(reading.estimated_world_from_agent)),
        "lidar_pose": plain(pose_from_matrix(reading.world_from_lidar)),
        **cameras,
        "plan_trajectory": [
            plain((x, -y, speed * KM_H_PER_M_S)) for x, y, speed in reading.planned
        ],
        "vehicles": {
            item.state.actor.id: _object(item) for item in objects if not _is_on_foot(item)
        },
        "walkers": {item.state.actor.id: _object(item) for item in objects if _is_on_foot(item)},
    }


def _is_on_foot(item: Annotation) -> bool:
    return item.state.actor.actor_class == "pedestrian"


def _object(item: Annotation) -> dict[str, Any]:
    """Loaders add `center` to `location` without turning it, so it is written turned."""
    actor = item.state.actor
    x, y, z = item.location.tolist()
    ahead, left, up = (item.centre - item.location).tolist()
    length, width, height = actor.size
    return {
        "class": "walker" if _is_on_foot(item) else actor.actor_class,
        "bp_id": actor.blueprint,
        "color": _colour(actor.paint),
        "location": plain((x, -y, z)),
        "center": plain((ahead, -left, up)),
        "angle": plain(angles_deg(item.state.world_from_body)),
        "extent": plain((length / 2, width / 2, height / 2)),
        "speed": plain(item.state.speed_m_s * KM_H_PER_M_S),
        "dist": plain(item.distance_m),
        "bearing": plain(-math.degrees(item.bearing_rad)),
        "relative_angle": plain(-math.degrees(item.relative_yaw_rad)),
        "lidar_hits": item.lidar_hits,
    }


def _camera(reading: Reading, picture: Picture) -> dict[str, Any]:
    """`extrinsic` leads from the LiDAR to the camera, in body axes, as loaders compute it."""
    camera_from_lidar = poses.inverse(picture.world_from_camera) @ reading.world_from_lidar
    field_of_view = reading.agent.sensors.camera.horizontal_fov_deg
    return {
        "cords": plain(pose_from_matrix(picture.world_from_camera)),
        "extrinsic": plain(mirror_pose(camera_from_lidar)),
        "intrinsic": plain(intrinsic(picture, horizontal_fov_deg=field_of_view)),
    }


def motion(reading: Reading) -> dict[str, Any]:
    """What satellite receiver and inertial unit say, each where there is one."""
    gnss = {} if reading.gnss is None else {"gnss": _gnss(reading.gnss)}
    imu = {} if reading.imu is None else {"imu": _imu(reading.imu)}
    return gnss | imu


def _gnss(fix: GnssFix) -> dict[str, Any]:
    return {
        "lat": plain(fix.latitude_deg, decimals=12),
        "lon": plain(fix.longitude_deg, decimals=12),
        "alt": plain(fix.altitude_m),
        "timestamp": plain(fix.time_s),
    }


def _imu(sample: ImuSample) -> dict[str, Any]:
    """Of a unit that is faster than the frames, `earlier` has what came since the last one."""
    return {
        **({"earlier": [_timed(one) for one in sample.earlier]} if sample.earlier else {}),
        "accelerometer": dict(zip("xyz", plain(mirror(sample.specific_force)), strict=True)),
        "gyroscope": dict(zip("xyz", plain(mirror_rate(sample.angular_rate)), strict=True)),
        "compass": plain(sample.compass_rad),
    }


def _timed(sample: ImuSample) -> dict[str, Any]:
    return {"time_offset": plain(sample.time_s), **_imu(sample)}


@cache
def _colour(material: str) -> str:
    """`r, g, b` from 0 to 255: a material's albedo in sRGB's transfer (IEC 61966-2-1)."""
    linear = np.array(MATERIALS[material].albedo)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return ", ".join(str(value) for value in np.rint(encoded * 255).astype(int))
