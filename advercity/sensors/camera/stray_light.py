"""Light that a lens scatters away from where it belongs: veils around lamps and the sun."""

import math
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float32]
Numbers = NDArray[np.floating[Any] | np.integer[Any]]
"""What OpenCV may return, by its stubs."""

CORE_RAD = math.radians(0.5)
CUT_RAD = math.radians(60.0)
VEIL_WIDTH_PX = 256
"""Width at which the veil is worked out; it is smooth, so that is fine enough."""


def scattered(radiance: Array, *, horizontal_fov_rad: float, share: float) -> Array:
    """Radiance (h, w, 3) behind a lens that scatters `share` of the light.

    The point-spread function is (1 - e) delta + e C / (theta² + theta_0²)^1.5. The veil is worked
    out on a small copy of the picture, as around its middle; what is beyond the edges is taken to
    be like what is within.
    """
    height, width = radiance.shape[:2]
    scale = min(1.0, VEIL_WIDTH_PX / width)
    small_size = max(1, round(width * scale)), max(1, round(height * scale))
    small = cv2.resize(radiance, small_size, interpolation=cv2.INTER_AREA)
    focal_px = small_size[0] / (2.0 * math.tan(horizontal_fov_rad / 2.0))
    veil = _veil(small.astype(np.float32), focal_px)
    spread = cv2.resize(veil, (width, height), interpolation=cv2.INTER_LINEAR)
    return cv2.addWeighted(radiance, 1.0 - share, spread, share, 0.0).astype(np.float32)


def _veil(picture: Array, focal_px: float) -> Array:
    """The picture (h, w, 3) convolved with the scattering kernel, edges made up for."""
    height, width = picture.shape[:2]
    spectrum, within = _lens(height, width, focal_px)
    spread = [_convolved(channel, spectrum) / within for channel in cv2.split(picture)]
    return np.maximum(np.stack(spread, axis=-1), 0.0).astype(np.float32)


def _convolved(channel: Numbers, spectrum: Numbers) -> Numbers:
    height, width = channel.shape
    padded = np.zeros(spectrum.shape)
    padded[:height, :width] = channel
    product = cv2.mulSpectrums(cv2.dft(padded, nonzeroRows=height), spectrum, 0)
    return cv2.idft(product, flags=cv2.DFT_SCALE, nonzeroRows=height)[:height, :width]


@lru_cache(maxsize=16)
def _lens(height: int, width: int, focal_px: float) -> tuple[Numbers, Numbers]:
    """Spectrum of the kernel for pictures of a size, and what of it falls within (h, w)."""
    spectrum = cv2.dft(_kernel((2 * height, 2 * width), focal_px))
    return spectrum, _convolved(np.ones((height, width)), spectrum)


def _kernel(shape: tuple[int, int], focal_px: float) -> NDArray[np.float64]:
    """Scattering kernel of sum 1 around the optical axis, centred on [0, 0] and wrapped around."""
    rows, columns = (np.fft.fftfreq(count, 1.0 / count) for count in shape)
    angle = np.arctan(np.hypot(rows[:, None], columns[None, :]) / focal_px)
    kernel = np.where(angle < CUT_RAD, (angle**2 + CORE_RAD**2) ** -1.5, 0.0)
    return kernel / kernel.sum()
