"""Leaves out of a rasterised picture the bodies that cannot show in it: SAPIEN draws all there are.

On a CPU most of a small picture goes into vertices, and most of those lie beside it.

The sun as SAPIEN's directional light, for the raster pack's shadow map.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import sapien
from numpy.typing import ArrayLike, NDArray

from advercity.geometry.arrays import FloatArray
from advercity.geometry.poses import Matrix
from advercity.physics.atmosphere import Atmosphere
from advercity.rendering.backend import CameraView

RenderBody = sapien.render.RenderBodyComponent


@dataclass(frozen=True, eq=False)
class ConvexVolume:
    """The convex part of the world where (k) planes have points (x, y, z) at normal . point >= d.

    Attributes:
        normals: (k, 3), world frame.
        offsets: (k,) d, metres times the normals' lengths.
    """

    normals: FloatArray
    offsets: FloatArray

    @staticmethod
    def from_body_planes(
        world_from_body: Matrix, normals: FloatArray, offsets: FloatArray | float = 0.0
    ) -> "ConvexVolume":
        """From planes in the axes of a body at (4, 4)."""
        turned = normals @ world_from_body[:3, :3].T
        return ConvexVolume(turned, offsets + turned @ world_from_body[:3, 3])

    def may_intersect(self, centre: FloatArray, half: FloatArray) -> NDArray[np.bool_]:
        """Which boxes (n,) along the world's axes may reach into it: never says no wrongly."""
        farthest = centre @ self.normals.T + half @ np.abs(self.normals).T
        return np.all(farthest >= self.offsets, axis=1, keepdims=True)[:, 0]


def compute_view_frustum(view: CameraView) -> ConvexVolume:
    """What a camera may see."""
    aside = np.tan(view.horizontal_fov_rad / 2.0)
    above = aside * view.height_px / view.width_px
    normals = [[aside, 1, 0], [aside, -1, 0], [above, 0, 1], [above, 0, -1]]
    return ConvexVolume.from_body_planes(
        view.world_from_camera, np.array(normals, dtype=np.float64)
    )


class FrustumCuller:
    """The bodies of a scene, and which of them the next picture is drawn of."""

    def __init__(self) -> None:
        self._numbers: dict[RenderBody, int] = {}
        self._bodies: list[RenderBody] = []
        self._centre, self._half = np.empty((0, 3)), np.empty((0, 3))
        self._shown = np.empty(0, dtype=bool)

    def add_body(self, body: RenderBody, low: FloatArray, high: FloatArray) -> None:
        """Take in a body, shown, in a box between two corners (3,) in the world."""
        self._numbers[body] = len(self._bodies)
        self._bodies.append(body)
        self._centre = np.vstack([self._centre, (low + high) / 2.0])
        self._half = np.vstack([self._half, (high - low) / 2.0])
        self._shown = np.append(self._shown, True)

    def move_body(self, body: RenderBody, centre: ArrayLike) -> None:
        """Put the middle (3,) of a body's box elsewhere."""
        self._centre[self._numbers[body]] = centre

    def show_only(self, volumes: Sequence[ConvexVolume]) -> None:
        """Show what may reach into one of some parts of the world, and nothing else."""
        shown = np.any([part.may_intersect(self._centre, self._half) for part in volumes], axis=0)
        for number in np.flatnonzero(shown != self._shown).tolist():
            self._bodies[number].visibility = float(shown[number])
        self._shown = shown


SHADOW_HALF_SIZE_M, SHADOW_RANGE_M, SHADOW_TEXELS = 60.0, 400.0, 2048
SHADOW_CENTRE_AHEAD_M = 36.0
"""Of the camera, the middle of the shadow map: what is near it needs shadows most."""


class SunShadow:
    """A shadow map that follows the camera; nothing where there is no direct sun."""

    def __init__(self, atmosphere: Atmosphere, scene: sapien.Scene) -> None:
        self._entity: sapien.Entity | None = None
        self.caster_volume: ConvexVolume | None = None
        """Where shadows that are seen may come from."""
        self._world_from_light = _rotation_along(-atmosphere.sun_direction)
        if atmosphere.sun_lx > 0.0:
            light = sapien.render.RenderDirectionalLightComponent()
            light.shadow = True
            light.shadow_near, light.shadow_far = 0.0, SHADOW_RANGE_M
            light.shadow_half_size = SHADOW_HALF_SIZE_M
            light.shadow_map_size = SHADOW_TEXELS
            self._entity = sapien.Entity()
            self._entity.add_component(light)
            scene.add_entity(self._entity)

    def update(self, view: CameraView) -> None:
        """Cover what a camera sees, in steps of whole texels so that edges do not crawl."""
        if self._entity is None:
            return
        camera = view.world_from_camera
        middle = self._world_from_light.T @ (camera[:3, 3] + SHADOW_CENTRE_AHEAD_M * camera[:3, 0])
        texel = 2.0 * SHADOW_HALF_SIZE_M / SHADOW_TEXELS
        middle = np.round(middle / texel) * texel
        middle[0] -= SHADOW_RANGE_M / 2.0
        pose = np.eye(4)
        pose[:3, :3] = self._world_from_light
        pose[:3, 3] = self._world_from_light @ middle
        self._entity.set_pose(sapien.Pose(pose))
        normals = np.concatenate([np.eye(3), -np.eye(3)])
        offsets = [
            0.0,
            -SHADOW_HALF_SIZE_M,
            -SHADOW_HALF_SIZE_M,
            -SHADOW_RANGE_M,
            -SHADOW_HALF_SIZE_M,
            -SHADOW_HALF_SIZE_M,
        ]
        self.caster_volume = ConvexVolume.from_body_planes(pose, normals, np.array(offsets))


def _rotation_along(direction: NDArray[np.float64]) -> Matrix:
    """Rotation (3, 3) of a body whose x axis points along a unit direction."""
    aside = np.array([0.0, 0.0, 1.0]) if abs(direction[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    left = np.cross(aside, direction)
    left /= np.linalg.norm(left)
    return np.stack([direction, left, np.cross(direction, left)], axis=1)
