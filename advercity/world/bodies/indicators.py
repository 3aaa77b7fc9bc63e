"""Glasses of indicators, left and right apart, since they blink apart."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from advercity.semantics import Semantic
from advercity.world.scene import Mesh
from advercity.world.shapes import Piece, box, meshes

AMBER = "lamp_amber"
SIDES = {1: f"{AMBER}_left", -1: f"{AMBER}_right"}
"""Materials of the glasses on the left (y > 0) and on the right."""
_HALF_M = np.array([0.05, 0.045, 0.035])
_INSET_M = 0.035
"""From the front of the glass that they are put into."""
_OUTER_SHARE = 0.75
"""Of how far out a glass reaches: where they are put."""
_LEAST_ASIDE_M = 0.09


def with_indicators(parts: Sequence[Mesh]) -> tuple[Mesh, ...]:
    """The parts of a vehicle with an indicator at each corner.

    Amber glass that is there already is told apart by its side; without any, small glasses are put
    at the outer ends of the white glass in front and of the red glass behind.
    """
    there = [part for part in parts if part.material == AMBER]
    rest = [part for part in parts if part.material != AMBER]
    if there:
        return (*rest, *(side for part in there for side in _split(part)))
    return (*rest, *meshes(list(_added(parts))))


def _split(part: Mesh) -> Iterator[Mesh]:
    """The triangles of each side, as meshes of their own."""
    middle = part.vertices[part.triangles][..., 1].mean(axis=1)
    for left, material in SIDES.items():
        own = part.triangles[(middle >= 0) == (left > 0)]
        if len(own):
            yield replace(part, name=f"{part.name}_{material}", triangles=own, material=material)


def _added(parts: Sequence[Mesh]) -> Iterator[Piece]:
    for glass, ahead in (("lamp_white", 1.0), ("lamp_red", -1.0)):
        corners = [
            part.vertices[np.unique(part.triangles)] for part in parts if part.material == glass
        ]
        if not corners:
            continue
        points = np.concatenate(corners).astype(np.float64)
        aside = np.abs(points[:, 1])
        outer = points[aside >= _OUTER_SHARE * aside.max()]
        x = (outer[:, 0] * ahead).max() * ahead
        y, z = np.abs(outer[np.abs(outer[:, 0] - x) < _HALF_M[0]][:, 1:]).mean(axis=0)
        place = np.array([x - ahead * _INSET_M, max(y, _LEAST_ASIDE_M), z])
        for left, material in SIDES.items():
            middle = place * (1, left, 1)
            yield Piece(box(middle - _HALF_M, middle + _HALF_M), material, Semantic.VEHICLE)
