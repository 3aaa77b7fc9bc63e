"""Draws frames for people: images with boxes, semantics, LiDARs from above; as PNG or MP4."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack
from itertools import cycle
from pathlib import Path

import cv2
import numpy as np
from advercity_dsl.base import suggest_name
from numpy.typing import NDArray

from advercity.dataset.agent_view import AgentView
from advercity.dataset.boxes import Boxes
from advercity.dataset.image_codec import to_semantic_colours
from advercity.dataset.reader import FrameView, Scenario
from advercity.dataset.scenario_folders import find_scenarios_by_name, no_frames_error
from advercity.errors import InputError
from advercity.geometry import poses
from advercity.geometry.arrays import Float64Array, Uint8Array
from advercity.geometry.boxes import BOX_BASE, BOX_EDGES, Box
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
DIRECTIONS = (
    *("front", "front left", "left", "rear left"),
    *("rear", "rear right", "right", "front right"),
)
"""Names of directions, 45 degrees apart."""
CONTACT_LIDAR_HALF_EXTENT_M = 60.0
FULL_SNR_DB = 60.0
"""Signal-to-noise ratio of the brightest detections."""
_OTHER_COLOUR = (200, 200, 200)
_BACKGROUND = 16
_MAX_LINE_END_PX = 20_000
"""OpenCV draws nothing, or in the wrong place, to ends much farther off."""
_LINE_POINTS = 17
"""Points of a line bent by a lens."""


def draw_mosaic(frame: FrameView) -> Uint8Array:
    """Draw the front cameras of all agents with their boxes, and the LiDARs from above."""
    seeing = _select_with_cameras(frame)
    images = [draw_camera_boxes(view, find_front_camera(view)) for view in seeing.values()]
    above = draw_top_view(frame)
    shape = _find_largest_shape(images or [above])
    return _tile_images([*_label_agents(frame, seeing, images), _fit_image(above, shape)])


def draw_semantic_mosaic(frame: FrameView) -> Uint8Array:
    """Draw the semantic images of the front cameras of all agents."""
    seeing = _select_with_cameras(frame)
    images = [
        to_semantic_colours(view.semantic(find_front_camera(view))) for view in seeing.values()
    ]
    return _tile_images(_label_agents(frame, seeing, images))


def _select_with_cameras(frame: FrameView) -> dict[str, AgentView]:
    return {name: view for name, view in frame.views.items() if view.cameras}


def find_front_camera(view: AgentView) -> int:
    """Return the index of the camera looking ahead, or nearest to it."""
    return min(range(view.cameras), key=lambda camera: abs(_compute_camera_yaw_deg(view, camera)))


def _compute_camera_yaw_deg(view: AgentView, camera: int) -> float:
    """Compute where a camera looks, from -180 (rear), over right, front and left, to below 180."""
    return (view.agent.sensors.cameras[camera].mount.yaw_deg + 180) % 360 - 180


def _label_agents(
    frame: FrameView, agents: Iterable[str], images: Sequence[Uint8Array]
) -> list[Uint8Array]:
    """Label an image of every agent."""
    return [
        _label(image, f"{agent}  {frame.name}") for agent, image in zip(agents, images, strict=True)
    ]


def draw_camera_boxes(view: AgentView, camera: int) -> Uint8Array:
    """Draw the boxes of all annotated objects into a camera's image (h, w, 3)."""
    image = view.image(camera).copy()
    for corners, colour in _iter_boxes(view.boxes):
        for line in _project_edges(view, camera, corners):
            cv2.polylines(image, [_to_cv_points(line)], False, colour, 1, cv2.LINE_AA)
    return image


def draw_top_view(frame: FrameView, size: int = TOP_VIEW_SIZE_PX) -> Uint8Array:
    """Draw all clouds and boxes around the first agent, north up; each agent has a colour."""
    middle = next(iter(frame.views.values())).world_from_agent[:2, 3]
    coloured = list(zip(frame.views.items(), cycle(AGENT_VIEW_COLOURS), strict=False))
    image = np.full((size, size, 3), _BACKGROUND, np.uint8)
    for (_, view), colour in coloured:
        pixels = _to_top_view_pixels(_load_world_points(view)[:, :2], middle, size)
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


def _load_world_points(view: AgentView) -> Float64Array:
    """Load the points (n, 3) of all LiDARs of an agent, in the world."""
    clouds = [view.load_cloud(lidar) for lidar in range(view.lidars)]
    placed = (
        poses.transform_points(
            view.load_lidar_pose(lidar), np.column_stack([cloud[axis] for axis in "xyz"])
        )
        for lidar, cloud in enumerate(clouds)
    )
    return np.concatenate([np.empty((0, 3)), *placed])


def _iter_boxes(boxes: Boxes) -> Iterator[tuple[Float64Array, tuple[int, int, int]]]:
    """Iterate over the corners (8, 3) of every box in the world, and its colour."""
    rows = zip(boxes.world_from_box, boxes.sizes, boxes.classes.tolist(), strict=True)
    for pose, size, actor_class in rows:
        # The origin of a box's pose is its middle; `Box` has its origin in the middle of its base.
        corners = Box(size, (0.0, 0.0, 0.0)).corners
        colour = ACTOR_COLOURS.get(actor_class, _OTHER_COLOUR)
        yield poses.transform_points(pose, corners), colour


