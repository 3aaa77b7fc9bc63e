"""Draws frames for people: images with boxes, semantics, LiDARs from above; as PNG or MP4."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from advercity.dataset.agent_view import AgentView, Boxes
from advercity.dataset.image_codec import to_semantic_colours
from advercity.dataset.reader import FrameView, Scenario
from advercity.dataset.scenario_folders import find_scenarios, no_frames_error
from advercity.errors import InputError
from advercity.geometry import poses
from advercity.geometry.arrays import Float64Array, Uint8Array
from advercity.geometry.boxes import BOX_BASE, BOX_EDGES, compute_box_corners
from advercity.media import LABEL_HEIGHT_PX, VideoWriter, draw_label_bar, write_image
from advercity.semantics import ACTOR_COLOURS
from advercity.sensors.annotation import NEAR_PLANE_M

FrameDrawing = Callable[[FrameView], Uint8Array]

VIDEO_KINDS = ("front", "mosaic", "semantic", "lidar")
TOP_VIEW_HALF_EXTENT_M = 80.0
TOP_VIEW_SIZE_PX = 720
AGENT_VIEW_COLOURS = (
    (80, 180, 255),
    (120, 230, 120),
    (255, 170, 80),
    (230, 120, 230),
    (240, 230, 110),
)
CONTACT_CELL_WIDTH_PX = 384
CONTACT_CAMERAS = (2, 0, 1, 3)
"""Order of cameras in a row: left, front, right, rear."""
CONTACT_LIDAR_HALF_EXTENT_M = 60.0
_OTHER_COLOUR = (200, 200, 200)
_BACKGROUND = 16
_MAX_LINE_END_PX = 20_000
"""OpenCV draws nothing, or in the wrong place, to ends that are much farther off."""


def draw_mosaic(frame: FrameView) -> Uint8Array:
    """Draw the front cameras of all agents with their boxes, and the LiDARs from above."""
    cells = [
        _label(draw_camera_boxes(view, 0), f"{agent}  {frame.name}")
        for agent, view in frame.views.items()
    ]
    return _tile_images([*cells, _fit_square(draw_top_view(frame), cells[0].shape)])


def draw_semantic_mosaic(frame: FrameView) -> Uint8Array:
    """Draw the semantic images of the front cameras of all agents."""
    return _tile_images(
        [
            _label(to_semantic_colours(view.semantic(0)), f"{agent}  {frame.name}")
            for agent, view in frame.views.items()
        ]
    )


def draw_camera_boxes(view: AgentView, camera: int) -> Uint8Array:
    """Draw the boxes of all annotated objects into a camera's image (h, w, 3)."""
    image = view.image(camera).copy()
    for corners, colour in _iter_boxes(view.boxes):
        for start, end in _project_edges(view, camera, corners):
            cv2.line(image, _to_cv_point(start), _to_cv_point(end), colour, 1, cv2.LINE_AA)
    return image


def draw_top_view(frame: FrameView, size: int = TOP_VIEW_SIZE_PX) -> Uint8Array:
    """Draw all clouds and boxes around the first agent, north up; each agent has a colour."""
    middle = next(iter(frame.views.values())).world_from_agent[:2, 3]
    coloured = list(zip(frame.views.items(), AGENT_VIEW_COLOURS, strict=False))
    image = np.full((size, size, 3), _BACKGROUND, np.uint8)
    for (_, view), colour in coloured:
        points = poses.transform_points(view.world_from_lidar, view.points)
        pixels = _to_top_view_pixels(points[:, :2], middle, size)
        inside = ((pixels >= 0) & (pixels < size)).all(axis=1)
        image[pixels[inside, 1], pixels[inside, 0]] = colour
    for view in frame.views.values():
        for corners, colour in _iter_boxes(view.boxes):
            outline = _to_top_view_pixels(corners[BOX_BASE, :2], middle, size)
            cv2.polylines(image, [outline], True, colour, 1, cv2.LINE_AA)
    for (agent, view), colour in coloured:
        column, row = _to_top_view_pixels(view.world_from_agent[None, :2, 3], middle, size)[0]
        cv2.circle(image, (int(column), int(row)), 5, colour, -1, cv2.LINE_AA)
        place = (int(column) + 7, int(row) - 5)
        cv2.putText(image, agent, place, cv2.FONT_HERSHEY_SIMPLEX, 0.45, colour)
    return image


