"""Light scattered forward by droplets, drops and flakes, within a receiver's view.

Particles much larger than the wavelength diffract half of the light they remove from a beam into a
lobe about its direction. A receiver with a field of view keeps the part scattered close to the
target, on the way out or back. This weakens the extinction (Platt, J. Atmos. Sci. 38, 156 (1981))
and delays the return. The lobe is a Gaussian (Eloranta, Appl. Opt. 37, 2464 (1998)). Each ray is
scattered once on each way, which holds while the optical depth of the kept part is small. Light
scattered by wide angles, a diffuse background, is lost.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass

from advercity.physics.weather_parts.part import Precipitation, Suspension

WAVELENGTH_M = 905e-9
DIFFRACTED_FRACTION = 0.5
"""Fraction of diffraction in extinction, in the geometric limit."""


@dataclass(frozen=True)
class Diffraction:
    """Diffracting particles.

    Attributes:
        extinction_per_m: Extinction coefficient.
        diameter_m: Mean diameter, weighted by cross-section.
    """

    extinction_per_m: float
    diameter_m: float

    @staticmethod
    def from_droplets(part: Suspension) -> "Diffraction":
        """Build the diffraction by droplets, which have a `droplet_um`."""
        return Diffraction(part.extinction.at_905nm, (part.droplet_um or math.inf) * 1e-6)

    @staticmethod
    def from_precipitation(part: Precipitation) -> "Diffraction":
        """Build the diffraction by precipitation; the area-weighted mean of exp(-k D) is 3 / k."""
        diameter_mm = 3.0 / part.sizes.slope_per_mm * part.sizes.air_to_melted_diameter
        return Diffraction(part.extinction_per_m, diameter_mm * 1e-3)

    @property
    def lobe_rad(self) -> float:
        """Angle at which the lobe has fallen to 1/e: the wavelength over pi times the radius."""
        return WAVELENGTH_M / (math.pi * self.diameter_m / 2.0)

    def kept_extinction_per_m(self, field_of_view_rad: float) -> float:
        """Compute the part of the extinction regained by a receiver with a full field of view.

        Light scattered at the distance x before a target at R stays in view if it lands within
        half of the field of view times R. The fraction is 1 - exp(-(q R / x)²), with q the half
        field of view over the lobe's width; the result is its mean over the path.
        """
        q = field_of_view_rad / 2.0 / self.lobe_rad
        mean = 1.0 - math.exp(-q * q) + math.sqrt(math.pi) * q * math.erfc(q)
        return DIFFRACTED_FRACTION * self.extinction_per_m * mean

    def delay_per_m(self, field_of_view_rad: float) -> float:
        """Compute the mean excess of range over the range squared, 1/m, of the light in view.

        A detour by an angle a at the distance x is a² x / 2 longer, there and back alike.
        """
        q = field_of_view_rad / 2.0 / self.lobe_rad
        weight = -math.expm1(-q * q) / 2.0
        return DIFFRACTED_FRACTION * self.extinction_per_m * self.lobe_rad**2 / 2.0 * weight


def kept_extinction_per_m(particles: Iterable[Diffraction], field_of_view_rad: float) -> float:
    """Compute the extinction regained by a receiver, of all particles together."""
    return sum(item.kept_extinction_per_m(field_of_view_rad) for item in particles)


def delay_per_m(particles: Iterable[Diffraction], field_of_view_rad: float) -> float:
    """Compute the excess of range over the range squared by all particles together."""
    return sum(item.delay_per_m(field_of_view_rad) for item in particles)
