"""Meshes in Embree's hands: the static world, and every body that may move on it.

Embree works in float32: hits are good to a tenth of a millimetre within a kilometre of the
origin.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from advercity.world.scene import Mesh

Floats = NDArray[np.floating[Any]]
Rows = NDArray[np.intp]

APART_M = 1.0
"""Air between bodies that stand side by side."""


class Shapes:
    """Groups of meshes, each in a frame of its own, that rays are cast at in one call.

    Groups stand side by side in one scene of Embree's. Rays must end before they reach the next.

    Args:
        groups: The meshes of each of k groups; empty groups are never met.
        first: Number of the first of their triangles.

    Attributes:
        low: (k, 3) float64 lower corner of each group's box in its frame, metres.
        high: (k, 3) upper corner.
    """

    def __init__(self, groups: Sequence[Sequence[Mesh]], first: int = 0) -> None:
        self._first = np.int32(first)
        boxes = [_box(group) for group in groups]
        self.low = np.array([low for low, _ in boxes]).reshape(-1, 3)
        self.high = np.array([high for _, high in boxes]).reshape(-1, 3)
        self._shift = self._shelves().astype(np.float32)
        self._scene = _scene_of(groups, self._shift)

    def run(
        self, group: Rows | int, origins: Floats, directions: Floats, limits: Floats
    ) -> tuple[NDArray[np.int32], Floats]:
        """Triangle (n,), -1 for none, and range (n,) float32 of the nearest hit of each ray.

        Args:
            group: (n,) that a ray is cast at, or the one that all are cast at.
            origins: (n, 3) float32 in the frame of that group.
            directions: (n, 3) float32.
            limits: (n,) float32 lengths of the rays, metres; kept.
        """
        if self._scene is None or not len(origins):
            return np.full(len(origins), -1, np.int32), limits
        if len(self._shift) > 1:
            origins = origins + self._shift.take(group, axis=0)
        # Embree writes what it found over the limits.
        found: dict[str, NDArray[Any]] = self._scene.run(
            origins, directions, limits.copy(), output=True
        )
        triangle = found["primID"]
        if self._first:
            triangle += self._first * (triangle >= 0)
        return triangle, found["tfar"]

    def _shelves(self) -> NDArray[np.float64]:
        """By how much (k, 3) each group is moved: to a place in a cube of boxes of one size."""
        count = len(self.low)
        if count < 2:
            return np.zeros((count, 3))
        pitch = float(np.linalg.norm(self.high - self.low, axis=1).max()) + APART_M
        side = math.ceil(count ** (1.0 / 3.0))
        place = np.stack(np.unravel_index(np.arange(count), (side, side, side)), axis=1)
        return (place - (side - 1) / 2.0) * pitch - (self.low + self.high) / 2.0


def _box(group: Sequence[Mesh]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lower and upper corner (3,) of what a group's meshes hold."""
    held = [mesh.vertices for mesh in group if len(mesh.vertices)]
    if not held:
        return np.zeros(3), np.zeros(3)
    vertices = np.concatenate(held).astype(np.float64)
    return vertices.min(axis=0), vertices.max(axis=0)


def _scene_of(groups: Sequence[Sequence[Mesh]], shift: Floats) -> Any:
    """The scene of all triangles, group by group; None if there are none."""
    moved = [(mesh, by) for group, by in zip(groups, shift, strict=True) for mesh in group]
    if not sum(len(mesh.triangles) for mesh, _ in moved):
        return None
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh, _ in moved)]).astype(np.int32)
    vertices = np.concatenate([mesh.vertices + by for mesh, by in moved])
    triangles = np.concatenate(
        [mesh.triangles + start for (mesh, _), start in zip(moved, starts, strict=False)]
    )
    scene = EmbreeScene(robust=True)
    TriangleMesh(scene, vertices, triangles)
    return scene
