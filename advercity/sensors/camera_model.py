"""Projection of points to a camera's image: the pinhole, and the distortion by its lens.

Backends render pinholes with square pixels and the principal point in the middle. For a camera
with a lens, or with a principal point elsewhere, they render a plane as wide as the image needs;
`camera/lens_map.py` takes the image from it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from advercity.geometry.arrays import Float64Array

if TYPE_CHECKING:
    from advercity_dsl import Camera
    from advercity_dsl.lens import CameraLens

TABLE_ANGLES = 4096
"""Angles at which a lens is tabulated; between them, straight lines err by 1e-7 of the radius."""
DECENTRING_ROUNDS = 20
"""Rounds of the iteration against the small shift by decentring."""
EDGE_POINTS = 200
"""Points along each side of an image, whose edge is curved before the lens."""


@dataclass(frozen=True, eq=False)
class LensDistortion:
    """Maps the plane at unit depth to the image of a lens with unit focal length, and back.

    Beyond the image the plane is only shifted outwards: a polynomial would fold it back.

    Attributes:
        angles: (n,) rising angles off the axis, up to the angle of the image's corners.
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
        focal_px: Focal length in widths of a pixel.
        distortion: Distortion by the lens; None for a pinhole.
        pixel_aspect: Width of a pixel over its height.
        offset_px: Place of the principal point right of and below the middle of the image.
    """

    width_px: int
    height_px: int
    focal_px: float
    distortion: LensDistortion | None = None
    pixel_aspect: float = 1.0
    offset_px: tuple[float, float] = (0.0, 0.0)

    @staticmethod
    def build(camera: Camera, width_px: int, height_px: int) -> CameraModel:
        """Build the model of a camera for an image of another size, with its proportions."""
        lens = camera.lens
        distortion = None
        if lens is not None:
            key: Any = lens  # frozen, so hashable, which its type does not say
            distortion = _tabulate(key, camera.edge_angle_rad)
        if camera.intrinsics is not None:
            return _build_calibrated(camera, width_px, height_px, distortion)
        if lens is None:
            return CameraModel.build_pinhole(camera.horizontal_fov_deg, width_px, height_px)
        half_rad = np.deg2rad(camera.horizontal_fov_deg) / 2
        focal_px = width_px / (2 * lens.compute_radius(float(half_rad)))
        return CameraModel(width_px, height_px, focal_px, distortion)

    @staticmethod
    def build_pinhole(horizontal_fov_deg: float, width_px: int, height_px: int) -> CameraModel:
        """Build the model of a pinhole by its horizontal field of view."""
        half_rad = np.deg2rad(horizontal_fov_deg) / 2
        return CameraModel(width_px, height_px, float(width_px / (2 * np.tan(half_rad))))

    @property
    def focal_lengths_px(self) -> Float64Array:
        """Focal lengths (2,) in widths and in heights of a pixel."""
        return np.array([self.focal_px, self.focal_px * self.pixel_aspect])

    @property
    def principal_point(self) -> Float64Array:
        """Column and row (2,) of the principal point."""
        return np.array([self.width_px / 2, self.height_px / 2]) + self.offset_px

    @property
    def matrix(self) -> Float64Array:
        """Pinhole matrix (3, 3); optical axes x right, y down, z along the view."""
        (across, down), (column, row) = self.focal_lengths_px, self.principal_point
        return np.array([[across, 0, column], [0, down, row], [0, 0, 1]])

    def pixels_from_camera(self, points: Float64Array) -> Float64Array:
        """Project points (n, 3) in body axes to columns and rows (n, 2).

        Points in the camera's plane give inf or NaN, points behind it a mirrored place.
        """
        return self.distort(self.project_pinhole(points))

    def project_pinhole(self, points: Float64Array) -> Float64Array:
        """Project points (n, 3) in body axes as without a lens."""
        ahead, left, up = points.T
        column, row, depth = self.matrix @ np.stack([-left, -up, ahead])
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.stack([column / depth, row / depth], axis=1)

    def distort(self, pixels: Float64Array) -> Float64Array:
        """Map pixels (n, 2) of the pinhole to the image."""
        if self.distortion is None:
            return pixels
        plane = self.distortion.distort(self.plane_from_pixels(pixels))
        return plane * self.focal_lengths_px + self.principal_point

    def undistort(self, pixels: Float64Array) -> Float64Array:
        """Map pixels (n, 2) of the image to the pinhole."""
        if self.distortion is None:
            return pixels
        plane = self.distortion.undistort(self.plane_from_pixels(pixels))
        return plane * self.focal_lengths_px + self.principal_point

    def plane_from_pixels(self, pixels: Float64Array) -> Float64Array:
        """Map pixels (n, 2) of the pinhole to the plane at unit depth, x right and y down."""
        return (pixels - self.principal_point) / self.focal_lengths_px

    def trace_edge(self) -> Float64Array:
        """Trace the edge of the image in pixels (k, 2) of the pinhole."""
        width, height = self.width_px, self.height_px
        corners = np.array([(0, 0), (width, 0), (width, height), (0, height), (0, 0)], float)
        steps = np.linspace(0, 1, EDGE_POINTS)[:, None]
        sides = [start + steps * (end - start) for start, end in pairwise(corners)]
        return self.undistort(np.concatenate(sides))

    @property
    def is_rendered(self) -> bool:
        """Whether the rendered plane is the image itself."""
        is_centred = self.offset_px == (0.0, 0.0) and self.pixel_aspect == 1.0
        return self.distortion is None and is_centred

    @property
    def rendered_focal_px(self) -> float:
        """Focal length of the plane to render, in its pixels."""
        return float(self.focal_lengths_px.max())

    @property
    def rendered_size(self) -> tuple[int, int]:
        """Width and height of the plane to render, around the principal point."""
        if self.is_rendered:
            return self.width_px, self.height_px
        reach = np.abs(self.plane_from_pixels(self.trace_edge())).max(axis=0)
        width, height = (
            2 * math.ceil(side + 1) for side in (reach * self.rendered_focal_px).tolist()
        )
        return width, height

    def to_rendered(self, pixels: Float64Array) -> Float64Array:
        """Map pixels (n, 2) of the pinhole to the rendered plane."""
        middle = np.array(self.rendered_size) / 2
        return self.plane_from_pixels(pixels) * self.rendered_focal_px + middle

    def from_rendered(self, pixels: Float64Array) -> Float64Array:
        """Map pixels (n, 2) of the rendered plane to the pinhole."""
        middle = np.array(self.rendered_size) / 2
        plane = (pixels - middle) / self.rendered_focal_px
        return plane * self.focal_lengths_px + self.principal_point


def _build_calibrated(
    camera: Camera, width_px: int, height_px: int, distortion: LensDistortion | None
) -> CameraModel:
    """Build the model of a camera with intrinsics, which scale with its image."""
    across, down = width_px / camera.width_px, height_px / camera.height_px
    column, row = camera.centre_px
    return CameraModel(
        width_px,
        height_px,
        focal_px=camera.focal_px * across,
        distortion=distortion,
        pixel_aspect=camera.pixel_aspect * down / across,
        offset_px=(column * across - width_px / 2, row * down - height_px / 2),
    )


MAX_DEPTH_CM = 65_535
"""Depth of the sky and of all farther surfaces."""


def quantise_depth(depth: NDArray[np.float32]) -> NDArray[np.uint16]:
    """Round depths (h, w) in metres, inf for the sky, to centimetres, at most `MAX_DEPTH_CM`."""
    return np.rint(np.minimum(depth * np.float32(100.0), MAX_DEPTH_CM)).astype(np.uint16)
