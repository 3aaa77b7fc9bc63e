"""The layouts that a dataset may have, as the reader needs them: names of folders and files.

The encoders are in `opv2v`, so that reading a dataset loads nothing of what makes one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from advercity.dataset.cloud_files import read_pcd, read_ply
from advercity.errors import InputError

if TYPE_CHECKING:
    from advercity_dsl import Agent, Spec


@dataclass(frozen=True)
class DatasetFormat:
    """A layout of a dataset's files.

    Attributes:
        name: Value of the option `--format`.
        format_folder: Returns the name of an agent's folder.
        cloud_suffix: End of the names of point clouds.
        read_cloud: Reads one as a table with `x`, `y`, `z` and `intensity`, left-handed.
        has_extras: Whether it holds what the original does not: `_objects.json`, maps, depths.
    """

    name: str
    format_folder: Callable[[Agent], str]
    cloud_suffix: str
    read_cloud: Callable[[Path], NDArray[np.void]]
    has_extras: bool


def format_opv2v_folder(agent: Agent) -> str:
    """Return the folder of an agent's files: its number, the ego's with a plus.

    Loaders sort the folders as text and take the first as the ego, after moving one negative
    number to the end; with two roadside units that would be the second of them. `+` sorts
    before `-`, and `int("+101")` is 101, so the ego stays the ego.
    """
    return f"{agent.number:+d}" if agent.is_ego else str(agent.number)


def format_adver_city_folder(agent: Agent) -> str:
    """Return the folder of an agent's files as the original names it: its number."""
    return str(agent.number)


OPV2V = DatasetFormat("opv2v", format_opv2v_folder, ".pcd", read_pcd, has_extras=True)
ADVER_CITY = DatasetFormat(
    "adver_city", format_adver_city_folder, "_lidar.ply", read_ply, has_extras=False
)
FORMATS = {item.name: item for item in (OPV2V, ADVER_CITY)}


def find_format(name: str) -> DatasetFormat:
    """Return the format of that name; InputError if there is none."""
    if name not in FORMATS:
        raise InputError(f"--format {name}: no such format; {' or '.join(FORMATS)}")
    return FORMATS[name]


def format_frame_name(spec: Spec, index: int) -> str:
    """Return a frame's name: six digits, the tick since the scenario's start as in the original."""
    return f"{spec.timing.warm_up_ticks + 1 + index:06d}"


def is_frame_file(path: str) -> bool:
    """Return whether a path within a scenario is of a frame's file: `<agent>/<six digits>...`."""
    _, slash, name = path.partition("/")
    return bool(slash) and name[:6].isdigit()
