"""Single scattering of light by particles in the air.

Phase functions are per steradian, by the cosine of the scattering angle.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

from advercity.geometry.arrays import FloatArray

PhaseFunction = Callable[[FloatArray], FloatArray]


def henyey_greenstein(cosine: FloatArray, g: float) -> FloatArray:
    """Evaluate the phase function (n,) with mean cosine `g` (Henyey and Greenstein 1941)."""
    return (1.0 - g**2) / (4.0 * math.pi * (1.0 + g**2 - 2.0 * g * cosine) ** 1.5)


@dataclass(frozen=True)
class DropletPhaseLobes:
    """Phase function of fog droplets of 5 to 50 um, as a narrow and a wide lobe.

    A Henyey-Greenstein and a Draine lobe, fitted to Mie theory by Jendersie and d'Eon (2023).

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
    def from_diameter_um(cls, diameter_um: float) -> "DropletPhaseLobes":
        """Compute the lobes of droplets of a diameter, by the fit's four formulas."""
        d = diameter_um
        return cls(
            narrow_g=math.exp(-0.0990567 / (d - 1.67154)),
            wide_g=math.exp(-2.20679 / (d + 3.91029) - 0.428934),
            wide_a=math.exp(3.62489 - 8.29288 / (d + 5.52825)),
            wide_fraction=math.exp(-0.599085 / (d - 0.641583) - 0.665888),
        )

    @property
    def narrow_fraction(self) -> float:
        """Fraction of the scattered light in the narrow lobe."""
        return 1.0 - self.wide_fraction

    def wide_phase(self, cosine: FloatArray) -> FloatArray:
        """Evaluate the phase function (n,) of the wide lobe alone."""
        g, a = self.wide_g, self.wide_a
        anisotropy = (1.0 + a * cosine**2) / (1.0 + a * (1.0 + 2.0 * g**2) / 3.0)
        return henyey_greenstein(cosine, g) * anisotropy
