"""Road wheels of cars, vans and trucks."""

from collections.abc import Sequence

import numpy as np

from advercity.semantics import Semantic
from advercity.world.assets.wavefront import Part
from advercity.world.scene import Wheel
from advercity.world.shapes import Floats, Piece, Surface, hoop, loft, mirrored, turned_about_y, xyz

_SIDES = 16
_SPOKES = 5
_AXLE_M = 0.3
"""Wheels that are this near along a body share an axle."""


def axle(
    x_m: float, outer_y_m: float, radius_m: float, width_m: float, *, steers: bool = False
) -> list[Piece]:
    """The two wheels of an axle; they stand on the ground, outer faces at `outer_y_m`.

    Those that steer turn about their own middles, the others about the middle of their axle.
    """
    left = _wheel(xyz(x_m, outer_y_m, radius_m), radius_m, width_m)
    middle_m = outer_y_m - width_m / 2 if steers else 0.0
    return [
        Piece(side, material, Semantic.VEHICLE, Wheel((x_m, sign * middle_m, radius_m), steers))
        for surface, material in left
        for side, sign in ((surface, 1.0), (mirrored(surface), -1.0))
    ]


def wheels_of(parts: Sequence[Part], *, steer: bool) -> dict[int, Wheel]:
    """The wheels of a model by their numbers: those in front may steer, others share axles."""
    hubs: dict[int, Floats] = {}
    for number in sorted({part.wheel for part in parts} - {0}):
        own = [part.vertices[np.unique(part.triangles)] for part in parts if part.wheel == number]
        points = np.concatenate(own)
        hubs[number] = (points.min(axis=0) + points.max(axis=0)) / 2
    foremost = max((hub[0] for hub in hubs.values()), default=0.0)
    wheels: dict[int, Wheel] = {}
    for number, (x, y, z) in hubs.items():
        if steer and x > foremost - _AXLE_M:
            wheels[number] = Wheel((float(x), float(y), float(z)), steers=True)
        else:
            near = (other for other in wheels.values() if abs(other.hub[0] - x) < _AXLE_M)
            wheels[number] = next(near, Wheel((float(x), 0.0, float(z))))
    return wheels


def _wheel(face: Floats, radius_m: float, width_m: float) -> list[tuple[Surface, str]]:
    """A left-hand wheel around the middle of its outer face: tyre, and rim with spokes."""
    radius = np.array([0.66, 0.93, 1.0, 1.0, 0.8]) * radius_m
    y = -np.array([0.10, 0.0, 0.14, 0.86, 1.0]) * width_m
    tyre = turned_about_y(np.column_stack([radius, y]), face, sides=_SIDES)
    ring = np.array([(0.70, -0.06), (0.62, -0.01), (0.60, -0.10)]) * (radius_m, width_m)
    rim = hoop(ring, face, sides=_SIDES)
    star = _star() * radius_m
    spokes = loft(np.stack([star - xyz(y=0.12 * width_m), star - xyz(y=0.02 * width_m)]) + face)
    return [(tyre, "rubber"), (rim, "metal"), (spokes, "metal")]


def _star() -> Floats:
    """Outline (3 spokes, 3) in the plane of a rim: two corners at each tip, one between."""
    middle = 2 * np.pi * np.arange(_SPOKES)[:, None] / _SPOKES
    angle = (middle + np.array([-0.17, 0.17, np.pi / _SPOKES])).ravel()
    reach = np.tile([0.62, 0.62, 0.22], _SPOKES)
    return np.column_stack([reach * np.cos(angle), np.zeros(len(angle)), reach * np.sin(angle)])
