"""The files of a frame in both layouts, as bytes by their paths.

OPV2V: files that OpenCOOD, HEAL, CoAlign and CoBEVT load as they are, and extras where none of
those loaders looks: semantic images, more of every object, GNSS and IMU.

Adver-City: the names and files of the original, for tools that were written for them. Loaders of
OPV2V do not read it: they miss the `.pcd`, take `_gnss_imu.yaml` for a frame and the second
roadside unit for the ego.
"""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from advercity.dataset import cloud_files, radar_files
from advercity.dataset.bird_view import draw_bird_views
from advercity.dataset.carla_frame import mirror_points
from advercity.dataset.cloud_files import CloudEncoding
from advercity.dataset.formats import ADVER_CITY, OPV2V, DatasetFormat, has_motion_file
from advercity.dataset.frame_documents import (
    build_frame_description,
    build_motion_document,
    build_object_extras,
    format_json,
    format_yaml,
)
from advercity.dataset.image_codec import (
    encode_deep_png,
    encode_label_png,
    encode_photo_png,
    to_flow_colours,
    to_instance_colours,
    to_normal_colours,
    to_semantic_colours,
    to_three_channels,
    to_whole_metres,
)
from advercity.dataset.message_documents import build_messages_document
from advercity.geometry.arrays import Uint8Array
from advercity.roads.lane_segments import LaneSegment
from advercity.sensors.annotation import annotate_actors
from advercity.sensors.measurements import OpticalFlow, PointCloud
from advercity.sensors.sensor_frame import SensorFrame

EncodingJobs = dict[str, Callable[[], bytes]]


class FrameEncoder(Protocol):
    """Encodes every file of one frame, by path within the scenario."""

    def __call__(
        self, sensor_frames: Sequence[SensorFrame], lanes: Sequence[LaneSegment], *, name: str
    ) -> dict[str, bytes]:
        """Encode the files of the frame called `name`."""
        ...


def encode_opv2v_frame(
    sensor_frames: Sequence[SensorFrame],
    lanes: Sequence[LaneSegment],
    *,
    name: str,
    clouds: CloudEncoding = "binary_compressed",
) -> dict[str, bytes]:
    """Encode every file of one frame, by path within the scenario.

    Args:
        sensor_frames: One per agent; loaders fail where an agent is left out.
        lanes: Lanes of the road, for the maps.
        name: Name of the frame.
        clouds: Encoding of point clouds.
    """
    # Descriptions come last and the ego's is the very last: loaders take a frame for existing when
    # they find it, and files are moved into place in this order.
    ordered = sorted(sensor_frames, key=lambda item: OPV2V.format_folder(item.agent), reverse=True)
    stems = [_format_stem(OPV2V, item, name) for item in ordered]
    jobs: EncodingJobs = {}
    for stem, item in zip(stems, ordered, strict=True):
        for index, image in enumerate(item.camera_images):
            jobs[f"{stem}_camera{index}.png"] = partial(encode_photo_png, image.image)
            jobs[f"{stem}_semantic{index}.png"] = partial(_encode_semantic, image.semantic)
            jobs[f"{stem}_depth{index}.png"] = partial(_encode_metres, image.depth_cm)
            jobs[f"{stem}_depth_cm{index}.png"] = partial(encode_deep_png, image.depth_cm)
            if image.instance is not None:
                jobs[f"{stem}_instance{index}.png"] = partial(_encode_instance, image.instance)
            if image.normal is not None:
                jobs[f"{stem}_normal{index}.png"] = partial(_encode_normal, image.normal)
            if image.flow is not None:
                jobs[f"{stem}_flow{index}.png"] = partial(_encode_shifts, image.flow)
                jobs[f"{stem}_occlusion{index}.png"] = partial(_encode_occlusion, image.flow)
            if image.hdr is not None:
                jobs[f"{stem}_hdr{index}.png"] = partial(encode_deep_png, image.hdr)
            if image.raw is not None:
                jobs[f"{stem}_raw{index}.png"] = partial(encode_deep_png, image.raw)
        for index, image in enumerate(item.thermal_images):
            jobs |= {
                f"{stem}_thermal{index}.png": partial(encode_deep_png, image.counts),
                f"{stem}_thermal_semantic{index}.png": partial(_encode_semantic, image.semantic),
                f"{stem}_thermal_instance{index}.png": partial(_encode_instance, image.instance),
            }
    for stem, maps in zip(stems, draw_bird_views(ordered, lanes), strict=True):
        jobs |= {
            f"{stem}_bev_{kind}.png": partial(_encode_mask, mask) for kind, mask in maps.items()
        }
    files = _run_concurrently(jobs)
    annotations = [annotate_actors(item) for item in ordered]
    for stem, item, annotated in zip(stems, ordered, annotations, strict=True):
        for index, lidar in enumerate(item.agent.sensors.lidars):
            files[f"{stem}{OPV2V.format_cloud_suffix(index)}"] = cloud_files.encode_pcd(
                item.lidar_scans[index].point_cloud,
                raw=lidar.motion_distortion,
                encoding=clouds,
            )
        files |= _encode_radars(OPV2V, stem, item, clouds)
        files |= _encode_messages(OPV2V, stem, item)
        files[f"{stem}_objects.json"] = format_json(build_object_extras(item, annotated))
        if has_motion_file(item.agent):
            files[f"{stem}{OPV2V.motion_suffix}"] = format_yaml(build_motion_document(item))
    for stem, item, annotated in zip(stems, ordered, annotations, strict=True):
        files[f"{stem}.yaml"] = format_yaml(build_frame_description(item, annotated))
    return files