def _project_edges(view: AgentView, camera: int, corners: Float64Array) -> Iterator[Float64Array]:
    """Project the edges of a box to lines (k, 2) of pixels, cut off at a camera's near plane."""
    points = poses.transform_points(poses.invert_pose(view.world_from_camera(camera)), corners)
    model = view.camera_model(camera)
    # A lens bends straight edges.
    steps = np.linspace(0.0, 1.0, 2 if model.distortion is None else _LINE_POINTS)[:, None]
    for first, second in BOX_EDGES:
        start, end = points[first], points[second]
        if start[0] < end[0]:
            start, end = end, start
        if start[0] <= NEAR_PLANE_M:
            continue
        if end[0] < NEAR_PLANE_M:
            end = start + (start[0] - NEAR_PLANE_M) / (start[0] - end[0]) * (end - start)
        yield model.pixels_from_camera(start + steps * (end - start))


def _to_cv_points(pixels: Float64Array) -> NDArray[np.int32]:
    return np.clip(np.rint(pixels), -_MAX_LINE_END_PX, _MAX_LINE_END_PX).astype(np.int32)


def _to_top_view_pixels(points: Float64Array, middle: Float64Array, size: int) -> NDArray[np.int32]:
    """Convert positions (n, 2) in the world to columns and rows (n, 2)."""
    offset = (points - middle) * (size / (2 * TOP_VIEW_HALF_EXTENT_M))
    return np.rint(size / 2 + offset * (1.0, -1.0)).astype(np.int32)


def _find_largest_shape(images: Sequence[Uint8Array]) -> tuple[int, int]:
    return max(len(image) for image in images), max(image.shape[1] for image in images)


def _fit_image(image: Uint8Array, shape: tuple[int, int]) -> Uint8Array:
    """Scale an image into the middle of an empty one of a given height and width."""
    scale = min(shape[0] / image.shape[0], shape[1] / image.shape[1])
    height, width = (max(1, round(scale * side)) for side in image.shape[:2])
    top, left = (shape[0] - height) // 2, (shape[1] - width) // 2
    cell = np.full((*shape, 3), _BACKGROUND, np.uint8)
    cell[top : top + height, left : left + width] = cv2.resize(
        image, (width, height), interpolation=cv2.INTER_AREA
    )
    return cell


def _label(image: Uint8Array, text: str) -> Uint8Array:
    labelled = image.copy()
    labelled[:LABEL_HEIGHT_PX] = draw_label_bar(text, image.shape[1])[: len(image)]
    return labelled


def _tile_images(images: Sequence[Uint8Array]) -> Uint8Array:
    """Place images three in a row, each in a cell as large as the largest; fill the last row."""
    shape = _find_largest_shape(images)
    cells = [_fit_image(image, shape) for image in images]
    cells += [np.zeros_like(cells[0])] * (-len(cells) % 3)
    rows = [np.hstack(cells[first : first + 3]) for first in range(0, len(cells), 3)]
    return np.vstack(rows)


