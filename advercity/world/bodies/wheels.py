"""Road wheels of cars, vans and trucks."""

import numpy as np

from advercity.semantics import Semantic
from advercity.world.shapes import Piece, loft, mirrored, turned_about_y, xyz

_SIDES = 14
_SPOKES = 7


def wheels(x_m: float, outer_y_m: float, radius_m: float, width_m: float) -> list[Piece]:
    """The two wheels of an axle; they stand on the ground, outer faces at `outer_y_m`."""
    centre = (x_m, outer_y_m, radius_m)
    radius = np.array([0.68, 0.93, 1.0, 1.0, 0.8]) * radius_m
    y = -np.array([0.03, 0.0, 0.14, 0.86, 1.0]) * width_m
    tyre = turned_about_y(np.column_stack([radius, y]), centre, sides=_SIDES)
    angle = np.pi * np.arange(2 * _SPOKES) / _SPOKES
    reach = np.where(np.arange(2 * _SPOKES) % 2, 0.46, 0.64) * radius_m
    star = np.column_stack([reach * np.cos(angle), np.zeros(len(angle)), reach * np.sin(angle)])
    face = loft(np.stack([star - xyz(0, 0.06 * width_m, 0), star + xyz(0, 0.01, 0)]) + centre)
    return [
        Piece(side, material, Semantic.VEHICLE)
        for surface, material in ((tyre, "rubber"), (face, "metal"))
        for side in (surface, mirrored(surface))
    ]
