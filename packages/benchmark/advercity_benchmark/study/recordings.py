"""Pictures and LiDAR sweeps of a folder, in the layouts of real data sets or in our own.

A recording has the data of one vehicle's front camera and upper LiDAR. Real data sets are the
user's own folders: advercity downloads none.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from advercity.atomic_files import resolve_links
from advercity.dataset.agent_view import AgentView
from advercity.dataset.reader import open_dataset
from advercity.dataset.scenario_folders import find_scenarios
from advercity.documents import read_bytes
from advercity.errors import InputError, describe_cause
from advercity.image_files import decode_image

Item = TypeVar("Item")
INSTALL_HINT = "try: pip install 'advercity[benchmark]'"
MAX_PICTURE_BYTES = 10**9
MAX_SWEEP_BYTES = 10**9
PICTURE_SUFFIXES = (".png", ".jpg", ".jpeg", ".webp")


@dataclass(frozen=True, eq=False)
class Sweep:
    """Echoes of one turn of a LiDAR.

    Attributes:
        points: (n, 3) float32, metres, origin in the LiDAR.
        intensity: (n,) float32, 0 to 1 of the data set's range.
    """

    points: NDArray[np.float32]
    intensity: NDArray[np.float32]


@dataclass(frozen=True)
class SweepFormat:
    """Binary sweeps: rows of little-endian float32.

    Attributes:
        columns: Numbers a row: x, y, z and intensity first.
        full_intensity: Intensity of the brightest possible echo.
    """

    columns: int
    full_intensity: float


@dataclass(frozen=True)
class FolderLayout:
    """Paths of the front camera's pictures and the LiDAR's sweeps in a data set.

    Attributes:
        name: Name of the data set.
        pictures: Patterns of paths within the folder; the first with a match counts.
        sweeps: The same for sweeps; none if there are none.
        sweep_format: Content of the sweeps.
    """

    name: str
    pictures: tuple[str, ...]
    sweeps: tuple[str, ...] = ()
    sweep_format: SweepFormat = SweepFormat(4, 1.0)


FOLDER_LAYOUTS = (
    FolderLayout(
        "nuscenes",
        ("samples/CAM_FRONT/*",),
        ("samples/LIDAR_TOP/*.bin",),
        SweepFormat(5, 255.0),
    ),
    FolderLayout(
        "kitti",
        ("training/image_2/*", "image_2/*", "**/image_02/data/*"),
        ("training/velodyne/*.bin", "velodyne/*.bin", "**/velodyne_points/data/*.bin"),
    ),
    FolderLayout("cadc", ("**/image_00/data/*",), ("**/lidar_points/data/*.bin",)),
    FolderLayout(
        "boreas",
        ("**/camera/*",),
        ("**/lidar/*.bin",),
        SweepFormat(columns=6, full_intensity=255.0),
    ),
    FolderLayout("acdc", ("rgb_anon/**/*_rgb_anon.png", "**/*_rgb_anon.png")),
    FolderLayout("pictures", ("*",)),
)
"""Layouts from the most particular to a folder of pictures.