def write_contact_sheet(
    path: Path, output: Path, *, frame: str | None = None, agents: Sequence[str] | None = None
) -> None:
    """Write an image of a frame of a scenario, with a row per agent.

    A row has all cameras from the left over the front to the rear, the classes of the front one,
    and LiDARs and radars from above.

    Args:
        path: Folder of one scenario.
        output: File to write.
        frame: Name of the frame; by default the one in the middle.
        agents: Names of agents; by default all.

    Raises:
        InputError: The scenario has no frames, not this frame or not these agents, or the file
            cannot be written.
    """
    scenario = Scenario(path)
    if not len(scenario):
        raise no_frames_error(path)
    shown = scenario[len(scenario) // 2] if frame is None else _find_frame(scenario, frame, path)
    rows = [
        _draw_contact_row(shown.views[agent], f"{agent}  frame {shown.name}")
        for agent in _select_agents(shown, agents, path)
    ]
    width = max(row.shape[1] for row in rows)
    padded = [np.pad(row, ((0, 0), (0, width - row.shape[1]), (0, 0))) for row in rows]
    write_image(np.vstack(padded)[..., ::-1], output)


def _find_frame(scenario: Scenario, name: str, path: Path) -> FrameView:
    found = next((item for item in scenario if item.name == name), None)
    if found is None:
        first, last = scenario[0].name, scenario[len(scenario) - 1].name
        raise InputError(f"{path}: has no frame '{name}'; its frames are {first} to {last}")
    return found


def _select_agents(frame: FrameView, agents: Sequence[str] | None, path: Path) -> Sequence[str]:
    for name in agents or ():
        if name not in frame.views:
            raise InputError(f"{path}: has no agent '{name}'; {suggest_name(name, frame.views)}")
    return agents or list(frame.views)


def _draw_contact_row(view: AgentView, name: str) -> Uint8Array:
    images = list(map(view.image, _order_cameras(view)))
    if images:
        images.append(to_semantic_colours(view.semantic(find_front_camera(view))))
    height, width = images[0].shape[:2] if images else (1, 1)
    shape = round(CONTACT_CELL_WIDTH_PX * height / width), CONTACT_CELL_WIDTH_PX
    above = [draw_lidar_top_view(view.load_cloud(item), shape[0]) for item in range(view.lidars)]
    above += [draw_radar_top_view(view.load_radar(item), shape[0]) for item in range(view.radars)]
    cells = [*(_fit_image(image, shape) for image in images), *above]
    row = np.hstack(cells or [np.zeros((*shape, 3), np.uint8)])
    text = f"{name}: {', '.join(name_contact_cells(view))}"
    return np.vstack([draw_label_bar(text, row.shape[1]), row])


def _order_cameras(view: AgentView) -> list[int]:
    """Order cameras from the left over the front to the rear."""
    return sorted(range(view.cameras), key=lambda camera: -_compute_camera_yaw_deg(view, camera))


def name_contact_cells(view: AgentView) -> list[str]:
    """Name the cells of an agent's row: kind, if the rig names it, and direction."""
    sensors = view.agent.sensors
    cameras = [
        f"{sensors.cameras[camera].name} "
        f"{DIRECTIONS[round(_compute_camera_yaw_deg(view, camera) / 45) % 8]}".lstrip()
        for camera in _order_cameras(view)
    ]
    above = [
        f"{kind} {item.name}".rstrip()
        for kind, found in (("LiDAR", sensors.list_sensors("lidar")), ("radar", sensors.radars))
        for item in found
    ]
    return [*cameras, *(["semantic front"] if cameras else []), *above]


def draw_lidar_top_view(cloud: NDArray[np.void], size: int) -> Uint8Array:
    """Draw a cloud from above in RGB (size, size, 3): the sensor in the middle, ahead upwards."""
    # The square root lifts weak returns, which are most of them, out of the dark.
    return _draw_from_above(cloud, np.sqrt(np.clip(cloud["intensity"], 0, 1)), size)


def draw_radar_top_view(detections: NDArray[np.void], size: int) -> Uint8Array:
    """Draw detections from above in RGB (size, size, 3), as `draw_lidar_top_view`."""
    grown = np.repeat(detections, 9)
    # A detection is a square of three pixels, as there are few.
    step = 2 * CONTACT_LIDAR_HALF_EXTENT_M / size
    offsets = np.tile(np.indices((3, 3)).reshape(2, 9) - 1, len(detections)) * step
    grown["x"] += offsets[0]
    grown["y"] += offsets[1]
    return _draw_from_above(grown, np.clip(grown["snr"] / FULL_SNR_DB, 0, 1), size)


def _draw_from_above(
    cloud: NDArray[np.void], strength: NDArray[np.floating], size: int
) -> Uint8Array:
    """Draw points with strengths (n,) from 0 to 1; points of actors in their own colour."""
    scale = size / (2 * CONTACT_LIDAR_HALF_EXTENT_M)
    row = (size / 2 - cloud["x"] * scale).astype(np.intp)
    column = (size / 2 - cloud["y"] * scale).astype(np.intp)
    inside = (row >= 0) & (row < size) & (column >= 0) & (column < size)
    image = np.zeros((size, size, 3), np.uint8)
    shade = (70 + 185 * strength).astype(np.uint8)
    image[row[inside], column[inside]] = shade[inside, None]
    if "object_id" in (cloud.dtype.names or ()):
        actor = inside & (cloud["object_id"] > 0)
        image[row[actor], column[actor]] = (255, 200, 60)
    return image


def write_videos(dataset: Path, output: Path, kinds: Sequence[str] = VIDEO_KINDS) -> list[Path]:
    """Write videos of every scenario of a dataset, and return the files.

    `front` is one file per agent, the others are one per scenario.

    Raises:
        InputError: A kind does not exist, there is no dataset, or one with two scenarios of one
            name, or PyAV is not installed.
        RunError: A file cannot be written.
    """
    unknown = sorted(set(kinds) - set(VIDEO_KINDS))
    if unknown:
        raise InputError(f"`kind` {unknown[0]}: no such video; {', '.join(VIDEO_KINDS)}")
    written: list[Path] = []
    for scenario_name, folder in find_scenarios_by_name(dataset).items():
        scenario = Scenario(folder)
        if not len(scenario):
            raise no_frames_error(folder)
        drawings = dict(_select_drawings(scenario, kinds))
        paths = {name: output / f"{scenario_name}_{name}.mp4" for name in drawings}
        tick_s = scenario.spec.timing.tick_s
        # All videos of a scenario at once, so files of a frame come from the page cache.
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
            for agent in _select_with_cameras(scenario[0]):
                yield f"{agent}_front", lambda frame, agent=agent: _read_front_image(frame[agent])
        elif kind != "semantic" or _select_with_cameras(scenario[0]):
            yield kind, drawings[kind]


def _read_front_image(view: AgentView) -> Uint8Array:
    return view.image(find_front_camera(view))
