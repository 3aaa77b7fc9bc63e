"""What water does to light: at its surface, and as a film over something rough."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.floating[Any]]

INDEX = 1.333
"""Refractive index of water in the visible."""
EXTERNAL = 0.0664
"""Share of diffuse light that a water surface reflects from outside."""
INTERNAL = 1.0 - (1.0 - EXTERNAL) / INDEX**2
"""The same from inside, where much is totally reflected."""


def fresnel(cosine: Floats, index: float) -> Floats:
    """Share (n,) of unpolarised light that a smooth surface of that refractive index reflects."""
    refracted = np.sqrt(1.0 - (1.0 - cosine**2) / index**2)
    across = (cosine - index * refracted) / (cosine + index * refracted)
    along = (index * cosine - refracted) / (index * cosine + refracted)
    return (across**2 + along**2) / 2.0


def film_albedo(albedo: Floats) -> Floats:
    """Albedo (n,) of a Lambertian surface under a film of water, the film's own mirror left out.

    Light that the surface sends up is held back by the film and gets another chance to be lost
    (Angstrom 1925). The whole surface reflects `EXTERNAL` more.
    """
    return (1.0 - EXTERNAL) * (1.0 - INTERNAL) * albedo / (1.0 - albedo * INTERNAL)
