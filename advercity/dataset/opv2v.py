"""The OPV2V layout: a frame's readings as files that OpenCOOD, HEAL and CoBEVT load.

Everything here is left-handed (see `carla_frame`), in metres, degrees and km/h. Extras that
no loader reads are kept beside what they read: `class`, `bearing`, `lidar_hits`, semantic
images, GNSS and IMU.
"""

from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import numpy as np
import yaml
from advercity_dsl import Agent, Spec
from numpy.typing import ArrayLike

from advercity import poses
from advercity.dataset import pcd
from advercity.dataset.annotation import Annotation, annotate
from advercity.dataset.carla_frame import (
    angles_deg,
    mirror,
    mirror_pose,
    mirror_rate,
    pose_from_matrix,
)
from advercity.dataset.images import painted, png
from advercity.dataset.reading import Picture, Reading, intrinsic
from advercity.sensors.gnss import GnssFix
from advercity.sensors.imu import ImuSample
from advercity.world.materials import MATERIALS

PROTOCOL = "data_protocol.yaml"
KM_H_PER_M_S = 3.6


def folder_name(agent: Agent) -> str:
    """Folder of a viewpoint.

    Loaders sort the folders as text and take the first as the ego, after moving one negative
    number to the end; with two roadside units that would be the second of them. `+` sorts
    before `-`, and `int("+101")` is 101, so the ego stays the ego.
    """
    is_ego = agent.place.kind == "vehicle" and agent.place.role == "ego"
    return f"{agent.number:+d}" if is_ego else str(agent.number)


def frame_name(spec: Spec, index: int) -> str:
    """Six digits, the tick's number since the scenario's start, as the original counts."""
    return f"{spec.timing.warm_up_ticks + 1 + index:06d}"


def protocol(spec: Spec) -> bytes:
    """`data_protocol.yaml`: the whole spec."""
    return _yaml(spec.model_dump(mode="json"))


def encode(readings: Sequence[Reading], *, name: str) -> dict[str, bytes]:
    """Every file of one frame, by path within the scenario.

    The descriptions come last and the ego's is the very last: loaders take a frame for existing
    when they find it. The readings must be those of all agents, or loaders fail.
    """
    ordered = sorted(readings, key=lambda reading: folder_name(reading.agent), reverse=True)
    stems = [f"{folder_name(reading.agent)}/{name}" for reading in ordered]
    files = _images(ordered, stems)
    for stem, reading in zip(stems, ordered, strict=True):
        files[f"{stem}.pcd"] = _cloud(reading)
        if reading.gnss is not None or reading.imu is not None:
            files[f"{stem}_additional_gnss_imu.yaml"] = _yaml(_motion(reading))
    for stem, reading in zip(stems, ordered, strict=True):
        files[f"{stem}.yaml"] = _yaml(describe(reading))
    return files


def describe(reading: Reading) -> dict[str, Any]:
    """What `<frame>.yaml` says of a viewpoint, in plain types."""
    objects = annotate(reading)
    cameras = {
        f"camera{index}": _camera(reading, picture)
        for index, picture in enumerate(reading.pictures)
    }
    return {
        "RSU": reading.agent.place.kind == "roadside_unit",
        "ego_speed": _plain(reading.speed_m_s * KM_H_PER_M_S),
        "true_ego_pos": _plain(pose_from_matrix(reading.world_from_agent)),
        "predicted_ego_pos": _plain(pose_from_matrix(reading.estimated_world_from_agent)),
        "lidar_pose": _plain(pose_from_matrix(reading.world_from_lidar)),
        **cameras,
        "plan_trajectory": [
            _plain((x, -y, speed * KM_H_PER_M_S)) for x, y, speed in reading.planned
        ],
        "vehicles": {item.state.actor.id: _object(item) for item in objects if not _on_foot(item)},
        "walkers": {item.state.actor.id: _object(item) for item in objects if _on_foot(item)},
    }


def _on_foot(item: Annotation) -> bool:
    return item.state.actor.actor_class == "pedestrian"


