"""Projection of cameras: focal lengths, principal point, and distortion by the lens.

A lens maps the angle of a ray off the axis to its distance from the principal point. Both models
and the order of their coefficients are OpenCV's: `distCoeffs` of `cv2.projectPoints` is (k1, k2,
p1, p2, k3); in `cv2.fisheye.projectPoints` it is (k1, k2, k3, k4).
"""

import math
from typing import Annotated, Literal

from pydantic import Field

from advercity_dsl.base import CompactModel
from advercity_dsl.units import Number

MAX_OFF_AXIS_DEG = 75.0
"""Largest angle off the axis in an image: beyond it, corners take most of the rendered plane."""
MAX_RENDERED_PX = 16_384
"""Largest side of the rendered plane: the limit of graphics cards."""
SEARCH_STEPS = 1500
"""Angles up to MAX_OFF_AXIS_DEG at which an image's edge is searched."""
FocalLength = Annotated[Number, Field(gt=0, le=100_000)]
PrincipalPoint = Annotated[Number, Field(ge=0, le=8192)]
Coefficient = Annotated[Number, Field(ge=-10, le=10)]


class Intrinsics(CompactModel):
    """Focal lengths and principal point of a calibrated camera, in pixels of its full image.

    As in OpenCV and ROS, the middle of the upper left pixel is (0, 0).
    """

    fx_px: FocalLength
    """Focal length in widths of a pixel."""
    fy_px: FocalLength
    """Focal length in heights of a pixel."""
    cx_px: PrincipalPoint
    """Column at which the optical axis meets the image."""
    cy_px: PrincipalPoint
    """Its row."""


class BrownConradyLens(CompactModel):
    """Radial distortion by powers of a ray's tangent, and decentring (Brown 1971)."""

    model: Literal["brown_conrady"]
    """Selects this model."""
    k1: Coefficient = 0
    """Coefficient of the square of the tangent; negative is a barrel, positive a pincushion."""
    k2: Coefficient = 0
    """Coefficient of the tangent's fourth power."""
    p1: Annotated[Number, Field(ge=-0.1, le=0.1)] = 0
    """Decentring downwards."""
    p2: Annotated[Number, Field(ge=-0.1, le=0.1)] = 0
    """Decentring to the right."""
    k3: Coefficient = 0
    """Coefficient of the tangent's sixth power."""

    @property
    def coefficients(self) -> tuple[float, ...]:
        """All coefficients in OpenCV's order."""
        return self.k1, self.k2, self.p1, self.p2, self.k3

    @property
    def decentring(self) -> tuple[float, float]:
        """The two coefficients p1 and p2 of decentring."""
        return self.p1, self.p2

    def compute_radius(self, angle_rad: float) -> float:
        """Compute the radius of a ray in focal lengths, without decentring."""
        radius = math.tan(angle_rad)
        square = radius**2
        return radius * (1 + square * (self.k1 + square * (self.k2 + square * self.k3)))


class KannalaBrandtLens(CompactModel):
    """A fisheye: radial distortion by powers of a ray's angle (Kannala and Brandt 2006)."""

    model: Literal["kannala_brandt"]
    """Selects this model."""
    k1: Coefficient = 0
    """Coefficient of the square of the angle in radians."""
    k2: Coefficient = 0
    """Coefficient of the angle's fourth power."""
    k3: Coefficient = 0
    """Coefficient of the angle's sixth power."""
    k4: Coefficient = 0
    """Coefficient of the angle's eighth power."""

    @property
    def coefficients(self) -> tuple[float, ...]:
        """All coefficients in OpenCV's order."""
        return self.k1, self.k2, self.k3, self.k4

    @property
    def decentring(self) -> tuple[float, float]:
        """Coefficients of decentring, which the model lacks."""
        return 0.0, 0.0

    def compute_radius(self, angle_rad: float) -> float:
        """Compute the radius of a ray in focal lengths."""
        square = angle_rad**2
        factor = self.k1 + square * (self.k2 + square * (self.k3 + square * self.k4))
        return angle_rad * (1 + square * factor)


CameraLens = Annotated[BrownConradyLens | KannalaBrandtLens, Field(discriminator="model")]


def find_edge_angle(lens: CameraLens, corner_radius: float, min_angle_rad: float = 0.0) -> float:
    """Find the largest angle off the axis, in radians, of all rays of an image.

    Args:
        lens: The lens.
        corner_radius: Distance of the farthest corner from the principal point in focal lengths.
        min_angle_rad: Least angle shown by the image.

    Raises:
        ValueError: Rays within the image fold back, or it shows more than a plane can.
    """
    radius = 0.0
    for step in range(1, SEARCH_STEPS + 1):
        angle_rad = math.radians(MAX_OFF_AXIS_DEG * step / SEARCH_STEPS)
        # Decentring moves a ray by three times this at most: inwards on one side of the image.
        moved = 3 * math.hypot(*lens.decentring) * math.tan(angle_rad) ** 2
        previous, radius = radius, lens.compute_radius(angle_rad) - moved
        if radius <= previous:
            place_deg = math.degrees(angle_rad)
            raise ValueError(
                f"folds the image {place_deg:.1f} deg off the axis, within its corners"
            )
        if radius >= corner_radius and angle_rad >= min_angle_rad:
            return angle_rad
    raise ValueError(
        f"shows more than {2 * MAX_OFF_AXIS_DEG:g} deg from corner to corner, which no plane that "
        "is rendered can"
    )
