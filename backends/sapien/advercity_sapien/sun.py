"""The sun as SAPIEN's directional light, for the raster pack's shadow map."""

import numpy as np
import sapien
from numpy.typing import NDArray

from advercity.poses import Matrix
from advercity.rendering.backend import CameraView
from advercity.weather.atmosphere import Atmosphere
from advercity_sapien.culling import Volume

HALF_SIZE_M, RANGE_M, TEXELS = 60.0, 400.0, 2048
AHEAD_M = 36.0
"""Of the camera, the middle of the shadow map: what is near it needs shadows most."""


class SunShadow:
    """A shadow map that follows the camera; nothing where there is no direct sun."""

    def __init__(self, atmosphere: Atmosphere, scene: sapien.Scene) -> None:
        self._entity: sapien.Entity | None = None
        self.casting: Volume | None = None
        """Where shadows that are seen may come from."""
        self._world_from_light = _looking_along(-atmosphere.sun_direction)
        if atmosphere.sun_lx > 0.0:
            light = sapien.render.RenderDirectionalLightComponent()
            light.shadow = True
            light.shadow_near, light.shadow_far = 0.0, RANGE_M
            light.shadow_half_size = HALF_SIZE_M
            light.shadow_map_size = TEXELS
            self._entity = sapien.Entity()
            self._entity.add_component(light)
            scene.add_entity(self._entity)

    def follow(self, view: CameraView) -> None:
        """Cover what a camera sees, in steps of whole texels so that edges do not crawl."""
        if self._entity is None:
            return
        camera = view.world_from_camera
        middle = self._world_from_light.T @ (camera[:3, 3] + AHEAD_M * camera[:3, 0])
        texel = 2.0 * HALF_SIZE_M / TEXELS
        middle = np.round(middle / texel) * texel
        middle[0] -= RANGE_M / 2.0
        pose = np.eye(4)
        pose[:3, :3] = self._world_from_light
        pose[:3, 3] = self._world_from_light @ middle
        self._entity.set_pose(sapien.Pose(pose))
        normals = np.concatenate([np.eye(3), -np.eye(3)])
        offsets = [0.0, -HALF_SIZE_M, -HALF_SIZE_M, -RANGE_M, -HALF_SIZE_M, -HALF_SIZE_M]
        self.casting = Volume.of(pose, normals, np.array(offsets))


def _looking_along(direction: NDArray[np.float64]) -> Matrix:
    """Rotation (3, 3) of a body whose x axis points along a unit direction."""
    aside = np.array([0.0, 0.0, 1.0]) if abs(direction[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    left = np.cross(aside, direction)
    left /= np.linalg.norm(left)
    return np.stack([direction, left, np.cross(direction, left)], axis=1)