Sources: the sets' documentations (KITTI object and raw, nuScenes 1.0, CADC 2020, Boreas 2021, ACDC
2021).
"""


@dataclass(frozen=True)
class Recording:
    """Pictures and sweeps of one set, read one at a time.

    Attributes:
        name: Name in tables and plots.
        layout: Name of the found layout.
        picture_loaders: A function for each picture: (h, w, 3) uint8, RGB.
        sweep_loaders: A function for each sweep.
    """

    name: str
    layout: str
    picture_loaders: Sequence[Callable[[], NDArray[np.uint8]]]
    sweep_loaders: Sequence[Callable[[], Sweep]]

    def thin(self, limit: int) -> "Recording":
        """Copy the recording with at most `limit` pictures and sweeps, evenly over all."""
        return Recording(
            self.name,
            self.layout,
            _take_evenly(self.picture_loaders, limit),
            _take_evenly(self.sweep_loaders, limit),
        )


def open_recordings(arguments: Sequence[str]) -> list[Recording]:
    """Open folders, each `FOLDER` or `NAME=FOLDER`.

    Raises:
        InputError: A folder has neither pictures nor sweeps, or two have the same name.
    """
    recordings = [_open_recording(text) for text in arguments]
    names = [recording.name for recording in recordings]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"two folders are called '{name}'; name them: one={name} two=...")
    return recordings


def _open_recording(text: str) -> Recording:
    name, separator, path = text.partition("=")
    folder = Path(path if separator else text)
    name = name if separator else resolve_links(folder).name
    if separator and not name:
        raise InputError(f"{text}: has no name before '='; give one, such as ours{text}")
    if not folder.is_dir():
        raise InputError(f"{folder}: is no folder")
    if _is_own(folder):
        return _open_own(name, folder)
    for layout in FOLDER_LAYOUTS:
        pictures = [
            path for path in _find(folder, layout.pictures) if path.suffix in PICTURE_SUFFIXES
        ]
        sweeps = _find(folder, layout.sweeps)
        if pictures or sweeps:
            return Recording(
                name,
                layout.name,
                [_PictureFile(path) for path in pictures],
                [_SweepFile(path, layout.sweep_format) for path in sweeps],
            )
    known = ", ".join(layout.name for layout in FOLDER_LAYOUTS[:-1])
    raise InputError(
        f"{folder}: has no pictures and no LiDAR sweeps where one of these has them: advercity,"
        f" {known}, a folder of pictures"
    )


def _is_own(folder: Path) -> bool:
    with suppress(InputError):
        return bool(find_scenarios(folder))
    return False


def _open_own(name: str, folder: Path) -> Recording:
    views = [
        view
        for frame in open_dataset(folder)
        for view in frame.views.values()
        if view.agent.place.kind == "vehicle"
    ]
    return Recording(
        name,
        "advercity",
        [partial(view.image, 0) for view in views if view.cameras],
        [partial(_load_own_sweep, view) for view in views if view.lidars],
    )


def _load_own_sweep(view: AgentView) -> Sweep:
    table = view.cloud
    points = np.column_stack([table["x"], table["y"], table["z"]]).astype(np.float32)
    return Sweep(points, table["intensity"].astype(np.float32))


def _find(folder: Path, patterns: Sequence[str]) -> list[Path]:
    for pattern in patterns:
        found = sorted(path for path in folder.glob(pattern) if path.is_file())
        if found:
            return found
    return []


@dataclass(frozen=True)
class _PictureFile:
    path: Path

    def __call__(self) -> NDArray[np.uint8]:
        """Read the picture (h, w, 3)."""
        raw = _read(self.path, MAX_PICTURE_BYTES)
        try:
            return decode_image(raw, cv2.IMREAD_COLOR_RGB).astype(np.uint8)
        except ValueError as error:
            raise InputError(f"{self.path}: is no picture: {error}") from error


@dataclass(frozen=True)
class _SweepFile:
    path: Path
    format: SweepFormat

    def __call__(self) -> Sweep:
        """Read the sweep."""
        raw = _read(self.path, MAX_SWEEP_BYTES)
        row = 4 * self.format.columns
        if len(raw) % row:
            raise InputError(
                f"{self.path}: has {len(raw)} bytes, which are no rows of {self.format.columns}"
                " float32 as this layout has"
            )
        table = np.frombuffer(raw, "<f4").reshape(-1, self.format.columns)
        return Sweep(table[:, :3], (table[:, 3] / self.format.full_intensity).astype(np.float32))


def _read(path: Path, max_bytes: int) -> bytes:
    try:
        return read_bytes(path, max_bytes=max_bytes)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {describe_cause(error)}") from error


def _take_evenly(items: Sequence[Item], limit: int) -> Sequence[Item]:
    if len(items) <= limit:
        return items
    places = np.linspace(0, len(items) - 1, limit).round().astype(int)
    return [items[place] for place in places]
