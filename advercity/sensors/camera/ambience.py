"""Light that small things in the air send to a camera: drops, flakes and spray.

A drop refracts light from far around into the eye, so its brightness hardly depends on what is
behind it (Garg and Nayar 2007); a flake is a white ball.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from advercity.rendering.lamps import LitLamp, intensity_towards
from advercity.weather.atmosphere import Atmosphere
from advercity.weather.sky import cubemap_directions, texel_solid_angles

Array = NDArray[np.float64]
Floats = NDArray[np.floating[Any]]

SIZE = 8
"""Texels along an edge of the sky that is averaged; it is smooth."""
DROP_VIEW_RAD = math.radians(165.0 / 2.0)
"""Half of what a drop lets one see."""
DROP_WEIGHT = 0.94
"""Of what lies within that, against everything around."""
FLAKE_ALBEDO = 0.9
DROP_OF_LAMP = 0.1 / math.pi
"""Luminance of a drop by the illuminance of a lamp, seen from aside."""
FLAKE_OF_LAMP = FLAKE_ALBEDO / (4.0 * math.pi)
"""The same of a flake, whichever side of it is lit."""
BOOST, BOOST_RAD = 10.0, math.radians(20.0)
"""How much brighter a drop is right before a lamp, and how far from it that ends."""
NEAREST_LAMP_M = 0.7
"""The two lamps of a vehicle stand apart; nearer than this they are no point."""
AT_ONCE = 2**14
"""Pairs of lamp and point that are worked out together."""


@dataclass(frozen=True, eq=False)
class Ambience:
    """Sky, ground and sun as seen from one place.

    Attributes:
        directions: (n, 3) unit.
        luminance: (n, 3) of the sky and the ground there, cd/m², linear sRGB.
        share: (n,) of the sphere that each stands for; their sum is 1.
        sun: (3,) towards it.
        sun_lx: (3,) of its direct light.
    """

    directions: Array
    luminance: Array
    share: Array
    sun: Array
    sun_lx: Array

    @staticmethod
    def of(atmosphere: Atmosphere) -> "Ambience":
        """Of an atmosphere."""
        fine = atmosphere.sky.shape[1]
        block = max(1, fine // SIZE)
        size = fine // block
        coarse = atmosphere.sky.astype(np.float64).reshape(6, size, block, size, block, 3)
        share = np.tile(texel_solid_angles(size).ravel(), 6)
        return Ambience(
            directions=cubemap_directions(size).reshape(-1, 3),
            luminance=coarse.mean(axis=(2, 4)).reshape(-1, 3),
            share=share / share.sum(),
            sun=atmosphere.sun_direction,
            sun_lx=atmosphere.sun_lx * np.asarray(atmosphere.sun_colour),
        )

    @property
    def mean(self) -> Array:
        """Mean luminance (3,) of everything around, the sun left out."""
        return self.share @ self.luminance

    def of_drops(self, rays: Array) -> Array:
        """Luminance (n, 3) of drops seen along unit rays (n, 3)."""
        within = (rays @ self.directions.T > math.cos(DROP_VIEW_RAD)) * self.share
        wide = within @ self.luminance / within.sum(axis=1, keepdims=True)
        sun = DROP_OF_LAMP * forward_boost(rays @ self.sun)[:, None] * self.sun_lx
        return DROP_WEIGHT * wide + (1.0 - DROP_WEIGHT) * self.mean + sun

    def of_flakes(self, rays: Array) -> Array:
        """Luminance (n, 3) of flakes, the same whichever way one looks."""
        around = FLAKE_ALBEDO * self.mean + FLAKE_OF_LAMP * self.sun_lx
        return np.broadcast_to(around, rays.shape)


def forward_boost(cosine: Floats) -> Floats:
    """How much brighter a drop (...) is by the cosine between view ray and the way to the lamp."""
    boost = np.ones_like(cosine)
    before = np.nonzero(cosine > math.cos(BOOST_RAD))
    nearness = 1.0 - np.arccos(np.minimum(cosine[before], 1.0)) / BOOST_RAD
    boost[before] += (BOOST - 1.0) * nearness**2 * (3.0 - 2.0 * nearness)
    return boost


def by_lamps(
    lamps: Sequence[LitLamp], points: Floats, eye: Array, *, per_lx: float, boosted: bool
) -> NDArray[np.float32]:
    """Luminance (n, 3) that lamps give to drops or flakes at points (n, 3).

    Args:
        lamps: Nothing is taken to stand between them and the points.
        points: Metres from the eye, axes of the world.
        eye: (3,) from where they are seen.
        per_lx: Luminance by illuminance, from aside.
        boosted: Whether they are brighter before a lamp, as drops are.
    """
    near = points.astype(np.float32)
    seen = near / np.maximum(np.linalg.norm(near, axis=1, keepdims=True), 1e-6)
    sum_ = np.zeros_like(near)
    at_once = max(1, AT_ONCE // max(1, len(near)))
    for some in (lamps[first : first + at_once] for first in range(0, len(lamps), at_once)):
        position = np.array([lamp.position for lamp in some]) - eye
        away = near - position[:, None].astype(np.float32)
        distance = np.maximum(np.linalg.norm(away, axis=2), NEAREST_LAMP_M)
        away /= distance[..., None]
        light = per_lx * intensity_towards(some, away) / distance**2
        if boosted:
            light *= forward_boost(-np.einsum("mni,ni->mn", away, seen))
        sum_ += light.T @ np.array([lamp.colour for lamp in some], np.float32)
    return sum_
