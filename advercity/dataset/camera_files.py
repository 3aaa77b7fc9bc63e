"""Cameras in a dataset: their images, their calibration, and objects in their images."""

from collections.abc import Mapping
from dataclasses import asdict
from functools import partial
from typing import Any

import numpy as np
from advercity_dsl import Agent
from advercity_dsl.lens import CameraLens
from numpy.typing import NDArray

from advercity.dataset.agent_view import AgentView
from advercity.dataset.carla_frame import carla_pose_from_matrix, mirror_pose
from advercity.dataset.formats import ADVER_CITY, OPV2V, DatasetFormat
from advercity.dataset.image_codec import (
    encode_deep_png,
    encode_label_png,
    encode_photo_png,
    to_flow_colours,
    to_instance_colours,
    to_normal_colours,
    to_semantic_colours,
    to_whole_metres,
)
from advercity.dataset.plain_documents import to_plain
from advercity.dataset.sensor_files import EncodingJobs, FileOptions, SensorFiles
from advercity.geometry import poses
from advercity.geometry.arrays import Uint8Array
from advercity.geometry.poses import Matrix
from advercity.sensors.camera_model import MAX_DEPTH_CM, CameraModel
from advercity.sensors.measurements import OpticalFlow
from advercity.sensors.rolling_shutter import RollingCamera
from advercity.sensors.sensor_frame import CameraImage, ProjectedBox, SensorFrame

IMAGES = {
    OPV2V.name: ("camera", "semantic", "depth", "depth_cm"),
    ADVER_CITY.name: ("camera", "semantic"),
}
"""Kinds of images of every camera, by layout."""
MORE_IMAGES: dict[str, Mapping[str, tuple[str, ...]]] = {
    OPV2V.name: {
        "instance": ("instance",),
        "normal": ("normal",),
        "flow": ("flow", "occlusion"),
        "hdr": ("hdr",),
        "raw": ("raw",),
    },
    ADVER_CITY.name: {},
}
"""Kinds of images by option of a camera in a rig (truth, `hdr`, `raw`), by layout."""


def encode_semantic(semantic: Uint8Array) -> bytes:
    """Encode tags (h, w) of `Semantic` as an image of their colours."""
    return encode_label_png(to_semantic_colours(semantic))


def encode_instance(instance: NDArray[np.int32]) -> bytes:
    """Encode ids (h, w) of actors as an image of colours."""
    return encode_label_png(to_instance_colours(instance))


def describe_pinhole(
    item: SensorFrame, world_from_camera: Matrix, model: CameraModel
) -> dict[str, Any]:
    """Describe a camera; `extrinsic` maps `lidar_pose` to it in body axes, as loaders do."""
    camera_from_lidar = poses.invert_pose(world_from_camera) @ item.world_from_reference
    return {
        "cords": to_plain(carla_pose_from_matrix(world_from_camera)),
        "extrinsic": to_plain(mirror_pose(camera_from_lidar)),
        "intrinsic": to_plain(model.matrix),
    }


def describe_projected_box(box: ProjectedBox) -> dict[str, Any]:
    """Describe an actor in an image: fractions from 0 to 1, boxes in pixels."""
    visible_box = box.visible_box
    return {
        "visible_px": box.visible_px,
        "visible_fraction": to_plain(box.visible_fraction, decimals=4),
        "occlusion": to_plain(box.occlusion, decimals=4),
        "truncation": to_plain(box.truncation, decimals=4),
        "visible_box": None if visible_box is None else to_plain(visible_box, decimals=2),
        "outline_box": to_plain(box.outline_box, decimals=2),
    }


def _list_suffixes(agent: Agent, number: int, layout: DatasetFormat) -> tuple[str, ...]:
    asked = agent.sensors.cameras[number].model.more_images
    more = (kind for one in asked for kind in MORE_IMAGES[layout.name].get(one, ()))
    return tuple(f"_{kind}{number}.png" for kind in (*IMAGES[layout.name], *more))


def _encode(item: SensorFrame, number: int, options: FileOptions) -> EncodingJobs:
    image = item.camera_images[number]
    jobs = {
        "camera": partial(encode_photo_png, image.image),
        "semantic": partial(encode_semantic, image.semantic),
        "depth": partial(_encode_metres, image.depth_cm),
        "depth_cm": partial(encode_deep_png, image.depth_cm),
    }
    if image.instance is not None:
        jobs["instance"] = partial(encode_instance, image.instance)
    if image.normal is not None:
        jobs["normal"] = partial(_encode_normal, image.normal)
    if image.flow is not None:
        jobs["flow"] = partial(_encode_shifts, image.flow)
        jobs["occlusion"] = partial(_encode_occlusion, image.flow)
    if image.hdr is not None:
        jobs["hdr"] = partial(encode_deep_png, image.hdr)
    if image.raw is not None:
        jobs["raw"] = partial(encode_deep_png, image.raw)
    return {f"_{kind}{number}.png": job for kind, job in jobs.items()}


def _encode_normal(normal: NDArray[np.float32]) -> bytes:
    return encode_label_png(to_normal_colours(normal))


def _encode_shifts(flow: OpticalFlow) -> bytes:
    return encode_deep_png(to_flow_colours(flow.shift_px))


def _encode_occlusion(flow: OpticalFlow) -> bytes:
    return encode_label_png(flow.occluded.astype(np.uint8) * np.uint8(255))


def _encode_metres(depth_cm: NDArray[np.uint16]) -> bytes:
    return encode_label_png(to_whole_metres(depth_cm))


def _describe(item: SensorFrame, number: int) -> dict[str, Any]:
    image = item.camera_images[number]
    pinhole = describe_pinhole(item, image.world_from_camera, item.build_camera_model(number))
    lens = _describe_lens(item.agent.sensors.cameras[number].model.lens)
    return {f"camera{number}": {**pinhole, **lens, **_describe_shutter(image.rolling)}}


def _describe_lens(lens: CameraLens | None) -> dict[str, Any]:
    """Describe a lens by the keys of ROS, which readers of OPV2V ignore; a pinhole has none."""
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


def _label(item: SensorFrame, actor: int) -> dict[str, Any]:
    boxes = {
        f"camera{number}": describe_projected_box(image.projected_boxes[actor])
        for number, image in enumerate(item.camera_images)
        if actor in image.projected_boxes
    }
    return {"cameras": boxes}


def _annotate(item: SensorFrame) -> dict[str, Any]:
    """Describe the meaning of linear and raw values, by camera with such images."""
    readouts = {
        f"camera{number}": asdict(image.readout)
        for number, image in enumerate(item.camera_images)
        if image.readout is not None
    }
    return {"readouts": readouts} if readouts else {}


def _read(view: AgentView, number: int) -> CameraImage:
    """Read image and classes; depths and boxes are not in every layout."""
    semantic = view.semantic(number)
    return CameraImage(
        world_from_camera=view.world_from_camera(number),
        image=view.image(number),
        semantic=semantic,
        depth_cm=np.full(semantic.shape, MAX_DEPTH_CM, np.uint16),
        projected_boxes={},
        time_s=view.stamps.get(f"camera{number}"),
    )


FILES = SensorFiles(
    read=_read,
    list_suffixes=_list_suffixes,
    encode=_encode,
    describe=_describe,
    label=_label,
    annotate=_annotate,
    locate=AgentView.world_from_camera,
)
