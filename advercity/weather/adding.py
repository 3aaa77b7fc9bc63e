"""Light in layers of scattering air over a plane, by doubling and adding (van de Hulst 1980).

Radiances are series in the cosine of the azimuth from the sun, one term after the other along the
first axis; directions are `Streams`, as many down as up.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from advercity.weather.scattering import Phase

Array = NDArray[np.float64]

COUNT, TERMS = 24, 12
"""Directions between level and vertical, and terms in azimuth beyond the mean."""
AZIMUTHS = 128
"""Of the quadrature around the vertical."""
DOUBLINGS = 20
"""From a layer so thin that light is scattered in it once."""


@dataclass(frozen=True, eq=False)
class Streams:
    """Directions, and how air scatters light from one into another.

    Attributes:
        cosine: (n,) to the vertical, the last one the sun's.
        weight: (n,) of the integral over cosines, none for the sun.
        onward: (terms, n, n) from the last axis into the one before, both up or both down.
        back: The same from down to up.
    """

    cosine: Array
    weight: Array
    onward: Array
    back: Array

    @classmethod
    def with_sun(cls, cosine: float, phase: Phase) -> "Streams":
        """Gaussian directions and the sun's, in air that scatters by a smooth phase function."""
        node, weight = np.polynomial.legendre.leggauss(COUNT)
        cosines = np.append((node + 1.0) / 2.0, cosine)
        weights = np.append(weight / 2.0, 0.0)
        onward, back = (_terms(cosines, sign * cosines, phase) for sign in (1.0, -1.0))
        kept = weights @ (onward[0] + back[0])
        return cls(cosines, weights, onward / kept, back / kept)

    def illuminance(self, radiance: Array) -> float:
        """Of a level plane under (terms, n)."""
        return float(2.0 * np.pi * (self.weight * self.cosine) @ radiance[0])

    def scattered(self, along: Array, against: Array) -> Array:
        """What air scatters (terms, n), by radiances the same way and the other."""
        return np.einsum("mij,j,mj->mi", self.onward, self.weight, along) + np.einsum(
            "mij,j,mj->mi", self.back, self.weight, against
        )

    def series(self, radiance: Array) -> Array:
        """Terms (terms, n) of radiances (n, AZIMUTHS), at `azimuths`."""
        terms = radiance @ np.cos(np.outer(azimuths(), np.arange(TERMS + 1))) / AZIMUTHS
        return np.where(np.arange(TERMS + 1) > 0, 2.0, 1.0)[:, None] * terms.T


@dataclass(frozen=True, eq=False)
class Layer:
    """What a layer does to light: the same from above and from below.

    Attributes:
        reflected: (terms, n, n) from the last axis into the one before, before weights.
        scattered: The same for what goes through and is scattered.
        straight: (n,) what goes through and is not.
    """

    reflected: Array
    scattered: Array
    straight: Array

    @classmethod
    def of_depth(cls, depth: float, streams: Streams) -> "Layer":
        """A layer of an optical depth that absorbs nothing."""
        thin = depth / 2.0**DOUBLINGS
        layer = cls(
            streams.back * (thin / streams.cosine)[:, None],
            streams.onward * (thin / streams.cosine)[:, None],
            np.exp(-thin / streams.cosine),
        )
        for _ in range(DOUBLINGS):
            layer = layer.twice(streams.weight)
        return layer

    def twice(self, weight: Array) -> "Layer":
        """Two of it, one upon the other."""
        straight = self.straight
        again, through = self.reflected * weight, self.scattered * weight
        forth = np.linalg.inv(np.eye(len(weight)) - again @ again)
        down = forth @ (self.scattered + again @ (self.reflected * straight))
        up = self.reflected * straight + again @ down
        return Layer(
            self.reflected + straight[:, None] * up + through @ up,
            straight[:, None] * down + self.scattered * straight + through @ down,
            straight**2,
        )

    def through(self, radiance: Array, weight: Array) -> Array:
        """What of (terms, n) comes out on the other side."""
        return self.straight * radiance + _applied(self.scattered * weight, radiance)

    def sent_back(self, radiance: Array, weight: Array) -> Array:
        """What of (terms, n) comes back."""
        return _applied(self.reflected * weight, radiance)

    def of_beam(self, lux: float) -> tuple[Array, Array]:
        """What it sends back and on, scattered, (terms, n) of a sun of so many lux."""
        terms = len(self.reflected)
        share = lux / np.pi * np.where(np.arange(terms) > 0, 1.0, 0.5)[:, None]
        return share * self.reflected[:, :, -1], share * self.scattered[:, :, -1]


def azimuths() -> Array:
    """Angles (AZIMUTHS,) from the sun at which `Streams.series` wants radiances."""
    return (np.arange(AZIMUTHS) + 0.5) / AZIMUTHS * np.pi


def _applied(matrix: Array, radiance: Array) -> Array:
    return (matrix @ radiance[..., None])[..., 0]


def _terms(towards: Array, coming: Array, phase: Phase) -> Array:
    """Terms (terms, n, n) of a phase function, times two pi."""
    turn = np.cos(azimuths())
    level = np.sqrt(1.0 - towards**2)[:, None, None] * np.sqrt(1.0 - coming**2)[:, None]
    turned = phase(towards[:, None, None] * coming[:, None] + level * turn)
    wave = np.cos(np.outer(np.arange(TERMS + 1), azimuths())) * (2.0 * np.pi / AZIMUTHS)
    return np.einsum("ijf,mf->mij", turned, wave)
