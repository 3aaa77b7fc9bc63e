"""One exposure of a camera: pose, lens, and the world around it while the shutter is open."""

import itertools
import math
from dataclasses import dataclass, replace

import numpy as np
from advercity_dsl import Camera

from advercity.frames import Frame
from advercity.geometry.arrays import Float64Array
from advercity.physics.lamp_beams import LightSource
from advercity.rendering.backend import CameraView
from advercity.rendering.cover import Cover
from advercity.sensors.camera.lens_map import LensMap

LENS_FOCAL_LENGTH_M = 0.004
"""Focal length of every lens; the width of the aperture follows with the f-number."""


@dataclass(frozen=True, eq=False)
class CameraExposure:
    """One image and the world around the camera while its shutter is open.

    Attributes:
        view: Pose and size of the rendered image.
        camera: Exposure settings and optics as authored.
        frame: Actors on the road.
        velocity: Velocity (3,) of the camera in the world, m/s.
        light_sources: Lamps in the scene; none by day, when daylight outshines them.
        lens_map: Map from the rendered image to the camera's; None for a pinhole.
        cover: Surfaces above the ground, with no drops or flakes below; None if there are none.
    """

    view: CameraView
    camera: Camera
    frame: Frame
    velocity: Float64Array
    light_sources: tuple[LightSource, ...] = ()
    lens_map: LensMap | None = None
    cover: Cover | None = None

    @property
    def focal_px(self) -> float:
        """Focal length in pixels."""
        return self.view.width_px / (2.0 * math.tan(self.view.horizontal_fov_rad / 2.0))

    @property
    def aperture_m(self) -> float:
        """Diameter of the entrance pupil."""
        return LENS_FOCAL_LENGTH_M / self.camera.exposure.f_number

    @property
    def position(self) -> Float64Array:
        """Position (3,) in the world."""
        return self.view.world_from_camera[:3, 3]

    def with_shutter(self, shutter_s: float) -> "CameraExposure":
        """Return the same exposure with another shutter time."""
        exposure = self.camera.exposure.model_copy(update={"shutter_s": shutter_s})
        return replace(self, camera=self.camera.model_copy(update={"exposure": exposure}))

    def to_camera_axes(self, directions: Float64Array) -> Float64Array:
        """Rotate world vectors (n, 3) to the camera's axes: x along the view, y left, z up."""
        return directions @ self.view.world_from_camera[:3, :3]

    def ray_grid(self, columns: int, rows: int) -> Float64Array:
        """Compute unit rays (rows, columns, 3) in the world through a grid over the whole image."""
        view = self.view
        right = (np.arange(columns) + 0.5) / columns * view.width_px - view.width_px / 2.0
        down = (np.arange(rows) + 0.5) / rows * view.height_px - view.height_px / 2.0
        rays, _ = pixel_rays(down, right, self.focal_px)
        return rays @ view.world_from_camera[:3, :3].T

    def project_points(self, points: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Project points (n, 3) before the camera, in its axes, to columns and rows (n,)."""
        view = self.view
        column = view.width_px / 2.0 - self.focal_px * points[:, 1] / points[:, 0]
        row = view.height_px / 2.0 - self.focal_px * points[:, 2] / points[:, 0]
        return column, row

    def frustum(self, near_m: float, far_m: float) -> tuple[Float64Array, Float64Array]:
        """Compute planes (6, 4) and corners (8, 3) of the visible volume between two depths.

        Both are in metres from the eye, in the world's axes; a point x is inside if n·x + d >= 0.
        """
        across = math.tan(self.view.horizontal_fov_rad / 2.0)
        down = across * self.view.height_px / self.view.width_px
        sides = np.array([[across, -1, 0], [across, 1, 0], [down, 0, -1], [down, 0, 1]])
        sides = sides / np.linalg.norm(sides, axis=1, keepdims=True)
        normals = np.concatenate([sides, [[1.0, 0, 0], [-1.0, 0, 0]]])
        offsets = np.array([0.0, 0.0, 0.0, 0.0, -near_m, far_m])
        signs = itertools.product((near_m, far_m), (-1, 1), (-1, 1))
        corners = np.array([[x, y * x * across, z * x * down] for x, y, z in signs])
        camera_from_world = self.view.world_from_camera[:3, :3].T
        return np.column_stack([normals @ camera_from_world, offsets]), corners @ camera_from_world


def pixel_rays(
    down_px: Float64Array, right_px: Float64Array, focal_px: float
) -> tuple[Float64Array, Float64Array]:
    """Compute unit rays (r, c, 3) in the camera's axes, and their lengths (r, c) in pixels.

    Rays pass through offsets (r,) down and (c,) to the right from the image's centre.
    """
    down, right = np.meshgrid(down_px, right_px, indexing="ij")
    rays = np.stack([np.full_like(down, focal_px), -right, -down], axis=-1)
    length = np.linalg.norm(rays, axis=-1)
    return rays / length[..., None], length
