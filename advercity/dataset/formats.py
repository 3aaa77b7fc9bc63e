"""Layouts that a dataset may have, by name."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from advercity_dsl import Agent, Spec
from numpy.typing import NDArray

from advercity.dataset import cloud_files, opv2v
from advercity.errors import InputError
from advercity.roads.lane_segments import LaneSegment
from advercity.sensors.sensor_frame import SensorFrame


class FrameEncoder(Protocol):
    """Makes every file of one frame, by path within the scenario."""

    def __call__(
        self, readings: Sequence[SensorFrame], lanes: Sequence[LaneSegment], *, name: str
    ) -> dict[str, bytes]:
        """Files of the frame called `name`."""
        ...


@dataclass(frozen=True)
class DatasetFormat:
    """How a dataset is laid out.

    Attributes:
        name: As it is asked for on the command line.
        format_folder: Names a viewpoint's folder.
        encode_frame: Makes the files of a frame.
        cloud_suffix: How the names of point clouds end.
        read_cloud: Reads one as a table with `x`, `y`, `z` and `intensity`, left-handed.
        has_extras: Whether it keeps what the original did not: more of every object, maps and
            depths.
    """

    name: str
    format_folder: Callable[[Agent], str]
    encode_frame: FrameEncoder
    cloud_suffix: str
    read_cloud: Callable[[Path], NDArray[np.void]]
    has_extras: bool


FORMATS = {
    item.name: item
    for item in (
        DatasetFormat(
            "opv2v",
            opv2v.format_opv2v_folder,
            opv2v.encode_opv2v_frame,
            cloud_suffix=opv2v.OPV2V_CLOUD_SUFFIX,
            read_cloud=cloud_files.read_pcd,
            has_extras=True,
        ),
        DatasetFormat(
            "adver_city",
            opv2v.format_adver_city_folder,
            opv2v.encode_adver_city_frame,
            cloud_suffix=opv2v.ADVER_CITY_CLOUD_SUFFIX,
            read_cloud=cloud_files.read_ply,
            has_extras=False,
        ),
    )
}


def find_format(name: str) -> DatasetFormat:
    """The format of that name; InputError if there is none."""
    if name not in FORMATS:
        raise InputError(f"--format {name}: no such format; {' or '.join(FORMATS)}")
    return FORMATS[name]


def format_frame_name(spec: Spec, index: int) -> str:
    """Six digits, the tick's number since the scenario's start, as the original counts."""
    return f"{spec.timing.warm_up_ticks + 1 + index:06d}"
