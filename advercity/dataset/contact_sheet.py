"""One frame at a glance: a row per viewpoint with its cameras, semantics and LiDAR from above."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from advercity.dataset.damage import no_frames
from advercity.dataset.images import painted
from advercity.dataset.reader import Scenario
from advercity.dataset.view import View
from advercity.pictures import write_picture

CELL_WIDTH = 384
BAR = 22
"""Height of the strip that holds a row's name."""
LIDAR_REACH_M = 60.0

Image = NDArray[np.uint8]


def write_contact_sheet(path: Path, output: Path) -> None:
    """Write a PNG of the frame in the middle of a scenario.

    Args:
        path: Folder of one scenario.
        output: File to write.

    Raises:
        InputError: There is no frame in it, or the picture cannot be written.
    """
    scenario = Scenario(path)
    if not len(scenario):
        raise no_frames(path)
    frame = scenario[len(scenario) // 2]
    rows = [_row(view, f"{agent}  frame {frame.name}") for agent, view in frame.views.items()]
    write_picture(np.vstack(rows), output)


def _row(view: View, name: str) -> Image:
    pictures = [view.image(camera) for camera in (2, 0, 1, 3)]
    cells = [_cell(picture) for picture in (*pictures, painted(view.semantic(0)))]
    height = cells[0].shape[0]
    above = lidar_from_above(view.cloud, height)
    text = f"{name}: left, front, right, rear, semantic front, LiDAR"
    return np.vstack([_label(text, CELL_WIDTH * len(cells) + height), np.hstack([*cells, above])])


def _cell(image: Image) -> Image:
    height = round(CELL_WIDTH * image.shape[0] / image.shape[1])
    small = cv2.resize(image, (CELL_WIDTH, height), interpolation=cv2.INTER_AREA)
    return small[..., ::-1].astype(np.uint8)


def _label(text: str, width: int) -> Image:
    bar = np.full((BAR, width, 3), 32, np.uint8)
    cv2.putText(bar, text, (6, BAR - 7), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (235,) * 3, 1, cv2.LINE_AA)
    return bar


def lidar_from_above(cloud: NDArray[np.void], size: int) -> Image:
    """A cloud seen from above, its sensor in the middle, ahead upwards; BGR (size, size, 3)."""
    scale = size / (2 * LIDAR_REACH_M)
    row = (size / 2 - cloud["x"] * scale).astype(np.intp)
    column = (size / 2 - cloud["y"] * scale).astype(np.intp)
    inside = (row >= 0) & (row < size) & (column >= 0) & (column < size)
    picture = np.zeros((size, size, 3), np.uint8)
    shade = (70 + 185 * np.sqrt(np.clip(cloud["intensity"], 0, 1))).astype(np.uint8)
    picture[row[inside], column[inside]] = shade[inside, None]
    if "object_id" in (cloud.dtype.names or ()):
        actor = inside & (cloud["object_id"] > 0)
        picture[row[actor], column[actor]] = (60, 200, 255)
    return picture