def encode_adver_city_frame(
    sensor_frames: Sequence[SensorFrame], lanes: Sequence[LaneSegment], *, name: str
) -> dict[str, bytes]:
    """Encode every file of one frame, by path within the scenario.

    Args:
        sensor_frames: One per agent.
        lanes: Not used: this layout has no maps.
        name: Name of the frame.
    """
    jobs, files = EncodingJobs(), dict[str, bytes]()
    for item in sensor_frames:
        stem = _format_stem(ADVER_CITY, item, name)
        for index, image in enumerate(item.camera_images):
            jobs[f"{stem}_camera{index}.png"] = partial(encode_photo_png, image.image)
            jobs[f"{stem}_semantic{index}.png"] = partial(_encode_semantic, image.semantic)
        for index, image in enumerate(item.thermal_images):
            jobs[f"{stem}_thermal{index}.png"] = partial(encode_deep_png, image.counts)
        for index, scan in enumerate(item.lidar_scans):
            jobs[f"{stem}{ADVER_CITY.format_cloud_suffix(index)}"] = partial(
                _encode_ply, scan.point_cloud
            )
        files |= _encode_radars(ADVER_CITY, stem, item, "binary_compressed")
        files |= _encode_messages(ADVER_CITY, stem, item)
        if has_motion_file(item.agent):
            jobs[f"{stem}{ADVER_CITY.motion_suffix}"] = partial(_encode_motion, item)
        jobs[f"{stem}.yaml"] = partial(_encode_description, item)
    return files | _run_concurrently(jobs)


def select_encoder(layout: str, clouds: CloudEncoding) -> FrameEncoder:
    """Select the encoder of a layout; `clouds` is for OPV2V's clouds, the original's are text."""
    if layout == ADVER_CITY.name:
        return encode_adver_city_frame
    return partial(encode_opv2v_frame, clouds=clouds)


def _run_concurrently(jobs: Mapping[str, Callable[[], bytes]]) -> dict[str, bytes]:
    """Run every job in a thread, and return the results by name in the order of the jobs."""
    # OpenCV, zlib-ng and NumPy release the interpreter lock.
    with ThreadPoolExecutor() as pool:
        running = {name: pool.submit(job) for name, job in jobs.items()}
    return {name: future.result() for name, future in running.items()}


def _encode_radars(
    layout: DatasetFormat, stem: str, item: SensorFrame, encoding: CloudEncoding
) -> dict[str, bytes]:
    """Encode the detections of an agent's radars, and their cubes if they report them."""
    files: dict[str, bytes] = {}
    for index, scan in enumerate(item.radar_scans):
        path = f"{stem}{layout.format_radar_suffix(index)}"
        files[path] = radar_files.encode_detections(scan.detections, encoding)
        if scan.cube is not None:
            path = f"{stem}{layout.format_cube_suffix(index)}"
            files[path] = radar_files.encode_cube(scan.cube)
    return files


def _encode_messages(layout: DatasetFormat, stem: str, item: SensorFrame) -> dict[str, bytes]:
    """Encode what an agent sends, also nothing, if there is a channel."""
    if item.sent is None:
        return {}
    document = build_messages_document(item.frame, item.sent)
    return {f"{stem}{layout.messages_suffix}": format_json(document)}


def _format_stem(layout: DatasetFormat, item: SensorFrame, name: str) -> str:
    return f"{layout.format_folder(item.agent)}/{name}"


def _encode_semantic(semantic: Uint8Array) -> bytes:
    return encode_label_png(to_semantic_colours(semantic))


def _encode_instance(instance: NDArray[np.int32]) -> bytes:
    return encode_label_png(to_instance_colours(instance))


def _encode_normal(normal: NDArray[np.float32]) -> bytes:
    return encode_label_png(to_normal_colours(normal))


def _encode_shifts(flow: OpticalFlow) -> bytes:
    return encode_deep_png(to_flow_colours(flow.shift_px))


def _encode_occlusion(flow: OpticalFlow) -> bytes:
    return encode_label_png(flow.occluded.astype(np.uint8) * np.uint8(255))


def _encode_metres(depth_cm: NDArray[np.uint16]) -> bytes:
    return encode_label_png(to_whole_metres(depth_cm))


def _encode_mask(mask: Uint8Array) -> bytes:
    return encode_label_png(to_three_channels(mask))


def _encode_ply(cloud: PointCloud) -> bytes:
    return cloud_files.encode_ply(mirror_points(cloud.points), intensity=cloud.intensity)


def _encode_motion(item: SensorFrame) -> bytes:
    return format_yaml(build_motion_document(item))


def _encode_description(item: SensorFrame) -> bytes:
    return format_yaml(build_frame_description(item, annotate_actors(item)))
