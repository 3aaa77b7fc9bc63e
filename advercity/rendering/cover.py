"""Cover from above: decks of bridges keep rain and snow off everything below them."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from advercity.geometry.arrays import FloatArray
from advercity.geometry.mesh import Mesh
from advercity.rendering.embree import EmbreeMesh, EmbreeScene
from advercity.semantics import Semantic

CLEARANCE_M = 0.05
"""Height over a point where the search for cover begins: a deck must not cover its own top."""
MAX_HEIGHT_M = 100.0
"""Height of cover over a point; rain blown under it by wind is left out."""


class Cover:
    """Surfaces keeping precipitation off the ground of a world."""

    def __init__(self, decks: Sequence[Mesh]) -> None:
        self._scene = EmbreeScene([EmbreeMesh(decks)], np.eye(4)[None])
        self._low = np.min([mesh.vertices.min(axis=0) for mesh in decks], axis=0)
        self._high = np.max([mesh.vertices.max(axis=0) for mesh in decks], axis=0)

    @staticmethod
    def from_meshes(meshes: Sequence[Mesh]) -> "Cover | None":
        """Build the cover by the static meshes of a world; None if there is none."""
        decks = select_decks(meshes)
        return Cover(decks) if decks else None

    def find_covered(self, points: FloatArray) -> NDArray[np.bool_]:
        """Find which points (n, 3) of the world are under cover."""
        near = (points[:, :2] >= self._low[:2]) & (points[:, :2] <= self._high[:2])
        rows = np.flatnonzero(near.all(axis=1) & (points[:, 2] < self._high[2]))
        covered = np.zeros(len(points), np.bool_)
        if len(rows):
            origins = (points[rows] + [0.0, 0.0, CLEARANCE_M]).astype(np.float32)
            up = np.tile(np.array([0.0, 0.0, 1.0], np.float32), (len(rows), 1))
            covered[rows] = self._scene.cast(origins, up, MAX_HEIGHT_M).triangle >= 0
        return covered


def select_decks(meshes: Sequence[Mesh]) -> list[Mesh]:
    """Select the meshes covering the ground below them."""
    return [mesh for mesh in meshes if mesh.semantic is Semantic.BRIDGE]
