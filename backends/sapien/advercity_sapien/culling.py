"""Restricts a rasterised image to the bodies possibly visible; SAPIEN draws all it has.

On a CPU most of the time of a small image goes into vertices, and most of these are out of view.
The sun's shadow maps are here too: bodies casting shadows into view must be drawn.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import sapien
from numpy.typing import ArrayLike, NDArray

from advercity.geometry.arrays import Float64Array, FloatArray
from advercity.geometry.poses import Matrix
from advercity.physics.atmosphere import Atmosphere
from advercity.rendering.backend import CameraView
from advercity_sapien.shader_bindings import RenderBody

SHADOW_RANGE_M, SHADOW_TEXELS = 400.0, 2048
Cascades = tuple[tuple[float, float], ...]
SHADOW_CASCADES: Cascades = ((28.0, 20.0), (100.0, 84.0))
"""Half the width of each map of the sun's shadows, from fine to coarse, and the distance of its
middle ahead of the camera, metres: close surfaces need sharp shadows, distant ones any."""

LOOKUP_TEXELS = 6.0
"""Greatest distance of a shadow's look-up from its surface (`sunVisibility` in deferred.frag)."""

PixelRange = tuple[float, float]
"""Least and greatest size of a pixel at a body's distance, metres."""
ANY_PIXEL: PixelRange = (0.0, math.inf)


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

    def sweep(self, direction: Float64Array) -> "ConvexVolume":
        """Compute the volume swept by this one moving in a direction (3,) without end.

        Planes it does not leave stay bounds. So does the weighted sum of each of these with each
        other plane, parallel to the motion (Fourier-Motzkin elimination of the distance).
        """
        inward = self.normals @ direction
        stays, leaves = np.flatnonzero(inward >= 0.0), np.flatnonzero(inward < 0.0)
        first, second = (rows.ravel() for rows in np.meshgrid(stays, leaves))
        planes = np.column_stack([self.normals, self.offsets])
        sums = inward[first, None] * planes[second] - inward[second, None] * planes[first]
        swept = np.concatenate([planes[stays], sums])
        return ConvexVolume(swept[:, :3], swept[:, 3])

    def intersect(self, other: "ConvexVolume", *, margin_m: float) -> "ConvexVolume":
        """Compute the part of this volume in another, or less than a margin from it."""
        margin = margin_m * np.linalg.norm(other.normals, axis=1)
        return ConvexVolume(
            np.concatenate([self.normals, other.normals]),
            np.concatenate([self.offsets, other.offsets - margin]),
        )

    def may_intersect(self, centre: FloatArray, half: FloatArray) -> NDArray[np.bool_]:
        """Test boxes (n,) along the world's axes; may say yes wrongly, but never no."""
        farthest = centre @ self.normals.T + half @ np.abs(self.normals).T
        return np.all(farthest >= self.offsets, axis=1, keepdims=True)[:, 0]


@dataclass(frozen=True)
class PixelRect:
    """Part of an image, pixels from its left and upper edges."""

    left_px: int
    top_px: int
    width_px: int
    height_px: int


def compute_view_frustum(view: CameraView, part: PixelRect | None = None) -> ConvexVolume:
    """Compute the volume seen by a camera or a part of its image, without near and far planes."""
    part = part or PixelRect(0, 0, view.width_px, view.height_px)
    focal_px = view.width_px / (2.0 * np.tan(view.horizontal_fov_rad / 2.0))
    left = 0.5 * view.width_px - part.left_px
    up = 0.5 * view.height_px - part.top_px
    right, down = part.width_px - left, part.height_px - up
    normals = np.array(
        [[right, focal_px, 0], [left, -focal_px, 0], [down, 0, focal_px], [up, 0, -focal_px]]
    )
    return ConvexVolume.from_body_planes(view.world_from_camera, normals)


