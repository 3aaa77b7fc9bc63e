"""Grey pictures of thermal images, stretched as the electronics of such cameras do."""

import numpy as np
from numpy.typing import NDArray

from advercity.geometry.arrays import Uint8Array

DARK_PERCENT, BRIGHT_PERCENT = 0.5, 99.5
MIN_SPAN = 100
"""Least difference of values from black to white, 4 K: less would show noise alone."""


def draw_thermal(counts: NDArray[np.uint16]) -> Uint8Array:
    """Draw the values (h, w) of a thermal image as RGB (h, w, 3), white hot."""
    dark, bright = np.percentile(counts, (DARK_PERCENT, BRIGHT_PERCENT))
    span = max(float(bright - dark), MIN_SPAN)
    level = (counts - (dark + bright - span) / 2) / span
    grey = np.rint(np.clip(level, 0.0, 1.0) * 255.0).astype(np.uint8)
    return np.repeat(grey[..., None], 3, axis=2)
