"""Takes the noise of few samples out of a picture, on the CPU and the same way every time."""

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.float32]


def denoised(radiance: Image, albedo: Image, normal: Image) -> Image:
    """A picture (h, w, 3) of any scale by Intel's Open Image Denoise.

    Args:
        radiance: Linear, with noise.
        albedo: (h, w, 3) in [0, 1], without noise: where materials change.
        normal: (h, w, 3), unit, without noise: where shapes do.
    """
    # Its library takes a while to load, and only few pictures need it.
    import pyoidn

    return pyoidn.denoise(
        np.ascontiguousarray(radiance),
        albedo=np.ascontiguousarray(albedo),
        normal=np.ascontiguousarray(normal),
        hdr=True,
    )
