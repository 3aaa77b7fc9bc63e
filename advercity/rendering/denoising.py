"""Removes the noise of path tracing with few samples; the backends bring the library."""

import numpy as np

from advercity.geometry.arrays import Float32Array


def denoise(radiance: Float32Array, albedo: Float32Array, normal: Float32Array) -> Float32Array:
    """Remove the noise of few samples from an image (h, w, 3) by Intel's Open Image Denoise.

    It runs on the CPU, and gives the same bytes every time. `albedo` (h, w, 3) in [0, 1] and
    `normal` (h, w, 3) are without noise: they show where materials and shapes change.
    """
    # The library takes a while to load, and only images of full quality need it.
    import pyoidn

    image, albedo, normal = (np.ascontiguousarray(item) for item in (radiance, albedo, normal))
    return pyoidn.denoise(image, albedo=albedo, normal=normal, hdr=True)
