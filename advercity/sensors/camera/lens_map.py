"""Takes the image of a camera with a lens or intrinsics from a rendered pinhole plane."""

import itertools
from dataclasses import dataclass, replace
from functools import lru_cache

import cv2
import numpy as np

from advercity.geometry.arrays import Float32Array, IndexArray
from advercity.rendering.backend import CAPTURE_ARRAYS, CameraCapture
from advercity.sensors.camera_model import CameraModel

MAX_SAMPLES_PER_SIDE = 4
"""Where a lens squeezes the plane, a pixel is the mean of up to the square of these samples."""


@dataclass(frozen=True, eq=False)
class LensMap:
    """Takes the image of a camera from the rendered plane.

    Attributes:
        corners: (h + 1, w + 1, 2) columns and rows in the plane of the corners of all pixels.
    """

    corners: Float32Array

    def average(self, plane: Float32Array) -> Float32Array:
        """Average the light (rows, columns, 3) of the plane over each pixel of the image."""
        sides = [np.diff(self.corners, axis=axis) for axis in (0, 1)]
        widest = max(float(np.hypot(side[..., 0], side[..., 1]).max()) for side in sides)
        count = min(max(1, round(widest)), MAX_SAMPLES_PER_SIDE)
        offsets = ((np.arange(count) + 0.5) / count).tolist()
        total = np.zeros((*self.corners[1:, 1:].shape[:2], 3), np.float32)
        for down, right in itertools.product(offsets, offsets):
            # OpenCV counts coordinates from pixel centres.
            column, row = cv2.split(self._place_samples(down, right) - 0.5)
            total += cv2.remap(plane, column, row, cv2.INTER_LINEAR)
        return (total / count**2).astype(np.float32)

    def select(self, capture: CameraCapture) -> CameraCapture:
        """Select the nearest pixel of a capture for each pixel of the image."""
        column, row = np.moveaxis(self.find_nearest(capture.depth.shape), -1, 0)
        return replace(
            capture, **{name: getattr(capture, name)[row, column] for name in CAPTURE_ARRAYS}
        )

    def find_nearest(self, plane_shape: tuple[int, ...]) -> IndexArray:
        """Find column and row (h, w, 2) of the nearest pixel of the plane for each pixel."""
        height, width = plane_shape
        nearest = self._place_samples(0.5, 0.5).astype(np.intp)
        return np.clip(nearest, 0, np.array([width, height]) - 1)

    def _place_samples(self, down: float, right: float) -> Float32Array:
        """Find columns and rows (h, w, 2) of places in all pixels, from 0 to 1 down and right."""
        rows = self.corners[:-1] * (1 - down) + self.corners[1:] * down
        return (rows[:, :-1] * (1 - right) + rows[:, 1:] * right).astype(np.float32)


@lru_cache(maxsize=8)
def build_lens_map(camera: CameraModel) -> LensMap | None:
    """Build the map of a camera; None where the rendered plane is the image itself."""
    if camera.is_rendered:
        return None
    image = camera.width_px, camera.height_px
    grid = np.stack(np.meshgrid(*(np.arange(side + 1.0) for side in image)), axis=-1)
    corners = camera.to_rendered(camera.undistort(grid.reshape(-1, 2)))
    return LensMap(corners.reshape(grid.shape).astype(np.float32))
