"""The tone curve: how the light that a sensor holds becomes the values of a picture."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

WHITE_DN = 4095
"""Of the 12-bit converter, where a pixel is full in the long exposure."""
MOST_DN = 16 * WHITE_DN
"""Of a sensor with four stops of highlights."""
MIDDLE_GREY = 0.18
"""Of that. Up to here the curve is that of sRGB alone."""


@lru_cache(maxsize=64)
def tone_curve(brightest_ev: float) -> NDArray[np.uint8]:
    """Values of a picture by what the converter says, white for all that is brightest.

    Where nothing is brighter than a full pixel it is sRGB. Else what is lighter than middle grey
    is rolled off towards white as film does, by Reinhard's extended curve (2002) from there on:
    it leaves middle grey with slope 1 and comes to white at what is brightest.

    Args:
        brightest_ev: Stops above a full pixel that are still told apart.
    """
    linear = np.arange(MOST_DN + 1) / WHITE_DN
    whitest = 2.0**brightest_ev
    shown = np.minimum(_rolled_off(np.minimum(linear, whitest), whitest), 1.0)
    encoded = np.where(shown <= 0.0031308, 12.92 * shown, 1.055 * shown ** (1 / 2.4) - 0.055)
    return np.rint(encoded * 255.0).astype(np.uint8)


def _rolled_off(linear: NDArray[np.float64], whitest: float) -> NDArray[np.float64]:
    room = 1.0 - MIDDLE_GREY
    above = np.maximum(linear - MIDDLE_GREY, 0.0) / room
    full = (whitest - MIDDLE_GREY) / room
    return np.minimum(linear, MIDDLE_GREY) + room * above * (1.0 + above / full**2) / (1.0 + above)
