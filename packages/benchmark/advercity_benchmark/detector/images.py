"""The images of a station, and where each cell of its map is in them."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from advercity.dataset.agent_view import AgentView
from advercity.dataset.reader import FrameView
from advercity.errors import InputError
from advercity.geometry import poses
from advercity.geometry.arrays import Float32Array
from advercity.geometry.poses import Matrix
from advercity_benchmark.detector.boxes import Area, compute_cell_centres
from advercity_benchmark.detector.clouds import StationCloud

CAMERA_AREA: Area = (60.0, 40.0)
"""Around each station. Farther away, a car is a few pixels of a small image."""
HEIGHTS_M = (0.2, 1.0, 2.0)
"""Over the ground, where images are sampled for a cell."""
IMAGE_PX = (384, 216)
"""Width and height of the reduced images."""
SMALLEST_PX = 48
"""Least side of an image. Rigs without a use for images have one of 16 pixels."""
NEAREST_M = 0.5
OUTSIDE = 2.0
"""Place of a cell in an image without it."""


@dataclass(frozen=True, eq=False)
class StationImages:
    """The images of a station's k cameras.

    Attributes:
        colours: (k, 3, h, w) from 0 to 255.
        places: (k, heights, nx, ny, 2) of each cell in each image, whose borders are at -1 and 1.
    """

    colours: NDArray[np.uint8]
    places: Float32Array


def check_cameras(frames: Sequence[FrameView]) -> None:
    """Raise an InputError with the reason if images of frames cannot be used."""
    hint = "generate it with a rig of cameras, as lidar_camera, and a rendering backend"
    for frame in {frame.scenario.path: frame for frame in frames}.values():
        for view in frame.views.values():
            found = f"{frame.scenario.path}: {view.agent.id}"
            if not view.cameras:
                raise InputError(f"{found} has no camera; {hint}")
            image = view.image(0)
            height_px, width_px = image.shape[:2]
            if min(height_px, width_px) < SMALLEST_PX:
                size = f"{width_px}x{height_px} pixels, too few to see anything in"
                raise InputError(f"{found} has images of {size}; {hint}")
            if image.min() == image.max():
                raise InputError(f"{found} has images of one colour; {hint}")


def load_images(cloud: StationCloud, map_from_station: Matrix) -> StationImages:
    """Load the images of a station for a map of `CAMERA_AREA`.

    Args:
        cloud: Its cloud, which says where the ground is.
        map_from_station: (4, 4) from its LiDAR frame with z over the ground; if it mirrors, so are
            the images.
    """
    view = cloud.view
    world_from_station = view.world_from_lidar @ poses.pose_matrix((0.0, 0.0, cloud.ground_m))
    points = _place_cells() @ np.linalg.inv(map_from_station).T @ world_from_station.T
    is_mirrored = bool(np.linalg.det(map_from_station[:3, :3]) < 0)
    colours = [_load_colours(view, camera) for camera in range(view.cameras)]
    places = [_locate_cells(view, camera, points[..., :3]) for camera in range(view.cameras)]
    if is_mirrored:
        colours = [image[:, ::-1] for image in colours]
        for place in places:
            place[..., 0] *= -1.0
    stacked = np.ascontiguousarray(np.moveaxis(np.stack(colours), -1, 1))
    return StationImages(stacked, np.stack(places))


def _place_cells() -> NDArray[np.float64]:
    """Place the cells of a map at each height: (heights, nx, ny, 4), homogeneous."""
    centres = compute_cell_centres(CAMERA_AREA)
    cells = np.ones((len(HEIGHTS_M), *centres.shape[:2], 4))
    cells[..., :2] = centres
    cells[..., 2] = np.reshape(HEIGHTS_M, (-1, 1, 1))
    return cells


def _load_colours(view: AgentView, camera: int) -> NDArray[np.uint8]:
    """Load an image (h, w, 3) in the size of the network's input."""
    image = view.image(camera)
    return np.asarray(cv2.resize(image, IMAGE_PX, interpolation=cv2.INTER_AREA), np.uint8)


def _locate_cells(view: AgentView, camera: int, points: NDArray[np.float64]) -> Float32Array:
    """Locate points (..., 3) of the world in an image: (..., 2) from -1 to 1."""
    model = view.camera_model(camera)
    size_px = np.array([model.width_px, model.height_px])
    with np.errstate(divide="ignore", invalid="ignore"):
        pixels = view.pixels(camera, points.reshape(-1, 3))
        found = 2.0 * pixels[:, :2] / size_px - 1.0
        is_shown = (pixels[:, 2] > NEAREST_M) & (np.abs(found) < 1.0).all(axis=1)
    found[~is_shown] = OUTSIDE
    return found.reshape(*points.shape[:-1], 2).astype(np.float32)
