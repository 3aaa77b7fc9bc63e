"""The sky as images show it, with its clouds."""

import cv2
import numpy as np

from advercity.geometry.arrays import Float32Array
from advercity.physics.atmosphere import Atmosphere
from advercity.physics.clouds import draw_cloudy_sky

CLOUDY_SKY_SIZE = 512
"""Texels along an edge of the sky's cubemap where it has clouds."""


def draw_visible_sky(atmosphere: Atmosphere) -> Float32Array:
    """Draw the six faces (6, n, n, 3) of the sky's cubemap with its clouds, in cd/m²."""
    if atmosphere.clouds is None:
        return atmosphere.sky
    drawn = draw_cloudy_sky(atmosphere.clouds, atmosphere.sky, CLOUDY_SKY_SIZE)
    if atmosphere.cloud_contrast == 1.0:
        return drawn
    smooth = np.stack([cv2.resize(face, drawn.shape[1:3]) for face in atmosphere.sky])
    return smooth + np.float32(atmosphere.cloud_contrast) * (drawn - smooth)
