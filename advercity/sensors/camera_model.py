"""Where a camera shows a point: the pinhole, and the distortion by its lens.

Backends render pinholes only. For a camera with a lens they render a plane that is as wide as the
lens needs, with the same focal length in pixels; `camera/lens_map.py` takes the image from it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from advercity.geometry.arrays import Float64Array

if TYPE_CHECKING:
    from advercity_dsl import Camera
    from advercity_dsl.lens import CameraLens

TABLE_ANGLES = 4096
"""Angles at which a lens is tabulated; between them, straight lines err by 1e-7 of the radius."""
DECENTRING_ROUNDS = 20
"""Rounds in which the small shift by decentring is removed."""
EDGE_POINTS = 200
"""Points along each side of an image, whose edge is curved before the lens."""


@dataclass(frozen=True, eq=False)
class LensDistortion:
    """Maps the plane at unit depth to the image of a lens with unit focal length, and back.

    Beyond the image the plane is only shifted outwards: a polynomial would fold it back.

    Attributes:
        angles: (n,) rising angles off the axis, up to that of the image's corners.
        radii: (n,) their radii in the image, without decentring.
        decentring: Coefficients p1 and p2.
    """

    angles: Float64Array
    radii: Float64Array
    decentring: tuple[float, float]

    def distort(self, plane: Float64Array) -> Float64Array:
        """Map points (n, 2) of the plane, x right and y down, to the image."""
        tangent, last = np.hypot(*plane.T), math.tan(self.angles[-1])
        beyond = np.maximum(tangent - last, 0.0)
        radius = np.interp(np.arctan(tangent), self.angles, self.radii) + beyond
        held = plane * _divide(np.minimum(tangent, last), tangent)[:, None]
        return plane * _divide(radius, tangent)[:, None] + self._compute_decentring(held)

    def undistort(self, image: Float64Array) -> Float64Array:
        """Map points (n, 2) of the image to the plane."""
        plane, shift = image, np.zeros_like(image)
        for _ in range(DECENTRING_ROUNDS if any(self.decentring) else 1):
            centred = image - shift
            radius = np.hypot(*centred.T)
            tangent = np.tan(np.interp(radius, self.radii, self.angles))
            plane = centred * _divide(tangent, radius)[:, None]
            shift = self._compute_decentring(plane)
        return plane

    def _compute_decentring(self, plane: Float64Array) -> Float64Array:
        (p1, p2), (x, y) = self.decentring, plane.T
        square = x**2 + y**2
        right = 2 * p1 * x * y + p2 * (square + 2 * x**2)
        down = p1 * (square + 2 * y**2) + 2 * p2 * x * y
        return np.stack([right, down], axis=1)


def _divide(radius: Float64Array, other: Float64Array) -> Float64Array:
    """Divide radii (n,); on the axis, where both are 0, the ratio is 1."""
    return np.divide(radius, other, out=np.ones_like(radius), where=other > 0)


@lru_cache(maxsize=16)
def _tabulate(lens: CameraLens, edge_angle_rad: float) -> LensDistortion:
    angles = np.linspace(0.0, edge_angle_rad, TABLE_ANGLES)
    radii = np.array([lens.compute_radius(angle) for angle in angles.tolist()])
    return LensDistortion(angles, radii, lens.decentring)


@dataclass(frozen=True)
class CameraModel:
    """Projection of a camera to the pixels of its image; pixel k extends from k to k + 1.

    Attributes:
        width_px: Width of the image.
        height_px: Height of the image.
        focal_px: Focal length; the optical axis meets the middle of the image.
        distortion: Distortion by the lens; None of a pinhole.
    """

    width_px: int
    height_px: int
    focal_px: float
    distortion: LensDistortion | None = None

    @staticmethod
    def build(camera: Camera, width_px: int, height_px: int) -> CameraModel:
        """Build the model of a camera for an image of a size with its proportions."""
        lens = camera.lens
        if lens is None:
            return CameraModel.build_pinhole(camera.horizontal_fov_deg, width_px, height_px)
        half_rad = np.deg2rad(camera.horizontal_fov_deg) / 2
        focal_px = width_px / (2 * lens.compute_radius(float(half_rad)))
        key: Any = lens  # frozen, so hashable, which its type does not say
        distortion = _tabulate(key, camera.edge_angle_rad)
        return CameraModel(width_px, height_px, focal_px, distortion)

    @staticmethod
    def build_pinhole(horizontal_fov_deg: float, width_px: int, height_px: int) -> CameraModel:
        """Build the model of a pinhole by the angle that its width spans."""
        half_rad = np.deg2rad(horizontal_fov_deg) / 2
        return CameraModel(width_px, height_px, float(width_px / (2 * np.tan(half_rad))))

    @property
    def matrix(self) -> Float64Array:
        """Pinhole matrix (3, 3); optical axes x right, y down, z along the view."""
        focal, (column, row) = self.focal_px, self._middle
        return np.array([[focal, 0, column], [0, focal, row], [0, 0, 1]])

    def pixels_from_camera(self, points: Float64Array) -> Float64Array:
        """Project points (n, 3) in body axes to columns and rows (n, 2).

        Points in the camera's plane give inf or NaN, those behind it a mirrored place.
        """
        return self.distort(self.project_pinhole(points))

    def project_pinhole(self, points: Float64Array) -> Float64Array:
        """Project points (n, 3) in body axes as without a lens."""
        ahead, left, up = points.T
        column, row, depth = self.matrix @ np.stack([-left, -up, ahead])
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.stack([column / depth, row / depth], axis=1)

    def distort(self, pixels: Float64Array) -> Float64Array:
        """Map pixels (n, 2) of the pinhole to those of the image."""
        if self.distortion is None:
            return pixels
        plane = (pixels - self._middle) / self.focal_px
        return self.distortion.distort(plane) * self.focal_px + self._middle

    def undistort(self, pixels: Float64Array) -> Float64Array:
        """Map pixels (n, 2) of the image to those of the pinhole."""
        if self.distortion is None:
            return pixels
        image = (pixels - self._middle) / self.focal_px
        return self.distortion.undistort(image) * self.focal_px + self._middle

    def trace_edge(self) -> Float64Array:
        """Trace the edge of the image in pixels (k, 2) of the pinhole."""
        width, height = self.width_px, self.height_px
        corners = np.array([(0, 0), (width, 0), (width, height), (0, height), (0, 0)], float)
        steps = np.linspace(0, 1, EDGE_POINTS)[:, None]
        sides = [start + steps * (end - start) for start, end in pairwise(corners)]
        return self.undistort(np.concatenate(sides))

    @property
    def rendered_size(self) -> tuple[int, int]:
        """Width and height of the plane to render, around the same middle."""
        if self.distortion is None:
            return self.width_px, self.height_px
        reach_px = np.abs(self.trace_edge() - self._middle).max(axis=0)
        width, height = (2 * math.ceil(side + 1) for side in reach_px.tolist())
        return width, height

    @property
    def _middle(self) -> Float64Array:
        return np.array([self.width_px / 2, self.height_px / 2])
