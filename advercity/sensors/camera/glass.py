"""Drops, dust and snow on the glass before a lens; much too near to be sharp."""

import math

import cv2
import numpy as np
from advercity_dsl import Mount
from advercity_dsl.weather import Lens
from numpy.typing import NDArray

from advercity.sensors.camera.shot import Shot

Image = NDArray[np.float32]

GLASS_M = 0.05
"""Before the entrance pupil."""
SPOT_MM = {"water": 3.0, "dust": 0.8, "snow": 6.0}
"""Median diameter of a spot, by what it is."""
SPREAD = 0.35
"""Of the logarithm of diameters."""
MINIFIED = -2.5
"""How a drop shows what is behind it: upside down, and that much of it within its own width."""
DUST_ALBEDO, SNOW_ALBEDO = 0.3, 0.9
SIDE_DEG, REAR_DEG = 45.0, 135.0
"""Headings from which a camera looks to the side, and to the rear."""


def coverage_of(lens: Lens, mount: Mount) -> float:
    """Share of the glass of a camera that is covered, by where it looks; 0 if lenses stay clean."""
    if not lens.enabled:
        return 0.0
    turned = abs(math.remainder(mount.yaw_deg, 360.0))
    if turned < SIDE_DEG:
        return lens.coverage.front
    return lens.coverage.side if turned < REAR_DEG else lens.coverage.rear


def through_glass(
    light: Image, shot: Shot, lens: Lens, coverage: float, rng: np.random.Generator
) -> Image:
    """A picture (h, w, 3) in cd/m² through glass of which a share is covered.

    Args:
        light: What comes to the glass.
        shot: Its focal length and aperture say how blurred the glass is.
        lens: What is on it.
        coverage: 0 leaves the picture as it is.
        rng: Of this camera; the same puts the same spots in the same places.
    """
    if coverage == 0.0:
        return light
    height, width = light.shape[:2]
    middle, radius_px = _spots(shot, lens.kind, coverage, rng)
    mask = np.zeros((height, width), np.float32)
    shift = np.zeros((height, width, 2), np.float32)
    for at, radius in zip(middle, radius_px, strict=True):
        _stamp(mask, shift, at, radius)
    blur_px = max(shot.aperture_m * shot.focal_px / GLASS_M, 1.0)
    mask = cv2.GaussianBlur(mask, (0, 0), blur_px / 4.0)[..., None]
    mean = light.mean(axis=(0, 1))
    if lens.kind == "water":
        down, across = np.mgrid[:height, :width].astype(np.float32)
        behind = cv2.remap(
            cv2.GaussianBlur(light, (0, 0), blur_px),
            across + shift[..., 0],
            down + shift[..., 1],
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REFLECT_101,
        )
        spot = (behind + mean) / 2.0
    else:
        spot = mean * (DUST_ALBEDO if lens.kind == "dust" else SNOW_ALBEDO)
    return (light * (1.0 - mask) + spot * mask).astype(np.float32)


def _spots(
    shot: Shot, kind: str, coverage: float, rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Column and row (n, 2) and radius (n,) in pixels of spots that cover a share of the glass."""
    height, width = shot.view.height_px, shot.view.width_px
    scale = shot.focal_px / GLASS_M
    mean_area = math.pi / 4.0 * (SPOT_MM[kind] * 1e-3 * scale) ** 2 * math.exp(2.0 * SPREAD**2)
    count = rng.poisson(-math.log1p(-min(coverage, 0.95)) * height * width / mean_area)
    diameter = SPOT_MM[kind] * 1e-3 * np.exp(SPREAD * rng.standard_normal(count))
    return rng.random((count, 2)) * [width, height], diameter * scale / 2.0


def _stamp(mask: Image, shift: Image, at: NDArray[np.float64], radius: float) -> None:
    height, width = mask.shape
    left, right = max(0, math.floor(at[0] - radius)), min(width, math.ceil(at[0] + radius))
    top, bottom = max(0, math.floor(at[1] - radius)), min(height, math.ceil(at[1] + radius))
    if left >= right or top >= bottom:
        return
    down, across = np.mgrid[top:bottom, left:right] + 0.5
    off = np.stack([across - at[0], down - at[1]], axis=-1)
    inside = np.hypot(off[..., 0], off[..., 1]) < radius
    mask[top:bottom, left:right][inside] = 1.0
    shift[top:bottom, left:right][inside] = ((MINIFIED - 1.0) * off[inside]).astype(np.float32)
