"""Reflection of 77 GHz waves by surfaces: a mirrored part, and scattering of the rest.

The part in phase is mirrored (Ament 1953). The rest scatters from normally distributed slopes
(geometric optics; Ulaby, Moore and Fung 1982, chapter 12), plus a little diffuse scattering by the
cosines of both directions.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from advercity.geometry.arrays import FloatArray
from advercity.materials import MATERIALS, WATER_77GHZ
from advercity.physics.microwaves import WAVELENGTH_M
from advercity.rendering.raycaster import RayHits
from advercity.semantics import Semantic

DIFFUSE_FRACTION = 0.1
"""Diffuse scattering relative to the reflectance at normal incidence, an assumption: asphalt then
has -19 dB at normal incidence and -27 dB at 80 deg."""
WATER_FILM_SMOOTHING = 0.7
"""Fraction of a road's roughness filled by a soaking film: an assumption."""

WAVENUMBER_PER_M = 2.0 * math.pi / WAVELENGTH_M
_SURFACES = [material.radar for material in MATERIALS.values()]
_PERMITTIVITY = np.array([item.permittivity for item in _SURFACES], np.complex64)
_HEIGHT_M = np.array([item.height_mm * 1e-3 for item in _SURFACES], np.float32)
_SLOPE = np.array([item.slope for item in _SURFACES], np.float32)


@dataclass(frozen=True, eq=False)
class HitSurfaces:
    """The surfaces hit by n rays.

    Attributes:
        normal: (n, 3) unit, towards the incoming ray.
        cosine: (n,) of the angle of incidence.
        permittivity: (n,) complex.
        slope: (n,) standard deviation of the slope.
        mirrored: (n,) fraction of the reflected power in phase.
    """

    normal: FloatArray
    cosine: FloatArray
    permittivity: NDArray[np.complex64]
    slope: FloatArray
    mirrored: FloatArray

    @staticmethod
    def from_hits(hits: RayHits, wetness: float) -> "HitSurfaces":
        """Look up the surfaces of hits; a wet road is smoother and more like water."""
        is_road = (hits.semantic == Semantic.ROAD) | (hits.semantic == Semantic.ROAD_LINE)
        film = hits.keep_exposed(np.where(is_road, np.float32(wetness), np.float32(0.0)))
        permittivity = _PERMITTIVITY.take(hits.material)
        height_m = _HEIGHT_M.take(hits.material) * (1.0 - WATER_FILM_SMOOTHING * film)
        phase = 2.0 * WAVENUMBER_PER_M * height_m * hits.cosine
        return HitSurfaces(
            normal=hits.normal,
            cosine=np.maximum(hits.cosine, np.float32(1e-4)),
            permittivity=_wet(permittivity, film / 2.0),
            slope=_SLOPE.take(hits.material),
            mirrored=np.exp(-(phase**2)),
        )

    def compute_mirror_power(self) -> FloatArray:
        """Compute the fraction (n,) of the power in the mirror direction."""
        return self.mirrored * compute_reflectance(self.permittivity, self.cosine)

    def compute_scattering(self, incoming: FloatArray, outgoing: FloatArray) -> FloatArray:
        """Compute the bistatic cross-section per area (n,), without the mirrored part.

        Args:
            incoming: (n, 3) direction of the wave towards the surface, unit.
            outgoing: (n, 3) direction away from it, unit.
        """
        middle = outgoing - incoming
        length = np.maximum(np.linalg.norm(middle, axis=1), 1e-6)
        tilt = np.clip(_dot(middle, self.normal) / length, 1e-3, 1.0)
        squared_slope = 2.0 * self.slope**2
        lobe = np.exp(-(1.0 / tilt**2 - 1.0) / squared_slope) / (squared_slope * tilt**4)
        facet = compute_reflectance(self.permittivity, _dot(middle, outgoing) / length)
        upright = compute_reflectance(self.permittivity, np.ones_like(tilt))
        leaving = np.maximum(_dot(outgoing, self.normal), 0.0)
        diffuse = DIFFUSE_FRACTION * upright * np.sqrt(self.cosine * leaving)
        return (1.0 - self.mirrored) * (lobe * facet * (leaving > 0.0) + diffuse)


def compute_reflectance(permittivity: NDArray[np.complex64], cosine: FloatArray) -> FloatArray:
    """Compute Fresnel's reflectance (n,), the mean of both polarisations."""
    inside = np.sqrt(permittivity - 1.0 + cosine**2)
    across = np.abs((cosine - inside) / (cosine + inside)) ** 2
    along = np.abs((permittivity * cosine - inside) / (permittivity * cosine + inside)) ** 2
    return ((across + along) / 2.0).astype(np.float32)


def _wet(permittivity: NDArray[np.complex64], fraction: FloatArray) -> NDArray[np.complex64]:
    mixed = permittivity + fraction * (WATER_77GHZ.permittivity - permittivity)
    return mixed.astype(np.complex64)


def _dot(first: FloatArray, second: FloatArray) -> FloatArray:
    return np.einsum("ni,ni->n", first, second)
