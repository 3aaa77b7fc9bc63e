"""Builds details of pitched roofs: gutters, dormers and chimneys.

Axes are the building's, with the ridge along x; walls are half the size (x, y).
"""

from collections.abc import Sequence

import numpy as np

from advercity.geometry.mesh import TriangleSurface, join_surfaces
from advercity.geometry.primitives import box, rectangles

ROOF_SLOPE = 0.75
"""Rise over run of houses and town blocks."""
ROOF_THICKNESS_M = 0.22
_GUTTER_M = 0.11
_DORMER_HALF_M, _DORMER_RISE_M = 0.75, 1.25
_DORMER_AT = 0.72
"""Distance of a dormer's face from the ridge, as a fraction of the wall's distance."""

Surfaces = list[tuple[TriangleSurface, str]]


def build_gutters(
    x: float, y: float, eaves: float, overhang: float, slope: float = ROOF_SLOPE
) -> TriangleSurface:
    """Build a gutter along both eaves."""
    edge, z = y + overhang, eaves - slope * overhang
    low, high = (-x - overhang, -_GUTTER_M, z), (x + overhang, 0.0, z + _GUTTER_M)
    front = box(np.add(low, (0, -edge, 0)), np.add(high, (0, -edge, 0)))
    back = box(np.add(low, (0, edge + _GUTTER_M, 0)), np.add(high, (0, edge + _GUTTER_M, 0)))
    return join_surfaces([front, back])


def build_chimneys(places: Sequence[float], ridge: float) -> TriangleSurface:
    """Build chimneys at distances along the ridge, with a cap each."""
    stacks = [box((at - 0.35, 0.4, ridge - 1.4), (at + 0.35, 1.1, ridge + 0.8)) for at in places]
    caps = [box((at - 0.42, 0.33, ridge + 0.8), (at + 0.42, 1.17, ridge + 0.92)) for at in places]
    return join_surfaces([*stacks, *caps])


def build_dormers(
    places: Sequence[float], y: float, eaves: float, wall: str, roof: str, trim: str
) -> Surfaces:
    """Build dormers with a window towards -y, at distances along the ridge."""
    face = -_DORMER_AT * y
    foot = eaves + ROOF_SLOPE * (y + face) + ROOF_THICKNESS_M
    top, deep = foot + _DORMER_RISE_M, _DORMER_RISE_M / ROOF_SLOPE + 0.3
    half = _DORMER_HALF_M
    walls = [box((at - half, face, foot - 0.2), (at + half, face + deep, top)) for at in places]
    lids = [
        box((at - half - 0.15, face - 0.25, top), (at + half + 0.15, face + deep, top + 0.12))
        for at in places
    ]
    middles = np.array([(at, face, foot + 0.62) for at in places])
    frames = rectangles(middles - (0, 0.01, 0), (0.55, 0, 0), (0, 0, 0.5))
    aside = np.array([0.25, 0.0, 0.0])
    panes = [
        rectangles(middles - (0, 0.02, 0) + side * aside, (0.22, 0, 0), (0, 0, 0.43))
        for side in (-1, 1)
    ]
    return [
        (join_surfaces(walls), wall),
        (join_surfaces(lids), roof),
        (frames, trim),
        (join_surfaces(panes), "glass"),
    ]
