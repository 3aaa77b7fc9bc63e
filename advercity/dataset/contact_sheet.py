"""One frame at a glance: a row per viewpoint with its cameras, semantics and LiDAR from above."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from advercity.dataset import pcd
from advercity.dataset.opv2v import PROTOCOL
from advercity.errors import InputError, RunError

CELL_WIDTH = 384
BAR = 22
"""Height of the strip that holds a row's name."""
LIDAR_REACH_M = 60.0

Image = NDArray[np.uint8]


def write_contact_sheet(scenario: Path, output: Path) -> None:
    """Write a PNG of the frame in the middle of a scenario.

    Args:
        scenario: Folder of one scenario in the OPV2V layout.
        output: File to write.

    Raises:
        InputError: There is no frame in `scenario`.
        RunError: The picture cannot be written.
    """
    agents = _agents(scenario)
    frames = sorted(path.stem for path in agents[0].glob("*.pcd")) if agents else []
    if not frames:
        raise InputError(f"{scenario}: no frames here; give the folder of one scenario")
    frame = frames[len(frames) // 2]
    rows = [_row(agent, frame) for agent in agents]
    output.parent.mkdir(parents=True, exist_ok=True)
    if not cv2.imwrite(str(output), np.vstack(rows)):
        raise RunError(f"{output}: cannot be written")


def _agents(scenario: Path) -> list[Path]:
    """Folders of the viewpoints: vehicles first, then roadside units."""
    if not (scenario / PROTOCOL).is_file():
        return []
    folders = [path for path in scenario.iterdir() if path.is_dir()]
    return sorted(folders, key=lambda path: (int(path.name) < 0, abs(int(path.name))))


def _row(agent: Path, frame: str) -> Image:
    views = ("camera2", "camera0", "camera1", "camera3", "semantic0")
    cells = [_cell(agent / f"{frame}_{view}.png") for view in views]
    height = cells[0].shape[0]
    above = lidar_from_above(pcd.read(agent / f"{frame}.pcd"), height)
    name = f"{agent.name}  frame {frame}: left, front, right, rear, semantic front, LiDAR"
    return np.vstack([_label(name, CELL_WIDTH * len(cells) + height), np.hstack([*cells, above])])


def _cell(path: Path) -> Image:
    image: Any = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if image is None:
        raise InputError(f"{path}: is missing or no picture; `advercity verify` tells what else")
    height = round(CELL_WIDTH * image.shape[0] / image.shape[1])
    return cv2.resize(image, (CELL_WIDTH, height), interpolation=cv2.INTER_AREA).astype(np.uint8)


def _label(text: str, width: int) -> Image:
    bar = np.full((BAR, width, 3), 32, np.uint8)
    cv2.putText(bar, text, (6, BAR - 7), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (235,) * 3, 1, cv2.LINE_AA)
    return bar


def lidar_from_above(cloud: NDArray[np.void], size: int) -> Image:
    """A cloud seen from above, its sensor in the middle, ahead upwards; BGR (size, size, 3)."""
    scale = size / (2 * LIDAR_REACH_M)
    row = (size / 2 - cloud["x"] * scale).astype(np.intp)
    column = (size / 2 + cloud["y"] * scale).astype(np.intp)
    inside = (row >= 0) & (row < size) & (column >= 0) & (column < size)
    picture = np.zeros((size, size, 3), np.uint8)
    shade = (70 + 185 * np.sqrt(np.clip(cloud["intensity"], 0, 1))).astype(np.uint8)
    picture[row[inside], column[inside]] = shade[inside, None]
    actor = inside & (cloud["object_id"] > 0)
    picture[row[actor], column[actor]] = (60, 200, 255)
    return picture