def _object(item: Annotation) -> dict[str, Any]:
    """Loaders add `center` to `location` without turning it, so it is written turned."""
    actor = item.state.actor
    return {
        "class": "walker" if _on_foot(item) else actor.actor_class,
        "bp_id": actor.blueprint,
        "color": _colour(actor.paint),
        "location": _plain(mirror(item.location)),
        "center": _plain(mirror(item.centre - item.location)),
        "angle": _plain(angles_deg(item.state.world_from_body)),
        "extent": _plain(np.divide(actor.size, 2)),
        "speed": _plain(item.state.speed_m_s * KM_H_PER_M_S),
        "dist": _plain(item.distance_m),
        "bearing": _plain(-np.rad2deg(item.bearing_rad)),
        "relative_angle": _plain(-np.rad2deg(item.relative_yaw_rad)),
        "lidar_hits": item.lidar_hits,
    }


def _camera(reading: Reading, picture: Picture) -> dict[str, Any]:
    """`extrinsic` leads from the LiDAR to the camera, in body axes, as loaders compute it."""
    camera_from_lidar = poses.inverse(picture.world_from_camera) @ reading.world_from_lidar
    field_of_view = reading.agent.sensors.camera.horizontal_fov_deg
    return {
        "cords": _plain(pose_from_matrix(picture.world_from_camera)),
        "extrinsic": _plain(mirror_pose(camera_from_lidar)),
        "intrinsic": _plain(intrinsic(picture, horizontal_fov_deg=field_of_view)),
    }


def _motion(reading: Reading) -> dict[str, Any]:
    """What satellite receiver and inertial unit say, each where there is one."""
    gnss = {} if reading.gnss is None else {"gnss": _gnss(reading.gnss)}
    imu = {} if reading.imu is None else {"imu": _imu(reading.imu)}
    return gnss | imu


def _gnss(fix: GnssFix) -> dict[str, Any]:
    return {
        "lat": _plain(fix.latitude_deg, decimals=12),
        "lon": _plain(fix.longitude_deg, decimals=12),
        "alt": _plain(fix.altitude_m),
        "timestamp": _plain(fix.time_s),
    }


def _imu(sample: ImuSample) -> dict[str, Any]:
    return {
        "accelerometer": dict(zip("xyz", _plain(mirror(sample.specific_force)), strict=True)),
        "gyroscope": dict(zip("xyz", _plain(mirror_rate(sample.angular_rate)), strict=True)),
        "compass": _plain(sample.compass_rad),
    }


def _colour(material: str) -> str:
    """`r, g, b` from 0 to 255: a material's albedo in sRGB's transfer (IEC 61966-2-1)."""
    linear = np.array(MATERIALS[material].albedo)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return ", ".join(str(value) for value in np.rint(encoded * 255).astype(int))


def _cloud(reading: Reading) -> bytes:
    cloud = reading.cloud
    return pcd.encode(
        mirror(cloud.points),
        intensity=cloud.intensity,
        ring=cloud.ring,
        object_id=cloud.instance,
        tag=cloud.semantic,
    )


def _images(readings: Sequence[Reading], stems: Sequence[str]) -> dict[str, bytes]:
    """PNG files of all pictures, encoded side by side."""
    images: dict[str, Future[bytes]] = {}
    with ThreadPoolExecutor() as pool:
        for stem, reading in zip(stems, readings, strict=True):
            for index, picture in enumerate(reading.pictures):
                images[f"{stem}_camera{index}.png"] = pool.submit(png, picture.image)
                images[f"{stem}_semantic{index}.png"] = pool.submit(_semantic, picture)
    return {path: future.result() for path, future in images.items()}


def _semantic(picture: Picture) -> bytes:
    return png(painted(picture.semantic))


def _plain(values: ArrayLike, *, decimals: int = 9) -> Any:
    """Python floats, rounded; zero without a sign."""
    return (np.round(np.asarray(values, dtype=np.float64), decimals) + 0.0).tolist()


class _Dumper(yaml.CSafeDumper):
    """Plain YAML without anchors."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


def _yaml(document: dict[str, Any]) -> bytes:
    text = yaml.dump(document, Dumper=_Dumper, sort_keys=False, default_flow_style=None, width=200)
    return text.encode()
