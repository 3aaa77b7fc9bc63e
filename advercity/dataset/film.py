"""Pictures of a frame for people: cameras with boxes, semantics, and all LiDARs from above."""

from collections.abc import Iterator, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from advercity import poses
from advercity.dataset.boxes import Boxes
from advercity.dataset.images import painted
from advercity.dataset.reader import FrameView
from advercity.dataset.sightings import BOX_EDGES, NEAR_M, box_corners
from advercity.dataset.view import View
from advercity.semantics import ACTOR_COLOURS

REACH_M = 80.0
BAR_PX = 22
"""Height of the strip that holds a name."""
ABOVE_PX = 720
VIEW_COLOURS = ((80, 180, 255), (120, 230, 120), (255, 170, 80), (230, 120, 230), (240, 230, 110))
_OTHER_COLOUR = (200, 200, 200)
_GROUND = [0, 2, 6, 4, 0]

Image = NDArray[np.uint8]
"""RGB (h, w, 3)."""


def front(view: View) -> Image:
    """The front camera as it is."""
    return view.image(0)


def mosaic(frame: FrameView) -> Image:
    """The front cameras of all viewpoints with their boxes, and the LiDARs from above."""
    cells = [
        _named(with_boxes(view, 0), f"{agent}  {frame.name}") for agent, view in frame.views.items()
    ]
    return _grid([*cells, _fitted(from_above(frame), cells[0].shape)])


def semantic(frame: FrameView) -> Image:
    """The front cameras' semantic twins."""
    cells = [
        _named(painted(view.semantic(0)), f"{agent}  {frame.name}")
        for agent, view in frame.views.items()
    ]
    return _grid([*cells, np.zeros_like(cells[0])])


def with_boxes(view: View, camera: int) -> Image:
    """A camera's picture with the box of everybody whom its viewpoint annotates."""
    image = view.image(camera).copy()
    boxes = view.boxes
    for corners, kind in zip(_corners(boxes), boxes.classes.tolist(), strict=True):
        for start, end in _edges_ahead(view, camera, corners):
            colour = ACTOR_COLOURS.get(kind, _OTHER_COLOUR)
            cv2.line(image, _point(start), _point(end), colour, 1, cv2.LINE_AA)
    return image


def from_above(frame: FrameView, size: int = ABOVE_PX) -> Image:
    """All clouds and boxes around the first viewpoint, north up; a colour per viewpoint."""
    views = list(frame.views.values())
    middle = views[0].world_from_agent[:2, 3]
    picture = np.full((size, size, 3), 16, np.uint8)
    for view, colour in zip(views, VIEW_COLOURS, strict=False):
        points = poses.transform(view.world_from_lidar, view.points)
        pixels = _above(points[:, :2], middle, size)
        inside = ((pixels >= 0) & (pixels < size)).all(axis=1)
        picture[pixels[inside, 1], pixels[inside, 0]] = colour
    for view in views:
        boxes = view.boxes
        for corners, kind in zip(_corners(boxes), boxes.classes.tolist(), strict=True):
            outline = _above(corners[_GROUND, :2], middle, size)
            colour = ACTOR_COLOURS.get(kind, _OTHER_COLOUR)
            cv2.polylines(picture, [outline], False, colour, 1, cv2.LINE_AA)
    for view, (agent, colour) in zip(
        views, zip(frame.views, VIEW_COLOURS, strict=False), strict=False
    ):
        column, row = _above(view.world_from_agent[None, :2, 3], middle, size)[0]
        cv2.circle(picture, (int(column), int(row)), 5, colour, -1, cv2.LINE_AA)
        cv2.putText(
            picture, agent, (int(column) + 7, int(row) - 5), cv2.FONT_HERSHEY_SIMPLEX, 0.45, colour
        )
    return picture


def _corners(boxes: Boxes) -> list[NDArray[np.float64]]:
    """Corners (8, 3) of every box in the world."""
    return [
        poses.transform(pose, box_corners(size) - (0.0, 0.0, size[2] / 2))
        for pose, size in zip(boxes.world_from_box, boxes.sizes, strict=True)
    ]


def _edges_ahead(
    view: View, camera: int, corners: NDArray[np.float64]
) -> Iterator[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Ends, in pixels, of what of a box's edges lies ahead of a camera."""
    points = poses.transform(poses.inverse(view.world_from_camera(camera)), corners)
    matrix = view.intrinsic(camera)
    for first, second in BOX_EDGES:
        start, end = points[first], points[second]
        if start[0] < end[0]:
            start, end = end, start
        if start[0] <= NEAR_M:
            continue
        if end[0] < NEAR_M:
            end = start + (start[0] - NEAR_M) / (start[0] - end[0]) * (end - start)
        pixels = [matrix[:2] @ (-p[1] / p[0], -p[2] / p[0], 1.0) for p in (start, end)]
        yield pixels[0], pixels[1]


def _point(pixel: NDArray[np.float64]) -> tuple[int, int]:
    """Whole pixels, far ones clipped to what OpenCV can draw to."""
    column, row = np.clip(np.rint(pixel), -20_000, 20_000).astype(int)
    return int(column), int(row)


def _above(
    points: NDArray[np.float64], middle: NDArray[np.float64], size: int
) -> NDArray[np.int32]:
    """Column and row (n, 2) of places (n, 2) of the world."""
    offset = (points - middle) * (size / (2 * REACH_M))
    return np.rint(size / 2 + offset * (1.0, -1.0)).astype(np.int32)


def _fitted(image: Image, shape: Sequence[int]) -> Image:
    """A square picture in the middle of an empty one of that shape."""
    height, width = shape[:2]
    side = min(height, width)
    cell = np.full((height, width, 3), 16, np.uint8)
    left = (width - side) // 2
    cell[:side, left : left + side] = cv2.resize(image, (side, side), interpolation=cv2.INTER_AREA)
    return cell


def _named(image: Image, name: str) -> Image:
    named = image.copy()
    cv2.rectangle(named, (0, 0), (named.shape[1], BAR_PX), (32, 32, 32), -1)
    cv2.putText(
        named,
        name,
        (6, BAR_PX - 7),
        cv2.FONT_HERSHEY_SIMPLEX,
        0.45,
        (235, 235, 235),
        1,
        cv2.LINE_AA,
    )
    return named


def _grid(cells: Sequence[Image]) -> Image:
    """Three in a row."""
    rows = [np.hstack(cells[first : first + 3]) for first in range(0, len(cells), 3)]
    return np.vstack(rows)
