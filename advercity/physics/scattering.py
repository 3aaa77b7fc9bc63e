"""Scattering of light by particles in the air.

Phase functions are per steradian, by the cosine of the scattering angle.

Droplets deflect half of the light by about a degree. On a path between two points such
deflections add up: at small angles a Henyey-Greenstein lobe is a two-dimensional Cauchy
distribution, whose scales add, and a deflection counts more the farther it is from the end of the
path. Light scattered in this way lies within an angle of k spreads with a probability of
1 + k - sqrt(1 + k²), which is exact for one scattering anywhere on the path.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from advercity.geometry.arrays import FloatArray

PhaseFunction = Callable[[FloatArray], FloatArray]


def henyey_greenstein(cosine: FloatArray, g: float) -> FloatArray:
    """Evaluate the phase function (n,) with mean cosine `g` (Henyey and Greenstein 1941)."""
    return (1.0 - g**2) / (4.0 * math.pi * (1.0 + g**2 - 2.0 * g * cosine) ** 1.5)


@dataclass(frozen=True)
class PhaseLobes:
    """Phase function of particles in the air, as a narrow and a wide lobe.

    A Henyey-Greenstein and a Draine lobe; Jendersie and d'Eon (2023) fitted them to Mie theory for
    fog droplets of 5 to 50 um.

    Attributes:
        narrow_g: Mean cosine of the narrow lobe, a Henyey-Greenstein function.
        wide_g: Parameter g of the wide lobe, a Draine function.
        wide_a: Parameter alpha of the wide lobe.
        wide_fraction: Fraction of the scattered light in the wide lobe.
    """

    narrow_g: float
    wide_g: float
    wide_a: float
    wide_fraction: float

    @classmethod
    def from_diameter_um(cls, diameter_um: float) -> "PhaseLobes":
        """Compute the lobes of droplets of a diameter, by the fit's four formulas."""
        d = diameter_um
        return cls(
            narrow_g=math.exp(-0.0990567 / (d - 1.67154)),
            wide_g=math.exp(-2.20679 / (d + 3.91029) - 0.428934),
            wide_a=math.exp(3.62489 - 8.29288 / (d + 5.52825)),
            wide_fraction=math.exp(-0.599085 / (d - 0.641583) - 0.665888),
        )

    @classmethod
    def from_mean_cosine(cls, g: float) -> "PhaseLobes":
        """Build a single Henyey-Greenstein function, for irregular grains."""
        return cls(narrow_g=0.0, wide_g=g, wide_a=0.0, wide_fraction=1.0)

    @property
    def narrow_fraction(self) -> float:
        """Fraction of the scattered light in the narrow lobe."""
        return 1.0 - self.wide_fraction

    @property
    def narrow_scale_rad(self) -> float:
        """Scale of the narrow lobe's deflections, as a Cauchy distribution of small angles."""
        return (1.0 - self.narrow_g) / math.sqrt(self.narrow_g)

    def forward_spread_rad(self, depth: FloatArray) -> FloatArray:
        """Compute the spread (...) of scattered light with small deflections on a path.

        `depth` (...) is the optical depth of the narrow lobe alone, above 0.
        """
        return self.narrow_scale_rad * depth / -np.expm1(-depth)

    def deflection_density(self, angle: FloatArray, spread: FloatArray) -> FloatArray:
        """Compute the density (...) of deflections by an angle (...) on either side of a path.

        The derivative of the fraction within an angle, 1/rad; `spread` (...) is in radians, too.
        """
        spreads = angle / spread
        root = np.sqrt(1.0 + spreads**2)
        return 1.0 / (spread * root * (root + spreads))

    def deflection_gain(self, angle: FloatArray, depth: FloatArray) -> FloatArray:
        """Compute the light (...) deflected by an angle, however often, relative to once.

        `depth` (...) is the optical depth of the narrow lobe alone. Renderers repeat this formula.
        """
        often = self.deflection_density(angle, self.forward_spread_rad(depth)) * np.expm1(depth)
        once = depth * self.deflection_density(angle, np.asarray(self.narrow_scale_rad))
        return often / once

    def fraction_kept(self, depth: FloatArray, radius_rad: FloatArray) -> FloatArray:
        """Compute the fraction (...) of its light that a disc keeps in the middle of its image.

        The disc has an angular radius (...), seen through an optical depth (...) of all scattering:
        light of the wide lobe is lost, light of the narrow one only beyond the radius.
        """
        narrow = self.narrow_fraction * depth
        spreads = radius_rad / self.forward_spread_rad(narrow)
        within = 1.0 + spreads - np.sqrt(1.0 + spreads**2)
        unscattered = np.exp(-narrow)
        return np.exp(-self.wide_fraction * depth) * (unscattered + (1.0 - unscattered) * within)

    def narrow_phase(self, cosine: FloatArray) -> FloatArray:
        """Evaluate the phase function (n,) of the narrow lobe alone."""
        return henyey_greenstein(cosine, self.narrow_g)

    def wide_phase(self, cosine: FloatArray) -> FloatArray:
        """Evaluate the phase function (n,) of the wide lobe alone."""
        g, a = self.wide_g, self.wide_a
        anisotropy = (1.0 + a * cosine**2) / (1.0 + a * (1.0 + 2.0 * g**2) / 3.0)
        return henyey_greenstein(cosine, g) * anisotropy
