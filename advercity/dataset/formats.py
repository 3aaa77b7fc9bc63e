"""The layouts of a dataset: names of folders and files, and how clouds are read.

The encoders are in `opv2v`, so reading a dataset loads no code for making one.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from advercity.dataset.cloud_files import read_pcd, read_ply
from advercity.dataset.sensor_files import load_all_files
from advercity.errors import InputError

if TYPE_CHECKING:
    from advercity_dsl import Agent, Spec


@dataclass(frozen=True)
class DatasetFormat:
    """A layout of a dataset's files.

    Attributes:
        name: Value of the option `--format`.
        format_folder: Returns the name of an agent's folder.
        cloud_suffix: End of the names of the first LiDAR's point clouds.
        read_cloud: Reads one as a table with `x`, `y`, `z` and `intensity`, left-handed.
        motion_suffix: End of the names of documents of receivers, inertial units and buses.
        extra_suffixes: Ends of the names of files unknown to the original.
    """

    name: str
    format_folder: Callable[[Agent], str]
    cloud_suffix: str
    read_cloud: Callable[[Path], NDArray[np.void]]
    motion_suffix: str
    extra_suffixes: tuple[str, ...] = ()

    def format_cloud_suffix(self, lidar: int) -> str:
        """Return the end of the names of a LiDAR's clouds: `.pcd`, then `_lidar1.pcd`."""
        file_type = self.cloud_suffix.rpartition(".")[2]
        return f"_lidar{lidar}.{file_type}" if lidar else self.cloud_suffix

    @staticmethod
    def format_radar_suffix(radar: int) -> str:
        """Return the end of the names of a radar's detections."""
        return f"_radar{radar}.pcd"

    @property
    def messages_suffix(self) -> str:
        """End of the names of files with an agent's messages."""
        return "_messages.json"

    @staticmethod
    def format_cube_suffix(radar: int) -> str:
        """Return the end of the names of a radar's cubes."""
        return f"_radar{radar}.npz"

    def list_suffixes(self, agent: Agent, *, has_channel: bool = False) -> frozenset[str]:
        """List the ends of the names of an agent's files of a frame, behind the frame's name."""
        sent = (self.messages_suffix,) if has_channel else ()
        measured = (
            suffix
            for kind, files in load_all_files().items()
            for number in range(len(agent.sensors.list_sensors(kind)))
            for suffix in files.list_suffixes(agent, number, self)
        )
        return frozenset((".yaml", *measured, *sent, *self.extra_suffixes))


def format_opv2v_folder(agent: Agent) -> str:
    """Return the folder of an agent's files: its number, the ego's with a plus.

    Loaders sort the folders as text and take the first as the ego, after moving one negative
    number to the end; with two roadside units they would take the second of these. `+` sorts
    before `-`, and `int("+101")` is 101, so the ego stays the ego.
    """
    return f"{agent.number:+d}" if agent.is_ego else str(agent.number)


def format_adver_city_folder(agent: Agent) -> str:
    """Return the folder of an agent's files as the original names it: its number."""
    return str(agent.number)


MAP_KINDS = ("dynamic", "static", "lane", "visibility", "visibility_corp")
OPV2V = DatasetFormat(
    "opv2v",
    format_opv2v_folder,
    ".pcd",
    read_pcd,
    motion_suffix="_additional_gnss_imu.yaml",
    extra_suffixes=("_objects.json", *(f"_bev_{kind}.png" for kind in MAP_KINDS)),
)
ADVER_CITY = DatasetFormat(
    "adver_city",
    format_adver_city_folder,
    "_lidar.ply",
    read_ply,
    motion_suffix="_gnss_imu.yaml",
)
FORMATS = {item.name: item for item in (OPV2V, ADVER_CITY)}


def find_format(name: str) -> DatasetFormat:
    """Return the format of a name; InputError if there is none."""
    if name not in FORMATS:
        raise InputError(f"--format {name}: no such format; {' or '.join(FORMATS)}")
    return FORMATS[name]


def format_frame_name(spec: Spec, index: int) -> str:
    """Return a frame's name: six digits, the tick since the scenario's start as in the original."""
    return f"{spec.timing.warm_up_ticks + 1 + index:06d}"


class FrameFileNames:
    """The names of all files written by runs for the frames of a scenario, and no others.

    Args:
        spec: The spec.
        format: Name of the layout.
        length: Number of frames of the whole scenario.
    """

    def __init__(self, spec: Spec, format: str, length: int) -> None:
        layout = find_format(format)
        self._first, self._length = int(format_frame_name(spec, 0)), length
        self._suffixes = {
            layout.format_folder(agent): layout.list_suffixes(
                agent, has_channel=spec.channel is not None
            )
            for agent in spec.recorded_agents
        }

    @property
    def folders(self) -> tuple[str, ...]:
        """Names of the agents' folders."""
        return tuple(self._suffixes)

    def find_frame(self, path: str) -> int | None:
        """Return the frame of a path within the scenario; None if no run writes this path."""
        folder, _, name = path.partition("/")
        match = re.fullmatch(r"([0-9]{6,})([._].*)", name)
        if match is None or match[2] not in self._suffixes.get(folder, ()):
            return None
        frame = int(match[1]) - self._first
        is_written = 0 <= frame < self._length and match[1] == f"{int(match[1]):06d}"
        return frame if is_written else None

    def list_files(self, scenario: Path) -> dict[str, int]:
        """List the existing files with such names by path, with their frames."""
        paths = (path for folder in self._suffixes for path in (scenario / folder).glob("[0-9]*"))
        found = {
            (name := path.relative_to(scenario).as_posix()): self.find_frame(name)
            for path in paths
            if path.is_file() or path.is_symlink()
        }
        return {name: frame for name, frame in found.items() if frame is not None}
