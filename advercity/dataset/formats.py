"""Layouts that a dataset may have, by name."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from advercity_dsl import Agent, Spec
from numpy.typing import NDArray

from advercity.dataset import adver_city, opv2v, pcd, ply
from advercity.dataset.documents import yaml_bytes
from advercity.dataset.reading import Reading
from advercity.errors import InputError
from advercity.world.scene import Lane

PROTOCOL = "data_protocol.yaml"


class Encode(Protocol):
    """Makes every file of one frame, by path within the scenario."""

    def __call__(
        self, readings: Sequence[Reading], lanes: Sequence[Lane], *, name: str
    ) -> dict[str, bytes]:
        """Files of the frame called `name`."""
        ...


@dataclass(frozen=True)
class Format:
    """How a dataset is laid out.

    Attributes:
        name: As it is asked for on the command line.
        folder_name: Names a viewpoint's folder.
        encode: Makes the files of a frame.
        cloud: How the names of point clouds end.
        read_cloud: Reads one as a table with `x`, `y`, `z` and `intensity`, left-handed.
        has_extras: Whether it keeps what the original did not: more of every object, maps and
            depths.
    """

    name: str
    folder_name: Callable[[Agent], str]
    encode: Encode
    cloud: str
    read_cloud: Callable[[Path], NDArray[np.void]]
    has_extras: bool


FORMATS = {
    item.name: item
    for item in (
        Format(
            "opv2v",
            opv2v.folder_name,
            opv2v.encode,
            cloud=opv2v.CLOUD,
            read_cloud=pcd.read,
            has_extras=True,
        ),
        Format(
            "adver_city",
            adver_city.folder_name,
            adver_city.encode,
            cloud=adver_city.CLOUD,
            read_cloud=ply.read,
            has_extras=False,
        ),
    )
}


def format_called(name: str) -> Format:
    """The format of that name; InputError if there is none."""
    if name not in FORMATS:
        raise InputError(f"--format {name}: no such format; {' or '.join(FORMATS)}")
    return FORMATS[name]


def frame_name(spec: Spec, index: int) -> str:
    """Six digits, the tick's number since the scenario's start, as the original counts."""
    return f"{spec.timing.warm_up_ticks + 1 + index:06d}"


def protocol(spec: Spec) -> bytes:
    """`data_protocol.yaml`: the whole spec."""
    return yaml_bytes(spec.model_dump(mode="json"))