def _iter_boxes(boxes: Boxes) -> Iterator[tuple[Float64Array, tuple[int, int, int]]]:
    """Iterate over the corners (8, 3) of every box in the world, and its colour."""
    rows = zip(boxes.world_from_box, boxes.sizes, boxes.classes.tolist(), strict=True)
    for pose, size, actor_class in rows:
        # The origin of a box's pose is its middle, that of its corners the middle of its base.
        corners = compute_box_corners(size) - (0.0, 0.0, size[2] / 2)
        colour = ACTOR_COLOURS.get(actor_class, _OTHER_COLOUR)
        yield poses.transform_points(pose, corners), colour


def _project_edges(
    view: AgentView, camera: int, corners: Float64Array
) -> Iterator[tuple[Float64Array, Float64Array]]:
    """Project the edges of a box to pixels, cut off at the near plane of a camera."""
    points = poses.transform_points(poses.invert_pose(view.world_from_camera(camera)), corners)
    matrix = view.intrinsic(camera)
    for first, second in BOX_EDGES:
        start, end = points[first], points[second]
        if start[0] < end[0]:
            start, end = end, start
        if start[0] <= NEAR_PLANE_M:
            continue
        if end[0] < NEAR_PLANE_M:
            end = start + (start[0] - NEAR_PLANE_M) / (start[0] - end[0]) * (end - start)
        pixels = [matrix[:2] @ (-p[1] / p[0], -p[2] / p[0], 1.0) for p in (start, end)]
        yield pixels[0], pixels[1]


def _to_cv_point(pixel: Float64Array) -> tuple[int, int]:
    column, row = np.clip(np.rint(pixel), -_MAX_LINE_END_PX, _MAX_LINE_END_PX).astype(int)
    return int(column), int(row)


def _to_top_view_pixels(points: Float64Array, middle: Float64Array, size: int) -> NDArray[np.int32]:
    """Convert positions (n, 2) in the world to columns and rows (n, 2)."""
    offset = (points - middle) * (size / (2 * TOP_VIEW_HALF_EXTENT_M))
    return np.rint(size / 2 + offset * (1.0, -1.0)).astype(np.int32)


def _fit_square(image: Uint8Array, shape: Sequence[int]) -> Uint8Array:
    """Scale a square image into the middle of an empty one of that shape."""
    height, width = shape[:2]
    side = min(height, width)
    cell = np.full((height, width, 3), _BACKGROUND, np.uint8)
    left = (width - side) // 2
    cell[:side, left : left + side] = cv2.resize(image, (side, side), interpolation=cv2.INTER_AREA)
    return cell


def _label(image: Uint8Array, text: str) -> Uint8Array:
    labelled = image.copy()
    labelled[:LABEL_HEIGHT_PX] = draw_label_bar(text, image.shape[1])[: len(image)]
    return labelled


def _tile_images(cells: Sequence[Uint8Array]) -> Uint8Array:
    """Place images of one shape three in a row, and fill the last row with black ones."""
    cells = [*cells, *[np.zeros_like(cells[0])] * (-len(cells) % 3)]
    rows = [np.hstack(cells[first : first + 3]) for first in range(0, len(cells), 3)]
    return np.vstack(rows)


