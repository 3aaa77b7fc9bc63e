"""The OPV2V layout: files that OpenCOOD, HEAL, CoAlign and CoBEVT load as they are.

Beside what they read lie extras where none of them looks: semantic images, what more is known of
every object, GNSS and IMU.
"""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from advercity_dsl import Agent
from numpy.typing import NDArray

from advercity.dataset import pcd
from advercity.dataset.annotation import annotate
from advercity.dataset.bird_view import bird_views
from advercity.dataset.description import describe, motion
from advercity.dataset.documents import json_bytes, yaml_bytes
from advercity.dataset.extras import extras
from advercity.dataset.images import in_three_channels, painted, side_by_side
from advercity.dataset.png import label_png, photograph_png
from advercity.dataset.reading import Picture, Reading
from advercity.world.scene import Lane

CLOUD = ".pcd"


def folder_name(agent: Agent) -> str:
    """Folder of a viewpoint.

    Loaders sort the folders as text and take the first as the ego, after moving one negative
    number to the end; with two roadside units that would be the second of them. `+` sorts
    before `-`, and `int("+101")` is 101, so the ego stays the ego.
    """
    is_ego = agent.place.kind == "vehicle" and agent.place.role == "ego"
    return f"{agent.number:+d}" if is_ego else str(agent.number)


def encode(readings: Sequence[Reading], lanes: Sequence[Lane], *, name: str) -> dict[str, bytes]:
    """Every file of one frame, by path within the scenario.

    The descriptions come last and the ego's is the very last: loaders take a frame for existing
    when they find it. The readings must be those of all agents, or loaders fail.

    Args:
        readings: One per viewpoint.
        lanes: The road plan.
        name: Of the frame.
    """
    ordered = sorted(readings, key=lambda reading: folder_name(reading.agent), reverse=True)
    stems = [f"{folder_name(reading.agent)}/{name}" for reading in ordered]
    jobs: dict[str, Callable[[], bytes]] = {}
    for stem, reading in zip(stems, ordered, strict=True):
        for index, picture in enumerate(reading.pictures):
            jobs[f"{stem}_camera{index}.png"] = partial(photograph_png, picture.image)
            jobs[f"{stem}_semantic{index}.png"] = partial(_semantic, picture)
            jobs[f"{stem}_depth{index}.png"] = partial(label_png, picture.depth)
    for stem, maps in zip(stems, bird_views(ordered, lanes), strict=True):
        jobs |= {f"{stem}_bev_{kind}.png": partial(_mask, mask) for kind, mask in maps.items()}
    files = side_by_side(jobs)
    objects = [annotate(reading) for reading in ordered]
    for stem, reading, items in zip(stems, ordered, objects, strict=True):
        files[f"{stem}{CLOUD}"] = _cloud(reading)
        files[f"{stem}_objects.json"] = json_bytes(extras(reading, items))
        if reading.gnss is not None or reading.imu is not None:
            files[f"{stem}_additional_gnss_imu.yaml"] = yaml_bytes(motion(reading))
    for stem, reading, items in zip(stems, ordered, objects, strict=True):
        files[f"{stem}.yaml"] = yaml_bytes(describe(reading, items))
    return files


def _semantic(picture: Picture) -> bytes:
    return label_png(painted(picture.semantic))


def _mask(mask: NDArray[np.uint8]) -> bytes:
    return label_png(in_three_channels(mask))


def _cloud(reading: Reading) -> bytes:
    return pcd.encode(reading.cloud, raw=reading.agent.sensors.lidar.motion_distortion)