class FrustumCuller:
    """Switches bodies of a scene on and off by their bounding boxes and their levels of detail."""

    def __init__(self) -> None:
        self._numbers: dict[RenderBody, int] = {}
        self._bodies: list[RenderBody | Callable[[], RenderBody]] = []
        self._centre, self._half = np.empty((0, 3)), np.empty((0, 3))
        self._pixel_m = np.empty((0, 2))
        self._shown = np.empty(0, dtype=bool)

    def add_body(
        self,
        body: RenderBody,
        low: FloatArray,
        high: FloatArray,
        *,
        pixel_m: PixelRange = ANY_PIXEL,
    ) -> None:
        """Add a shown body whose bounding box has two corners (3,) in the world.

        Cameras see it if the size of a pixel at the box is in the range of `pixel_m`.
        """
        self._numbers[body] = len(self._bodies)
        self._add(body, low, high, pixel_m, shown=True)

    def add_later(
        self,
        make_body: Callable[[], RenderBody],
        low: FloatArray,
        high: FloatArray,
        *,
        pixel_m: PixelRange,
    ) -> None:
        """Add a body as in `add_body`, but make it when it first comes into view.

        Most finely detailed bodies are never near a camera, and take no memory then.
        """
        self._add(make_body, low, high, pixel_m, shown=False)

    def _add(
        self,
        body: RenderBody | Callable[[], RenderBody],
        low: FloatArray,
        high: FloatArray,
        pixel_m: PixelRange,
        *,
        shown: bool,
    ) -> None:
        self._bodies.append(body)
        self._centre = np.vstack([self._centre, (low + high) / 2.0])
        self._half = np.vstack([self._half, (high - low) / 2.0])
        self._pixel_m = np.vstack([self._pixel_m, pixel_m])
        self._shown = np.append(self._shown, shown)

    def remove_body(self, body: RenderBody) -> None:
        """Remove a body; the last takes its row."""
        row, last = self._numbers.pop(body), self._bodies.pop()
        if last is not body:
            self._bodies[row] = last
            if isinstance(last, RenderBody):
                self._numbers[last] = row
        for values in (self._centre, self._half, self._pixel_m, self._shown):
            values[row] = values[-1]
        self._centre, self._half = self._centre[:-1], self._half[:-1]
        self._pixel_m, self._shown = self._pixel_m[:-1], self._shown[:-1]

    def move_body(self, body: RenderBody, centre: ArrayLike) -> None:
        """Move the centre (3,) of a body's bounding box."""
        self._centre[self._numbers[body]] = centre

    def show_only(self, volumes: Sequence[ConvexVolume], view: CameraView) -> None:
        """Show the bodies possibly inside one of the volumes, and hide all others.

        Levels of detail are shown if they suit the view.
        """
        shown = np.any([part.may_intersect(self._centre, self._half) for part in volumes], axis=0)
        away = self._centre - view.world_from_camera[:3, 3]
        pixel_rad = 2.0 * np.tan(view.horizontal_fov_rad / 2.0) / view.width_px
        nearest_m = np.linalg.norm(np.maximum(np.abs(away) - self._half, 0.0), axis=1)
        pixel_m = pixel_rad * nearest_m
        shown &= (pixel_m >= self._pixel_m[:, 0]) & (pixel_m < self._pixel_m[:, 1])
        for number in np.flatnonzero(shown != self._shown).tolist():
            body = self._bodies[number]
            if not isinstance(body, RenderBody):
                body = self._bodies[number] = body()
                self._numbers[body] = number
            body.visibility = float(shown[number])
        self._shown = shown


class SunShadow:
    """Shadow maps following the camera; none without direct sun.

    Attributes:
        caster_volumes: Volume of possible casters of shadows into view, for each map.
    """

    def __init__(
        self,
        atmosphere: Atmosphere,
        scene: sapien.Scene,
        cascades: Cascades = SHADOW_CASCADES,
    ) -> None:
        self._cascades = cascades
        self._entities: list[sapien.Entity] = []
        self.caster_volumes: list[ConvexVolume] = []
        self.follow_sun(atmosphere)
        for half_m, _ in cascades if atmosphere.sun_lx > 0.0 else ():
            light = sapien.render.RenderDirectionalLightComponent()
            light.shadow = True
            light.shadow_near, light.shadow_far = 0.0, SHADOW_RANGE_M
            light.shadow_half_size = half_m
            light.shadow_map_size = SHADOW_TEXELS
            self._entities.append(sapien.Entity())
            self._entities[-1].add_component(light)
            scene.add_entity(self._entities[-1])

    def follow_sun(self, atmosphere: Atmosphere) -> None:
        """Turn the maps to the sun of an atmosphere."""
        self._world_from_light = _rotation_along(-atmosphere.sun_direction)

    def update(self, view: CameraView) -> None:
        """Move the maps into the view of a camera."""
        places = zip(self._entities, self._cascades, strict=False)
        self.caster_volumes = [self._place(entity, view, *cascade) for entity, cascade in places]

    def _place(
        self, entity: sapien.Entity, view: CameraView, half_m: float, ahead_m: float
    ) -> ConvexVolume:
        """Move a map, in whole texels to keep edges still, and find the casters into view."""
        camera = view.world_from_camera
        centre = self._world_from_light.T @ (camera[:3, 3] + ahead_m * camera[:3, 0])
        texel = 2.0 * half_m / SHADOW_TEXELS
        centre = np.round(centre / texel) * texel
        centre[0] -= SHADOW_RANGE_M / 2.0
        pose = np.eye(4)
        pose[:3, :3] = self._world_from_light
        pose[:3, 3] = self._world_from_light @ centre
        entity.set_pose(sapien.Pose(pose))
        # The light looks along x: from its plane to the map's range, and as wide as the map.
        normals = np.concatenate([np.eye(3), -np.eye(3)])
        offsets = -np.array([0.0, half_m, half_m, SHADOW_RANGE_M, half_m, half_m])
        seen = compute_view_frustum(view).sweep(-self._world_from_light[:, 0])
        box = ConvexVolume.from_body_planes(pose, normals, offsets)
        return box.intersect(seen, margin_m=LOOKUP_TEXELS * texel)


def _rotation_along(direction: Float64Array) -> Matrix:
    """Compute a rotation (3, 3) from the x axis to a unit direction (3,)."""
    # The roll about the direction decides where the map's texels lie, and so the edges of shadows.
    helper = np.array([0.0, 0.0, 1.0]) if abs(direction[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    left = np.cross(helper, direction)
    left /= np.linalg.norm(left)
    return np.stack([direction, left, np.cross(direction, left)], axis=1)
