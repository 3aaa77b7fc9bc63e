"""The original's layout: its names and its files, for tools that were written for them.

Loaders of OPV2V do not read it: they miss the `.pcd`, take `_gnss_imu.yaml` for a frame and the
second roadside unit for the ego.
"""

from collections.abc import Callable, Sequence
from functools import partial

from advercity_dsl import Agent

from advercity.dataset import ply
from advercity.dataset.annotation import annotate
from advercity.dataset.carla_frame import mirror
from advercity.dataset.description import describe, motion
from advercity.dataset.documents import yaml_bytes
from advercity.dataset.images import painted, side_by_side
from advercity.dataset.png import label_png, photograph_png
from advercity.dataset.reading import Picture, Reading
from advercity.world.scene import Lane

CLOUD = "_lidar.ply"


def folder_name(agent: Agent) -> str:
    """Folder of a viewpoint: its number."""
    return str(agent.number)


def encode(readings: Sequence[Reading], lanes: Sequence[Lane], *, name: str) -> dict[str, bytes]:
    """Every file of one frame, by path within the scenario.

    Args:
        readings: One per viewpoint.
        lanes: Not drawn in this layout.
        name: Of the frame.
    """
    jobs: dict[str, Callable[[], bytes]] = {}
    for reading in readings:
        stem = f"{folder_name(reading.agent)}/{name}"
        for index, picture in enumerate(reading.pictures):
            jobs[f"{stem}_camera{index}.png"] = partial(photograph_png, picture.image)
            jobs[f"{stem}_semantic{index}.png"] = partial(_semantic, picture)
        jobs[f"{stem}{CLOUD}"] = partial(_cloud, reading)
        if reading.gnss is not None or reading.imu is not None:
            jobs[f"{stem}_gnss_imu.yaml"] = lambda reading=reading: yaml_bytes(motion(reading))
        jobs[f"{stem}.yaml"] = lambda reading=reading: yaml_bytes(
            describe(reading, annotate(reading))
        )
    return side_by_side(jobs)


def _semantic(picture: Picture) -> bytes:
    return label_png(painted(picture.semantic))


def _cloud(reading: Reading) -> bytes:
    return ply.encode(mirror(reading.cloud.points), intensity=reading.cloud.intensity)
