"""Pictures are darker towards their corners."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray


def vignetted(light: NDArray[np.float32], focal_px: float, exponent: float) -> NDArray[np.float32]:
    """A picture (h, w, 3) behind a lens that lets cos^exponent through, by the angle off its axis.

    4 is a plain lens without any vignetting of its own, 0 one that makes up for everything.
    """
    if exponent == 0.0:
        return light
    return light * _share(*light.shape[:2], focal_px, exponent)


@lru_cache(maxsize=4)
def _share(height: int, width: int, focal_px: float, exponent: float) -> NDArray[np.float32]:
    """What comes through (h, w, 1) of the light."""
    down = (np.arange(height, dtype=np.float32) + 0.5 - height / 2.0) / focal_px
    right = (np.arange(width, dtype=np.float32) + 0.5 - width / 2.0) / focal_px
    cosine = 1.0 / np.sqrt(1.0 + down[:, None] ** 2 + right[None, :] ** 2)
    return (cosine**exponent)[..., None].astype(np.float32)