def write_contact_sheet(path: Path, output: Path) -> None:
    """Write a PNG of the frame in the middle of a scenario, with a row of images per agent.

    Args:
        path: Folder of one scenario.
        output: File to write.

    Raises:
        InputError: The scenario has no frames, or the file cannot be written.
    """
    scenario = Scenario(path)
    if not len(scenario):
        raise no_frames_error(path)
    frame = scenario[len(scenario) // 2]
    rows = [
        _draw_contact_row(view, f"{agent}  frame {frame.name}")
        for agent, view in frame.views.items()
    ]
    write_image(np.vstack(rows)[..., ::-1], output)


def _draw_contact_row(view: AgentView, name: str) -> Uint8Array:
    images = [*map(view.image, CONTACT_CAMERAS), to_semantic_colours(view.semantic(0))]
    cells = [_scale_to_cell(image) for image in images]
    above = draw_lidar_top_view(view.cloud, cells[0].shape[0])
    row = np.hstack([*cells, above])
    text = f"{name}: left, front, right, rear, semantic front, LiDAR"
    return np.vstack([draw_label_bar(text, row.shape[1]), row])


def _scale_to_cell(image: Uint8Array) -> Uint8Array:
    height = round(CONTACT_CELL_WIDTH_PX * image.shape[0] / image.shape[1])
    size = (CONTACT_CELL_WIDTH_PX, height)
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA).astype(np.uint8)


def draw_lidar_top_view(cloud: NDArray[np.void], size: int) -> Uint8Array:
    """Draw a cloud from above in RGB (size, size, 3): the sensor in the middle, ahead upwards."""
    scale = size / (2 * CONTACT_LIDAR_HALF_EXTENT_M)
    row = (size / 2 - cloud["x"] * scale).astype(np.intp)
    column = (size / 2 - cloud["y"] * scale).astype(np.intp)
    inside = (row >= 0) & (row < size) & (column >= 0) & (column < size)
    image = np.zeros((size, size, 3), np.uint8)
    # The square root lifts weak returns, which are most of them, out of the dark.
    shade = (70 + 185 * np.sqrt(np.clip(cloud["intensity"], 0, 1))).astype(np.uint8)
    image[row[inside], column[inside]] = shade[inside, None]
    if "object_id" in (cloud.dtype.names or ()):
        actor = inside & (cloud["object_id"] > 0)
        image[row[actor], column[actor]] = (255, 200, 60)
    return image


def write_videos(dataset: Path, output: Path, kinds: Sequence[str] = VIDEO_KINDS) -> list[Path]:
    """Write videos of every scenario of a dataset, and return the files.

    `front` is one file per agent, the others are one per scenario.

    Raises:
        InputError: A kind does not exist, there is no dataset, or PyAV is not installed.
        RunError: A file cannot be written.
    """
    unknown = sorted(set(kinds) - set(VIDEO_KINDS))
    if unknown:
        raise InputError(f"`kind` {unknown[0]}: no such video; {', '.join(VIDEO_KINDS)}")
    written: list[Path] = []
    for folder in find_scenarios(dataset):
        scenario = Scenario(folder)
        if not len(scenario):
            raise no_frames_error(folder)
        drawings = dict(_select_drawings(scenario, kinds))
        paths = {name: output / f"{folder.name}_{name}.mp4" for name in drawings}
        tick_s = scenario.spec.timing.tick_s
        # All videos of a scenario at once, so that files of a frame come from the page cache.
        with ExitStack() as stack:
            videos = {
                name: stack.enter_context(VideoWriter(path, tick_s)) for name, path in paths.items()
            }
            for frame in scenario:
                for name, draw in drawings.items():
                    videos[name].append(draw(frame))
        written += paths.values()
    return written


def _select_drawings(
    scenario: Scenario, kinds: Sequence[str]
) -> Iterator[tuple[str, FrameDrawing]]:
    drawings: dict[str, FrameDrawing] = {
        "mosaic": draw_mosaic,
        "semantic": draw_semantic_mosaic,
        "lidar": draw_top_view,
    }
    for kind in kinds:
        if kind == "front":
            for agent in scenario.agents:
                yield f"{agent}_front", lambda frame, agent=agent: frame[agent].image(0)
        else:
            yield kind, drawings[kind]
