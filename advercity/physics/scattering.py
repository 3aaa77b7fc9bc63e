"""How particles in the air turn light aside, once.

Phase functions are per steradian, of the cosine of the angle by which light is turned.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from advercity.geometry.arrays import FloatArray

PhaseFunction = Callable[[FloatArray], FloatArray]

NUM_QUADRATURE_STEPS = 64
"""Of the quadrature along a ray."""
LEVEL_PATH_TOLERANCE = 1e-4
"""Rise against the scale height below which a path counts as level."""


def henyey_greenstein(cosine: FloatArray, g: float) -> FloatArray:
    """Phase function (n,) with the mean cosine `g` (Henyey and Greenstein 1941)."""
    return (1.0 - g**2) / (4.0 * math.pi * (1.0 + g**2 - 2.0 * g * cosine) ** 1.5)


@dataclass(frozen=True)
class DropletPhaseLobes:
    """How fog droplets of 5 to 50 um scatter: a narrow lobe and a wide one.

    A Henyey-Greenstein and a Draine lobe fitted to Mie theory by Jendersie and d'Eon (2023).

    Attributes:
        narrow_g: Mean cosine of the narrow lobe.
        wide_g: Parameter g of the wide one.
        wide_a: Its parameter alpha.
        wide_fraction: Of scattered light, what the wide one has.
    """

    narrow_g: float
    wide_g: float
    wide_a: float
    wide_fraction: float

    @classmethod
    def from_diameter_um(cls, diameter_um: float) -> "DropletPhaseLobes":
        """Those of droplets of a diameter."""
        d = diameter_um
        return cls(
            narrow_g=math.exp(-0.0990567 / (d - 1.67154)),
            wide_g=math.exp(-2.20679 / (d + 3.91029) - 0.428934),
            wide_a=math.exp(3.62489 - 8.29288 / (d + 5.52825)),
            wide_fraction=math.exp(-0.599085 / (d - 0.641583) - 0.665888),
        )

    @property
    def narrow_fraction(self) -> float:
        """Of scattered light, what the narrow lobe has."""
        return 1.0 - self.wide_fraction

    def wide_phase(self, cosine: FloatArray) -> FloatArray:
        """Phase function (n,) of the wide lobe alone."""
        g, a = self.wide_g, self.wide_a
        tilted = (1.0 + a * cosine**2) / (1.0 + a * (1.0 + 2.0 * g**2) / 3.0)
        return henyey_greenstein(cosine, g) * tilted

    def combined_phase(self, cosine: FloatArray) -> FloatArray:
        """Phase function (n,) of the droplets."""
        narrow = henyey_greenstein(cosine, self.narrow_g)
        return self.narrow_fraction * narrow + self.wide_fraction * self.wide_phase(cosine)


def droplet_phase(cosine: FloatArray, diameter_um: float = 12.0) -> FloatArray:
    """Phase function (n,) of fog droplets of 5 to 50 um."""
    return DropletPhaseLobes.from_diameter_um(diameter_um).combined_phase(cosine)


def isotropic_phase(cosine: FloatArray) -> FloatArray:
    """Phase function (n,) of what sends light evenly all around."""
    return np.full_like(cosine, 1.0 / (4.0 * math.pi))


def lamp_airlight(
    intensity_cd: float,
    *,
    closest_approach_m: float,
    closest_along_ray_m: float,
    distance_m: float,
    extinction: float,
    phase: PhaseFunction,
) -> float:
    """Luminance in cd/m² of air along a ray that a lamp lights, scattered once.

    Steps are equal in the angle at the lamp (equiangular, Kulla and Fajardo 2012).

    Args:
        intensity_cd: Of the lamp, all around.
        closest_approach_m: Shortest distance from lamp to ray.
        closest_along_ray_m: Along the ray where it is nearest to the lamp.
        distance_m: Along the ray where it ends.
        extinction: Of the air, 1/m; nothing is absorbed.
        phase: Function of what is in it.
    """
    first = math.atan(-closest_along_ray_m / closest_approach_m)
    last = math.atan((distance_m - closest_along_ray_m) / closest_approach_m)
    node, weight = np.polynomial.legendre.leggauss(NUM_QUADRATURE_STEPS)
    angle = (first + last + (last - first) * node) / 2.0
    along_m = closest_along_ray_m + closest_approach_m * np.tan(angle)
    from_lamp_m = closest_approach_m / np.cos(angle)
    left = np.exp(-extinction * (along_m + from_lamp_m))
    # Light that goes along the ray's own way is turned by nothing, and towards the lamp by half
    # a turn; the measure of the angle takes the square of the distance away.
    turned = phase(-np.sin(angle))
    integral = float(np.sum(weight * turned * left)) * (last - first) / 2.0
    return intensity_cd * extinction * integral / closest_approach_m


def layer_optical_depth(
    extinction: float,
    *,
    scale_height_m: float,
    start_height_m: float,
    rise_m: float,
    distance_m: float,
) -> float:
    """Optical depth of fog that thins out exponentially with height, along a straight path.

    Args:
        extinction: On the ground, 1/m.
        scale_height_m: Over which it falls to 1/e; inf for fog that is even.
        start_height_m: Height of the path's start.
        rise_m: How much higher it ends.
        distance_m: Its length.
    """
    climb = rise_m / scale_height_m
    mean = 1.0 if abs(climb) < LEVEL_PATH_TOLERANCE else -math.expm1(-climb) / climb
    return extinction * math.exp(-start_height_m / scale_height_m) * distance_m * mean
