"""Blur by a lens, from the middle of the image up to its corners.

Each pixel is the weighted mean of two evenly blurred images, with weights for the variance at its
place, so a few convolutions of whole images are enough. Kernels are discrete Gaussians, whose
variance is exact at any width (Lindeberg, Scale-space for discrete signals, 1990).
"""

import math
from functools import lru_cache

import cv2
import numpy as np
from advercity_dsl import PointSpread
from scipy import special

from advercity.geometry.arrays import Float32Array, Float64Array

LEVEL_STEP_PX = 0.5
"""Largest difference in blur width between successive blurred images."""
KERNEL_REACH = 5.0
"""Half width of a kernel in standard deviations, plus the same number of pixels."""


def spread_points(light: Float32Array, spread: PointSpread, focal_px: float) -> Float32Array:
    """Blur the light (h, w, 3) on a sensor; even light stays as it is.

    Args:
        light: In any unit.
        spread: Widths in the middle and in the corners.
        focal_px: Focal length in pixels of `light`.
    """
    centre, corner = (1e-3 * focal_px * x for x in (spread.centre_mrad, spread.corner_mrad))
    levels = np.linspace(centre, corner, math.ceil((corner - centre) / LEVEL_STEP_PX) + 1) ** 2
    variance = _compute_variance(*light.shape[:2], *levels[[0, -1]].tolist())
    blurred = np.zeros_like(light)
    for place, level in enumerate(levels.tolist()):
        weight = np.interp(variance, levels, np.arange(len(levels)) == place)
        kernel = _build_kernel(level)
        part = cv2.sepFilter2D(light, -1, kernel, kernel, borderType=cv2.BORDER_REFLECT)
        blurred += part * weight[..., None].astype(np.float32)
    return blurred


def _compute_variance(height: int, width: int, centre: float, corner: float) -> Float64Array:
    """Compute the variance (h, w) in square pixels at each pixel."""
    down = (np.arange(height) + 0.5) / height * 2 - 1
    right = (np.arange(width) + 0.5) / width * 2 - 1
    square = (down[:, None] * height) ** 2 + (right[None, :] * width) ** 2
    return centre + (corner - centre) * (square / (height**2 + width**2)) ** 2


@lru_cache(maxsize=64)
def _build_kernel(variance: float) -> Float64Array:
    """Build the discrete Gaussian (n,) of a variance in square pixels."""
    half = math.ceil(KERNEL_REACH * (1 + math.sqrt(variance)))
    kernel = special.ive(np.abs(np.arange(-half, half + 1)), variance)
    return kernel / kernel.sum()
