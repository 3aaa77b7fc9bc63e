"""Images of surfaces: how the colour, the relief and the gloss of a material vary over it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

LINEAR_FROM_SRGB = np.where(
    np.arange(256) <= 10,
    np.arange(256) / 255.0 / 12.92,
    ((np.arange(256) / 255.0 + 0.055) / 1.055) ** 2.4,
)
"""Light of each byte of an sRGB image (IEC 61966-2-1)."""


@dataclass(frozen=True, eq=False)
class MaterialMaps:
    """Images of one surface, all of the same size; sides are powers of two.

    The first row is the upper edge of an upright surface, and the northern one of level ground. The
    images of a named material join their own copies on all sides, without a seam.

    Attributes:
        color: (h, w, 3) or (h, w, 4) uint8, sRGB and the opacity. Renderers scale the colour to a
            linear mean of the material's albedo: LiDAR, exposure and weather are computed from the
            table of materials alone.
        normal: (h, w, 3) uint8, 255 for 1 and 0 for -1: x to the right, y up in the image, z out of
            the surface; None for an even surface.
        roughness: (h, w) uint8, 255 for 1; scaled like the colour, to the mean of the table.
        tile_m: Width of the image on the surface, metres; its height follows from the aspect.
        mean: Mean of the colour as linear light in the used part of the image; None for all of it.
    """

    color: NDArray[np.uint8]
    normal: NDArray[np.uint8] | None
    roughness: NDArray[np.uint8] | None
    tile_m: float
    mean: tuple[float, float, float] | None = None
