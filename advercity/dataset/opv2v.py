"""The OPV2V layout: files that OpenCOOD, HEAL, CoAlign and CoBEVT load as they are.

Beside what they read lie extras where none of them looks: semantic images, what more is known of
every object, GNSS and IMU.

The original's layout: its names and its files, for tools that were written for them.

Loaders of OPV2V do not read it: they miss the `.pcd`, take `_gnss_imu.yaml` for a frame and the
second roadside unit for the ego.
"""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np
from advercity_dsl import Agent
from numpy.typing import NDArray

from advercity.dataset import cloud_files
from advercity.dataset.bird_view import draw_bird_views
from advercity.dataset.carla_frame import mirror_points
from advercity.dataset.frame_documents import (
    build_frame_description,
    build_motion_document,
    build_object_extras,
    format_json,
    format_yaml,
)
from advercity.dataset.image_codec import (
    encode_label_png,
    encode_photo_png,
    to_semantic_colours,
    to_three_channels,
)
from advercity.roads.lane_segments import LaneSegment
from advercity.sensors.annotation import annotate_actors
from advercity.sensors.sensor_frame import CameraImage, SensorFrame


def run_concurrently(jobs: Mapping[str, Callable[[], bytes]]) -> dict[str, bytes]:
    """What every job gives, by its name; OpenCV and NumPy let threads run together."""
    with ThreadPoolExecutor() as pool:
        running = {name: pool.submit(job) for name, job in jobs.items()}
    return {name: future.result() for name, future in running.items()}


OPV2V_CLOUD_SUFFIX = ".pcd"


def format_opv2v_folder(agent: Agent) -> str:
    """Folder of a viewpoint.

    Loaders sort the folders as text and take the first as the ego, after moving one negative
    number to the end; with two roadside units that would be the second of them. `+` sorts
    before `-`, and `int("+101")` is 101, so the ego stays the ego.
    """
    return f"{agent.number:+d}" if agent.is_ego else str(agent.number)


def encode_opv2v_frame(
    readings: Sequence[SensorFrame], lanes: Sequence[LaneSegment], *, name: str
) -> dict[str, bytes]:
    """Every file of one frame, by path within the scenario.

    The descriptions come last and the ego's is the very last: loaders take a frame for existing
    when they find it. The readings must be those of all agents, or loaders fail.

    Args:
        readings: One per viewpoint.
        lanes: The road plan.
        name: Of the frame.
    """
    ordered = sorted(readings, key=lambda reading: format_opv2v_folder(reading.agent), reverse=True)
    stems = [f"{format_opv2v_folder(reading.agent)}/{name}" for reading in ordered]
    jobs: dict[str, Callable[[], bytes]] = {}
    for stem, reading in zip(stems, ordered, strict=True):
        for index, picture in enumerate(reading.camera_images):
            jobs[f"{stem}_camera{index}.png"] = partial(encode_photo_png, picture.image)
            jobs[f"{stem}_semantic{index}.png"] = partial(_encode_semantic, picture)
            jobs[f"{stem}_depth{index}.png"] = partial(encode_label_png, picture.depth)
    for stem, maps in zip(stems, draw_bird_views(ordered, lanes), strict=True):
        jobs |= {
            f"{stem}_bev_{kind}.png": partial(_encode_mask, mask) for kind, mask in maps.items()
        }
    files = run_concurrently(jobs)
    objects = [annotate_actors(reading) for reading in ordered]
    for stem, reading, items in zip(stems, ordered, objects, strict=True):
        files[f"{stem}{OPV2V_CLOUD_SUFFIX}"] = _encode_pcd_cloud(reading)
        files[f"{stem}_objects.json"] = format_json(build_object_extras(reading, items))
        if reading.gnss is not None or reading.imu is not None:
            files[f"{stem}_additional_gnss_imu.yaml"] = format_yaml(build_motion_document(reading))
    for stem, reading, items in zip(stems, ordered, objects, strict=True):
        files[f"{stem}.yaml"] = format_yaml(build_frame_description(reading, items))
    return files


def _encode_semantic(picture: CameraImage) -> bytes:
    return encode_label_png(to_semantic_colours(picture.semantic))


def _encode_mask(mask: NDArray[np.uint8]) -> bytes:
    return encode_label_png(to_three_channels(mask))


def _encode_pcd_cloud(reading: SensorFrame) -> bytes:
    return cloud_files.encode_pcd(
        reading.point_cloud, raw=reading.agent.sensors.lidar.motion_distortion
    )


ADVER_CITY_CLOUD_SUFFIX = "_lidar.ply"


def format_adver_city_folder(agent: Agent) -> str:
    """Folder of a viewpoint: its number."""
    return str(agent.number)


def encode_adver_city_frame(
    readings: Sequence[SensorFrame], lanes: Sequence[LaneSegment], *, name: str
) -> dict[str, bytes]:
    """Every file of one frame, by path within the scenario.

    Args:
        readings: One per viewpoint.
        lanes: Not drawn in this layout.
        name: Of the frame.
    """
    jobs: dict[str, Callable[[], bytes]] = {}
    for reading in readings:
        stem = f"{format_adver_city_folder(reading.agent)}/{name}"
        for index, picture in enumerate(reading.camera_images):
            jobs[f"{stem}_camera{index}.png"] = partial(encode_photo_png, picture.image)
            jobs[f"{stem}_semantic{index}.png"] = partial(_encode_adver_city_semantic, picture)
        jobs[f"{stem}{ADVER_CITY_CLOUD_SUFFIX}"] = partial(_encode_ply_cloud, reading)
        if reading.gnss is not None or reading.imu is not None:
            jobs[f"{stem}_gnss_imu.yaml"] = lambda reading=reading: format_yaml(
                build_motion_document(reading)
            )
        jobs[f"{stem}.yaml"] = lambda reading=reading: format_yaml(
            build_frame_description(reading, annotate_actors(reading))
        )
    return run_concurrently(jobs)


def _encode_adver_city_semantic(picture: CameraImage) -> bytes:
    return encode_label_png(to_semantic_colours(picture.semantic))


def _encode_ply_cloud(reading: SensorFrame) -> bytes:
    return cloud_files.encode_ply(
        mirror_points(reading.point_cloud.points), intensity=reading.point_cloud.intensity
    )
