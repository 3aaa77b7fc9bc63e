"""Restricts a rasterised image to the bodies that can show in it; SAPIEN draws all it has.

On a CPU most of the time of a small image goes into vertices, and most of those are out of view.
The sun's shadow map is here too, as bodies that cast shadows into view have to be drawn.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import sapien
from numpy.typing import ArrayLike, NDArray

from advercity.geometry.arrays import Float64Array, FloatArray
from advercity.geometry.poses import Matrix
from advercity.physics.atmosphere import Atmosphere
from advercity.rendering.backend import CameraView
from advercity_sapien.shader_bindings import RenderBody

SHADOW_HALF_SIZE_M, SHADOW_RANGE_M, SHADOW_TEXELS = 60.0, 400.0, 2048
SHADOW_CENTRE_AHEAD_M = 36.0
"""Distance from the camera to the shadow map's centre: close surfaces need shadows most."""


@dataclass(frozen=True, eq=False)
class ConvexVolume:
    """Points (x, y, z) of the world with normal . point >= d for each of k planes.

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
        """Transform planes from the axes of a body at (4, 4) to the world."""
        rotated = normals @ world_from_body[:3, :3].T
        return ConvexVolume(rotated, offsets + rotated @ world_from_body[:3, 3])

    def may_intersect(self, centre: FloatArray, half: FloatArray) -> NDArray[np.bool_]:
        """Test boxes (n,) along the world's axes; may say yes wrongly, but never no."""
        farthest = centre @ self.normals.T + half @ np.abs(self.normals).T
        return np.all(farthest >= self.offsets, axis=1, keepdims=True)[:, 0]


def compute_view_frustum(view: CameraView) -> ConvexVolume:
    """Compute the volume that a camera sees, without near and far planes."""
    wide = np.tan(view.horizontal_fov_rad / 2.0)
    high = wide * view.height_px / view.width_px
    normals = np.array([[wide, 1, 0], [wide, -1, 0], [high, 0, 1], [high, 0, -1]])
    return ConvexVolume.from_body_planes(view.world_from_camera, normals)


class FrustumCuller:
    """Switches bodies of a scene on and off by their bounding boxes."""

    def __init__(self) -> None:
        self._numbers: dict[RenderBody, int] = {}
        self._bodies: list[RenderBody] = []
        self._centre, self._half = np.empty((0, 3)), np.empty((0, 3))
        self._shown = np.empty(0, dtype=bool)
        self._distances_m = np.empty((0, 2))

    def add_body(
        self,
        body: RenderBody,
        low: FloatArray,
        high: FloatArray,
        distances_m: tuple[float, float] = (0.0, np.inf),
    ) -> None:
        """Add a shown body whose bounding box has two corners (3,) in the world.

        Cameras see it if the box's centre is within the two distances of them.
        """
        self._numbers[body] = len(self._bodies)
        self._bodies.append(body)
        self._centre = np.vstack([self._centre, (low + high) / 2.0])
        self._half = np.vstack([self._half, (high - low) / 2.0])
        self._shown = np.append(self._shown, True)
        self._distances_m = np.vstack([self._distances_m, distances_m])

    def move_body(self, body: RenderBody, centre: ArrayLike) -> None:
        """Move the centre (3,) of a body's bounding box."""
        self._centre[self._numbers[body]] = centre

    def show_only(self, volumes: Sequence[ConvexVolume], eye: FloatArray) -> None:
        """Show the bodies that may intersect one of the volumes, and hide all others.

        `eye` (3,) is where distances are from.
        """
        shown = np.any([part.may_intersect(self._centre, self._half) for part in volumes], axis=0)
        away_m = np.linalg.norm(self._centre - eye, axis=1)
        shown &= (away_m >= self._distances_m[:, 0]) & (away_m < self._distances_m[:, 1])
        for number in np.flatnonzero(shown != self._shown).tolist():
            self._bodies[number].visibility = float(shown[number])
        self._shown = shown


class SunShadow:
    """A shadow map that follows the camera; none where there is no direct sun.

    Attributes:
        caster_volume: Volume of all bodies whose shadows the map may hold; None without a map.
    """

    def __init__(self, atmosphere: Atmosphere, scene: sapien.Scene) -> None:
        self._entity: sapien.Entity | None = None
        self.caster_volume: ConvexVolume | None = None
        self.follow_sun(atmosphere)
        if atmosphere.sun_lx > 0.0:
            light = sapien.render.RenderDirectionalLightComponent()
            light.shadow = True
            light.shadow_near, light.shadow_far = 0.0, SHADOW_RANGE_M
            light.shadow_half_size = SHADOW_HALF_SIZE_M
            light.shadow_map_size = SHADOW_TEXELS
            self._entity = sapien.Entity()
            self._entity.add_component(light)
            scene.add_entity(self._entity)

    def follow_sun(self, atmosphere: Atmosphere) -> None:
        """Turn the map to the sun of an atmosphere."""
        self._world_from_light = _rotation_along(-atmosphere.sun_direction)

    def update(self, view: CameraView) -> None:
        """Move the map to what a camera sees, in whole texels so that edges do not crawl."""
        if self._entity is None:
            return
        camera = view.world_from_camera
        centre = self._world_from_light.T @ (camera[:3, 3] + SHADOW_CENTRE_AHEAD_M * camera[:3, 0])
        texel = 2.0 * SHADOW_HALF_SIZE_M / SHADOW_TEXELS
        centre = np.round(centre / texel) * texel
        centre[0] -= SHADOW_RANGE_M / 2.0
        pose = np.eye(4)
        pose[:3, :3] = self._world_from_light
        pose[:3, 3] = self._world_from_light @ centre
        self._entity.set_pose(sapien.Pose(pose))
        # The light looks along x: from its plane to the map's range, and as wide as the map.
        half, far = SHADOW_HALF_SIZE_M, SHADOW_RANGE_M
        normals = np.concatenate([np.eye(3), -np.eye(3)])
        offsets = np.array([0.0, -half, -half, -far, -half, -half])
        self.caster_volume = ConvexVolume.from_body_planes(pose, normals, offsets)


def _rotation_along(direction: Float64Array) -> Matrix:
    """Compute a rotation (3, 3) that takes the x axis to a unit direction (3,)."""
    # The roll about the direction decides where the map's texels lie, and so the edges of shadows.
    helper = np.array([0.0, 0.0, 1.0]) if abs(direction[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    left = np.cross(helper, direction)
    left /= np.linalg.norm(left)
    return np.stack([direction, left, np.cross(direction, left)], axis=1)
