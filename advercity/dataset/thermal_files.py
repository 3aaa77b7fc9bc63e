"""Thermal cameras in a dataset: their images, their calibration, and objects in their images."""

from functools import partial
from typing import Any

import numpy as np
from advercity_dsl import Agent

from advercity.dataset.agent_view import AgentView
from advercity.dataset.camera_files import (
    describe_pinhole,
    describe_projected_box,
    encode_instance,
    encode_semantic,
)
from advercity.dataset.formats import ADVER_CITY, OPV2V, DatasetFormat
from advercity.dataset.image_codec import encode_deep_png
from advercity.dataset.sensor_files import EncodingJobs, FileOptions, SensorFiles
from advercity.sensors.measurements import KELVIN_PER_COUNT
from advercity.sensors.sensor_frame import SensorFrame, ThermalImage

IMAGES = {
    OPV2V.name: ("thermal", "thermal_semantic", "thermal_instance"),
    ADVER_CITY.name: ("thermal",),
}
"""Kinds of images of every thermal camera, by layout."""


def _list_suffixes(agent: Agent, number: int, layout: DatasetFormat) -> tuple[str, ...]:
    return tuple(f"_{kind}{number}.png" for kind in IMAGES[layout.name])


def _encode(item: SensorFrame, number: int, options: FileOptions) -> EncodingJobs:
    image = item.thermal_images[number]
    return {
        f"_thermal{number}.png": partial(encode_deep_png, image.counts),
        f"_thermal_semantic{number}.png": partial(encode_semantic, image.semantic),
        f"_thermal_instance{number}.png": partial(encode_instance, image.instance),
    }


def _describe(item: SensorFrame, number: int) -> dict[str, Any]:
    """Describe it like other cameras, with the temperature step of its values."""
    pose, model = item.thermal_images[number].world_from_camera, item.build_thermal_model(number)
    step = {"kelvin_per_count": KELVIN_PER_COUNT}
    return {f"thermal{number}": describe_pinhole(item, pose, model) | step}


def _label(item: SensorFrame, actor: int) -> dict[str, Any]:
    if not item.thermal_images:
        return {}
    boxes = {
        f"thermal{number}": describe_projected_box(image.projected_boxes[actor])
        for number, image in enumerate(item.thermal_images)
        if actor in image.projected_boxes
    }
    return {"thermals": boxes}


def _read(view: AgentView, number: int) -> ThermalImage:
    """Read the image; labels and boxes are not in every layout."""
    counts = view.thermal_counts(number)
    return ThermalImage(
        view.load_thermal_pose(number),
        counts,
        semantic=np.zeros(counts.shape, np.uint8),
        instance=np.zeros(counts.shape, np.int32),
        projected_boxes={},
        time_s=view.stamps.get(f"thermal{number}"),
    )


FILES = SensorFiles(
    read=_read,
    list_suffixes=_list_suffixes,
    encode=_encode,
    describe=_describe,
    label=_label,
    locate=AgentView.load_thermal_pose,
)
