"""The sun's disc, which is too bright and too small for a cubemap."""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from advercity.rendering.backend import CameraCapture, CameraView
from advercity.weather.atmosphere import Atmosphere

Array = NDArray[np.float64]

RADIUS_RAD = math.radians(0.533 / 2.0)
"""Half the sun's angular diameter."""

MARGIN = 0.1
"""How far outside the picture, in focal lengths, the disc may stand and still reach into it."""


def with_sun(capture: CameraCapture, view: CameraView, atmosphere: Atmosphere) -> CameraCapture:
    """The capture with the sun's disc where the picture shows open sky.

    Spread over its pixels the disc gives exactly the sun's illuminance, however coarse they are.
    """
    sun = view.world_from_camera[:3, :3].T @ atmosphere.sun_direction
    if atmosphere.sun_lx <= 0.0 or sun[0] <= math.sin(RADIUS_RAD):
        return capture
    height, width = capture.depth.shape
    focal_px = width / (2.0 * math.tan(view.horizontal_fov_rad / 2.0))
    corner_px = math.hypot(width, height) / 2.0
    if focal_px * math.hypot(sun[1], sun[2]) > (corner_px + MARGIN * focal_px) * sun[0]:
        return capture
    column = width / 2.0 - focal_px * sun[1] / sun[0]
    row = height / 2.0 - focal_px * sun[2] / sun[0]
    reach = math.ceil(focal_px * RADIUS_RAD / sun[0] ** 2) + 2
    rows = np.arange(math.floor(row) - reach, math.floor(row) + reach + 1)
    columns = np.arange(math.floor(column) - reach, math.floor(column) + reach + 1)

    rays, solid_angle = _pixels(rows + 0.5 - height / 2.0, columns + 0.5 - width / 2.0, focal_px)
    off_centre = np.linalg.norm(np.cross(rays, sun), axis=-1)
    coverage = np.clip(0.5 + (RADIUS_RAD - off_centre) / np.sqrt(solid_angle), 0.0, 1.0)
    if not coverage.any():  # between four pixels that are much larger than the disc
        coverage.flat[off_centre.argmin()] = 1.0
    luminance = atmosphere.sun_lx * coverage / np.sum(coverage * solid_angle)
    disc = luminance[..., None] * np.asarray(atmosphere.sun_colour)

    seen_rows = np.flatnonzero((rows >= 0) & (rows < height))
    seen_columns = np.flatnonzero((columns >= 0) & (columns < width))
    place = np.ix_(rows[seen_rows], columns[seen_columns])
    sky = np.isinf(capture.depth[place])[..., None]
    radiance = capture.radiance.copy()
    radiance[place] += (disc[np.ix_(seen_rows, seen_columns)] * sky).astype(np.float32)
    return replace(capture, radiance=radiance)


def _pixels(down: Array, right: Array, focal_px: float) -> tuple[Array, Array]:
    """Unit rays (r, c, 3) in the camera's frame and solid angles (r, c) of pixels."""
    grid_down, grid_right = np.meshgrid(down, right, indexing="ij")
    rays = np.stack([np.full_like(grid_down, focal_px), -grid_right, -grid_down], axis=-1)
    distance = np.linalg.norm(rays, axis=-1)
    return rays / distance[..., None], focal_px / distance**3
