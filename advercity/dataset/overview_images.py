"""Pictures of a frame for people: cameras with boxes, semantics, and all LiDARs from above.

One frame at a glance: a row per viewpoint with its cameras, semantics and LiDAR from above.

Films of a scenario, as MP4 by PyAV.
"""

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
from advercity.geometry.arrays import Uint8Array
from advercity.geometry.boxes import BOX_EDGES, compute_box_corners
from advercity.media import VideoWriter, write_image
from advercity.semantics import ACTOR_COLOURS
from advercity.sensors.annotation import NEAR_PLANE_M

TOP_VIEW_HALF_EXTENT_M = 80.0
LABEL_BAR_PX = 22
"""Height of the strip that holds a name."""
TOP_VIEW_SIZE_PX = 720
AGENT_VIEW_COLOURS = (
    (80, 180, 255),
    (120, 230, 120),
    (255, 170, 80),
    (230, 120, 230),
    (240, 230, 110),
)
_OTHER_COLOUR = (200, 200, 200)
_BASE_OUTLINE = [0, 2, 6, 4, 0]


def draw_front_camera(view: AgentView) -> Uint8Array:
    """The front camera as it is."""
    return view.image(0)


def draw_mosaic(frame: FrameView) -> Uint8Array:
    """The front cameras of all viewpoints with their boxes, and the LiDARs from above."""
    cells = [
        _draw_name_bar(draw_camera_boxes(view, 0), f"{agent}  {frame.name}")
        for agent, view in frame.views.items()
    ]
    return _tile_images([*cells, _fit_square(draw_top_view(frame), cells[0].shape)])


def draw_semantic_mosaic(frame: FrameView) -> Uint8Array:
    """The front cameras' semantic twins."""
    cells = [
        _draw_name_bar(to_semantic_colours(view.semantic(0)), f"{agent}  {frame.name}")
        for agent, view in frame.views.items()
    ]
    return _tile_images([*cells, np.zeros_like(cells[0])])


def draw_camera_boxes(view: AgentView, camera: int) -> Uint8Array:
    """A camera's picture with the box of everybody whom its viewpoint annotates."""
    image = view.image(camera).copy()
    boxes = view.boxes
    for corners, kind in zip(_compute_world_corners(boxes), boxes.classes.tolist(), strict=True):
        for start, end in _project_edges(view, camera, corners):
            colour = ACTOR_COLOURS.get(kind, _OTHER_COLOUR)
            cv2.line(image, _to_cv_point(start), _to_cv_point(end), colour, 1, cv2.LINE_AA)
    return image


def draw_top_view(frame: FrameView, size: int = TOP_VIEW_SIZE_PX) -> Uint8Array:
    """All clouds and boxes around the first viewpoint, north up; a colour per viewpoint."""
    views = list(frame.views.values())
    middle = views[0].world_from_agent[:2, 3]
    picture = np.full((size, size, 3), 16, np.uint8)
    for view, colour in zip(views, AGENT_VIEW_COLOURS, strict=False):
        points = poses.transform_points(view.world_from_lidar, view.points)
        pixels = _to_top_view_pixels(points[:, :2], middle, size)
        inside = ((pixels >= 0) & (pixels < size)).all(axis=1)
        picture[pixels[inside, 1], pixels[inside, 0]] = colour
    for view in views:
        boxes = view.boxes
        for corners, kind in zip(
            _compute_world_corners(boxes), boxes.classes.tolist(), strict=True
        ):
            outline = _to_top_view_pixels(corners[_BASE_OUTLINE, :2], middle, size)
            colour = ACTOR_COLOURS.get(kind, _OTHER_COLOUR)
            cv2.polylines(picture, [outline], False, colour, 1, cv2.LINE_AA)
    for view, (agent, colour) in zip(
        views, zip(frame.views, AGENT_VIEW_COLOURS, strict=False), strict=False
    ):
        column, row = _to_top_view_pixels(view.world_from_agent[None, :2, 3], middle, size)[0]
        cv2.circle(picture, (int(column), int(row)), 5, colour, -1, cv2.LINE_AA)
        cv2.putText(
            picture, agent, (int(column) + 7, int(row) - 5), cv2.FONT_HERSHEY_SIMPLEX, 0.45, colour
        )
    return picture


def _compute_world_corners(boxes: Boxes) -> list[NDArray[np.float64]]:
    """Corners (8, 3) of every box in the world."""
    return [
        poses.transform_points(pose, compute_box_corners(size) - (0.0, 0.0, size[2] / 2))
        for pose, size in zip(boxes.world_from_box, boxes.sizes, strict=True)
    ]


