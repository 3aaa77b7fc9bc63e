"""Axes of other projects, as poses from those used here."""

import numpy as np

OPTICAL_FROM_BODY = np.array(
    [[0.0, -1.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
)
"""From x forward, y left, z up to x right, y down, z along the view."""
