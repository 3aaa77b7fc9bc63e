"""Umbrellas over the heads of those who hold them."""

import numpy as np

from advercity.world.bodies.skeleton import Build, Joint, sided
from advercity.world.shapes import Floats, Surface, loft, tube, xyz

_RIBS = 8
_RADIUS_M, _RISE_M, _CLEAR_M = 0.50, 0.17, 0.08
_THICK_M = 0.006


def umbrella(posture: Floats, build: Build, canopy_material: str) -> list[tuple[Surface, str]]:
    """Canopy and stick of an umbrella in the right hand, with their materials."""
    hand = posture[sided(Joint.HAND, -1)]
    above = posture[Joint.HEAD] + xyz(0.03, -0.06, 0.5 * build.head_m + _CLEAR_M + _RISE_M)
    along = (above - hand) / np.linalg.norm(above - hand)
    stick = tube([hand - 0.12 * along, above + 0.05 * along], 0.009, sides=5)
    return [(_canopy(above), canopy_material), (stick, "metal")]


def _canopy(top: Floats) -> Surface:
    """A closed shell over eight ribs, sagging between them."""
    angle = np.pi * np.arange(2 * _RIBS) / _RIBS
    sag = np.where(np.arange(2 * _RIBS) % 2, 0.93, 1.0)
    circle = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(2 * _RIBS)]) * sag[:, None]
    share = np.array([0.04, 0.4, 0.75, 1.0])
    outer = [top + r * _RADIUS_M * circle - xyz(z=_RISE_M * r**2) for r in share]
    inner = [ring * 1.0 - xyz(z=_THICK_M) for ring in outer[::-1]]
    return loft(np.stack([*outer, *inner]))