def _project_edges(
    view: AgentView, camera: int, corners: NDArray[np.float64]
) -> Iterator[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Ends, in pixels, of what of a box's edges lies ahead of a camera."""
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


def _to_cv_point(pixel: NDArray[np.float64]) -> tuple[int, int]:
    """Whole pixels, far ones clipped to what OpenCV can draw to."""
    column, row = np.clip(np.rint(pixel), -20_000, 20_000).astype(int)
    return int(column), int(row)


def _to_top_view_pixels(
    points: NDArray[np.float64], middle: NDArray[np.float64], size: int
) -> NDArray[np.int32]:
    """Column and row (n, 2) of places (n, 2) of the world."""
    offset = (points - middle) * (size / (2 * TOP_VIEW_HALF_EXTENT_M))
    return np.rint(size / 2 + offset * (1.0, -1.0)).astype(np.int32)


def _fit_square(image: Uint8Array, shape: Sequence[int]) -> Uint8Array:
    """A square picture in the middle of an empty one of that shape."""
    height, width = shape[:2]
    side = min(height, width)
    cell = np.full((height, width, 3), 16, np.uint8)
    left = (width - side) // 2
    cell[:side, left : left + side] = cv2.resize(image, (side, side), interpolation=cv2.INTER_AREA)
    return cell


def _draw_name_bar(image: Uint8Array, name: str) -> Uint8Array:
    named = image.copy()
    cv2.rectangle(named, (0, 0), (named.shape[1], LABEL_BAR_PX), (32, 32, 32), -1)
    cv2.putText(
        named,
        name,
        (6, LABEL_BAR_PX - 7),
        cv2.FONT_HERSHEY_SIMPLEX,
        0.45,
        (235, 235, 235),
        1,
        cv2.LINE_AA,
    )
    return named


def _tile_images(cells: Sequence[Uint8Array]) -> Uint8Array:
    """Three in a row."""
    rows = [np.hstack(cells[first : first + 3]) for first in range(0, len(cells), 3)]
    return np.vstack(rows)


CONTACT_CELL_WIDTH_PX = 384
CONTACT_BAR_PX = 22
"""Height of the strip that holds a row's name."""
CONTACT_LIDAR_HALF_EXTENT_M = 60.0


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
        raise no_frames_error(path)
    frame = scenario[len(scenario) // 2]
    rows = [
        _draw_contact_row(view, f"{agent}  frame {frame.name}")
        for agent, view in frame.views.items()
    ]
    write_image(np.vstack(rows), output)


def _draw_contact_row(view: AgentView, name: str) -> Uint8Array:
    pictures = [view.image(camera) for camera in (2, 0, 1, 3)]
    cells = [
        _scale_to_cell(picture) for picture in (*pictures, to_semantic_colours(view.semantic(0)))
    ]
    height = cells[0].shape[0]
    above = draw_lidar_top_view(view.cloud, height)
    text = f"{name}: left, front, right, rear, semantic front, LiDAR"
    return np.vstack(
        [
            _draw_contact_bar(text, CONTACT_CELL_WIDTH_PX * len(cells) + height),
            np.hstack([*cells, above]),
        ]
    )


def _scale_to_cell(image: Uint8Array) -> Uint8Array:
    height = round(CONTACT_CELL_WIDTH_PX * image.shape[0] / image.shape[1])
    small = cv2.resize(image, (CONTACT_CELL_WIDTH_PX, height), interpolation=cv2.INTER_AREA)
    return small[..., ::-1].astype(np.uint8)


def _draw_contact_bar(text: str, width: int) -> Uint8Array:
    bar = np.full((CONTACT_BAR_PX, width, 3), 32, np.uint8)
    cv2.putText(
        bar,
        text,
        (6, CONTACT_BAR_PX - 7),
        cv2.FONT_HERSHEY_SIMPLEX,
        0.45,
        (235,) * 3,
        1,
        cv2.LINE_AA,
    )
    return bar


def draw_lidar_top_view(cloud: NDArray[np.void], size: int) -> Uint8Array:
    """A cloud seen from above, its sensor in the middle, ahead upwards; BGR (size, size, 3)."""
    scale = size / (2 * CONTACT_LIDAR_HALF_EXTENT_M)
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


VIDEO_KINDS = ("front", "mosaic", "semantic", "lidar")

FrameDrawing = Callable[[FrameView], NDArray[np.uint8]]


def write_videos(dataset: Path, output: Path, kinds: Sequence[str] = VIDEO_KINDS) -> list[Path]:
    """Film every scenario of a dataset; the files.

    `front` is one file per viewpoint, the others one per scenario.

    Raises:
        InputError: No such kind, no such dataset, or PyAV is not installed.
        RunError: A file cannot be written.
    """
    unknown = sorted(set(kinds) - set(VIDEO_KINDS))
    if unknown:
        raise InputError(f"--kind {unknown[0]}: no such film; {', '.join(VIDEO_KINDS)}")
    written: list[Path] = []
    for folder in find_scenarios(dataset):
        scenario = Scenario(folder)
        if not len(scenario):
            raise no_frames_error(folder)
        films = dict(_select_drawings(scenario, kinds))
        paths = {name: output / f"{folder.name}_{name}.mp4" for name in films}
        with ExitStack() as stack:
            tick_s = scenario.spec.timing.tick_s
            reels = {
                name: stack.enter_context(VideoWriter(path, tick_s)) for name, path in paths.items()
            }
            for frame in scenario:
                for name, draw in films.items():
                    reels[name].append(draw(frame))
        written += paths.values()
    return written


def _select_drawings(
    scenario: Scenario, kinds: Sequence[str]
) -> Iterator[tuple[str, FrameDrawing]]:
    whole: dict[str, FrameDrawing] = {
        "mosaic": draw_mosaic,
        "semantic": draw_semantic_mosaic,
        "lidar": draw_top_view,
    }
    for kind in kinds:
        if kind == "front":
            for agent in scenario.agents:
                yield f"{agent}_front", lambda frame, agent=agent: draw_front_camera(frame[agent])
        else:
            yield kind, whole[kind]
