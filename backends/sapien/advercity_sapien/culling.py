"""Leaves out of a rasterised picture the bodies that cannot show in it: SAPIEN draws all there are.

On a CPU most of a small picture goes into vertices, and most of those lie beside it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import sapien
from numpy.typing import ArrayLike, NDArray

from advercity.poses import Matrix
from advercity.rendering.backend import CameraView

Array = NDArray[np.floating[Any]]
Body = sapien.render.RenderBodyComponent


@dataclass(frozen=True, eq=False)
class Volume:
    """The convex part of the world where (k) planes have points (x, y, z) at normal . point >= d.

    Attributes:
        normals: (k, 3), world frame.
        offsets: (k,) d, metres times the normals' lengths.
    """

    normals: Array
    offsets: Array

    @staticmethod
    def of(world_from_body: Matrix, normals: Array, offsets: Array | float = 0.0) -> "Volume":
        """From planes in the axes of a body at (4, 4)."""
        turned = normals @ world_from_body[:3, :3].T
        return Volume(turned, offsets + turned @ world_from_body[:3, 3])

    def may_hold(self, centre: Array, half: Array) -> NDArray[np.bool_]:
        """Which boxes (n,) along the world's axes may reach into it: never says no wrongly."""
        farthest = centre @ self.normals.T + half @ np.abs(self.normals).T
        return np.all(farthest >= self.offsets, axis=1, keepdims=True)[:, 0]


def seen_by(view: CameraView) -> Volume:
    """What a camera may see."""
    aside = np.tan(view.horizontal_fov_rad / 2.0)
    above = aside * view.height_px / view.width_px
    normals = [[aside, 1, 0], [aside, -1, 0], [above, 0, 1], [above, 0, -1]]
    return Volume.of(view.world_from_camera, np.array(normals, dtype=np.float64))


class Culling:
    """The bodies of a scene, and which of them the next picture is drawn of."""

    def __init__(self) -> None:
        self._numbers: dict[Body, int] = {}
        self._bodies: list[Body] = []
        self._centre, self._half = np.empty((0, 3)), np.empty((0, 3))
        self._shown = np.empty(0, dtype=bool)

    def add(self, body: Body, low: Array, high: Array) -> None:
        """Take in a body, shown, in a box between two corners (3,) in the world."""
        self._numbers[body] = len(self._bodies)
        self._bodies.append(body)
        self._centre = np.vstack([self._centre, (low + high) / 2.0])
        self._half = np.vstack([self._half, (high - low) / 2.0])
        self._shown = np.append(self._shown, True)

    def move(self, body: Body, centre: ArrayLike) -> None:
        """Put the middle (3,) of a body's box elsewhere."""
        self._centre[self._numbers[body]] = centre

    def show(self, volumes: Sequence[Volume]) -> None:
        """Show what may reach into one of some parts of the world, and nothing else."""
        shown = np.any([part.may_hold(self._centre, self._half) for part in volumes], axis=0)
        for number in np.flatnonzero(shown != self._shown).tolist():
            self._bodies[number].visibility = float(shown[number])
        self._shown = shown
