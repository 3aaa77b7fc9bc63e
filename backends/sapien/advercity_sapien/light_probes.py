"""Daylight at points of a grid: what walls, trees and roofs take of the sky, and what they reflect.

The raster pack has light of the open sky alone. Here rays from every probe into all directions find
the sky, or a surface with the sun's light and the sky's on it: occlusion and one bounce by day. The
shaders take the ratio of this light to that in the open, so that the open stays as it was.

Irradiance is linear in the normal: E(n) = (M0 + 2 n . M1) / 4, with the radiance's integral M0 and
its first moment M1 over all directions. It is exact for a uniform sky above a dark ground.
"""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from advercity.geometry.arrays import Float32Array, Float64Array
from advercity.geometry.directions import spread_directions
from advercity.materials import MATERIALS, TRANSMITTED_BY_LEAVES, Texture
from advercity.physics.atmosphere import Atmosphere
from advercity.physics.photometry import cubemap_directions, cubemap_solid_angles, luminance
from advercity.rendering.raycaster import MATERIAL_NAMES, Raycaster, RayHits, Rays
from advercity.semantics import Semantic
from advercity.world import World

PROBE_SPACING_M, MAX_PROBES_PER_EDGE = 3.0, 128
LEVEL_HEIGHTS_M = (0.3, 1.5, 3.5, 6.5, 11.0)
"""Heights of probes above the ground."""
MARGIN_M = 30.0
"""How far from the lanes there are probes."""
DIRECTION_COUNT = 48
MAX_RANGE_M = 200.0
RAY_OFFSET_M = 0.02
GROUND_CLASSES = (
    Semantic.ROAD,
    Semantic.ROAD_LINE,
    Semantic.SIDEWALK,
    Semantic.TERRAIN,
    Semantic.GROUND,
)
MAX_SURFACES_ABOVE_GROUND = 8
GROUND_CHANNEL = 3
_ALBEDO = np.array([MATERIALS[name].albedo for name in MATERIAL_NAMES])
_IS_LEAF = np.array([MATERIALS[name].texture is Texture.LEAVES for name in MATERIAL_NAMES])


@dataclass(frozen=True, eq=False)
class LightProbes:
    """Light at probes relative to the open.

    Attributes:
        light: (levels h, w, 4) float32, level upon level: ratio of M0 to that in the open by
            colour, then the height of the ground in metres.
        direction: (levels h, w, 4) float32: M1 / M0 in luminance, then 1.
        corner: South-western corner (x, y) of the grid, metres.
        size: Width and height, metres.
        open_direction: M1 / M0 (3,) in the open.
    """

    light: Float32Array
    direction: Float32Array
    corner: tuple[float, float]
    size: tuple[float, float]
    open_direction: Float64Array

    @property
    def ground(self) -> Float32Array:
        """Height (h, w) of the ground in metres."""
        return self.light[: len(self.light) // len(LEVEL_HEIGHTS_M), :, GROUND_CHANNEL]

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Corner and inverse size, by which shaders find a point on the grid."""
        width, height = self.size
        return (*self.corner, 1.0 / width if width else 0.0, 1.0 / height if height else 0.0)


_ONE_PROBE = np.ones((len(LEVEL_HEIGHTS_M), 1, 4), np.float32)
NO_PROBES = LightProbes(_ONE_PROBE, _ONE_PROBE, (0.0, 0.0), (0.0, 0.0), np.zeros(3))


def bake_light_probes(world: World, atmosphere: Atmosphere) -> LightProbes:
    """Bake the probes of a world by day and at dusk; in the dark they change nothing."""
    if atmosphere.is_dark or not world.lanes:
        return NO_PROBES
    raycaster = Raycaster(world)
    grid = _place_grid(world)
    ground = _find_ground(raycaster, grid)
    directions = spread_directions(DIRECTION_COUNT)
    sky = _average_sky(atmosphere, directions)
    open_mean = sky.sum(axis=0)
    texels = np.ones((len(LEVEL_HEIGHTS_M), grid.rows, grid.columns, 8), dtype=np.float32)
    for layer, height in zip(texels, LEVEL_HEIGHTS_M, strict=True):
        origins = grid.list_points(ground + height)
        mean, moment, sees_sky = _gather_light(raycaster, atmosphere, origins, directions, sky)
        layer[..., :3] = grid.shape(mean / open_mean)
        layer[..., 3] = ground
        layer[..., 4:7] = grid.shape(moment / luminance(mean)[:, None])
        _spread_light(layer, grid.shape(~sees_sky))
    # OpenBLAS would sum in another order for every number of threads.
    moment = np.einsum("n,nj->j", luminance(sky), directions)
    halves = np.split(texels.reshape(-1, grid.columns, 8), 2, axis=-1)
    light, direction = map(np.ascontiguousarray, halves)
    return LightProbes(light, direction, grid.corner, grid.size, moment / luminance(open_mean))


@dataclass(frozen=True)
class _Grid:
    corner: tuple[float, float]
    spacing_m: float
    rows: int
    columns: int

    @property
    def size(self) -> tuple[float, float]:
        """Width and height, metres."""
        return self.columns * self.spacing_m, self.rows * self.spacing_m

    def list_points(self, heights: Float64Array) -> Float32Array:
        """List the points (n, 3) in the middle of cells, at heights (rows, columns)."""
        x = self.corner[0] + (np.arange(self.columns) + 0.5) * self.spacing_m
        y = self.corner[1] + (np.arange(self.rows) + 0.5) * self.spacing_m
        points = np.stack([*np.meshgrid(x, y), heights], axis=-1)
        return points.reshape(-1, 3).astype(np.float32)

    def shape(self, values: NDArray[Any]) -> NDArray[Any]:
        """Shape values (n, ...) as (rows, columns, ...)."""
        return values.reshape(self.rows, self.columns, *values.shape[1:])


def _place_grid(world: World) -> _Grid:
    """Place the grid around the lanes."""
    points = np.concatenate([lane.left[:, :2] for lane in world.lanes])
    low, high = points.min(axis=0) - MARGIN_M, points.max(axis=0) + MARGIN_M
    spacing = max(PROBE_SPACING_M, float((high - low).max()) / MAX_PROBES_PER_EDGE)
    columns, rows = (int(count) for count in np.ceil((high - low) / spacing))
    return _Grid((float(low[0]), float(low[1])), spacing, rows, columns)


def _find_ground(raycaster: Raycaster, grid: _Grid) -> Float64Array:
    """Find the height (rows, columns) of the ground, below trees and roofs."""
    top = 500.0
    origins = grid.list_points(np.full((grid.rows, grid.columns), top))
    ground = np.full(len(origins), np.nan)
    for _ in range(MAX_SURFACES_ABOVE_GROUND):
        pending = np.flatnonzero(np.isnan(ground))
        down = np.broadcast_to(np.array([0.0, 0.0, -1.0], np.float32), (len(pending), 3))
        hits = raycaster.cast(Rays(origins[pending], down), 2.0 * top)
        height = origins[pending, 2] - hits.range_m
        is_ground = np.isin(hits.semantic, GROUND_CLASSES) & np.isfinite(hits.range_m)
        ground[pending[is_ground]] = height[is_ground]
        origins[pending, 2] = height - RAY_OFFSET_M
    return grid.shape(np.where(np.isnan(ground), np.nanmedian(ground), ground))


def _average_sky(atmosphere: Atmosphere, directions: Float64Array) -> Float64Array:
    """Average the sky and the open ground over the cell of each direction: (k, 3) in cd/m²."""
    size = atmosphere.sky.shape[1]
    step = max(size // 64, 1)
    texels = cubemap_directions(size)[:, ::step, ::step].reshape(-1, 3)
    light = atmosphere.sky[:, ::step, ::step].reshape(-1, 3).astype(np.float64)
    weight = np.tile(cubemap_solid_angles(size)[::step, ::step].ravel(), 6)
    cell = np.argmax(texels @ directions.T, axis=1)
    total = [np.bincount(cell, weight * channel, len(directions)) for channel in light.T]
    return np.stack(total, axis=1) / np.bincount(cell, weight, len(directions))[:, None]


def _gather_light(
    raycaster: Raycaster,
    atmosphere: Atmosphere,
    origins: Float32Array,
    directions: Float64Array,
    sky: Float64Array,
) -> tuple[Float64Array, Float64Array, NDArray[np.bool_]]:
    """Sum radiance at points (n, 3) over all directions.

    Returns:
        Sum (n, 3), its first moment's luminance (n, 3), and which points see the sky (n,).
    """
    mean, moment = np.zeros((len(origins), 3)), np.zeros((len(origins), 3))
    sees_sky = np.zeros(len(origins), dtype=bool)
    for direction, from_sky in zip(directions, sky, strict=True):
        rays = Rays(origins, np.broadcast_to(direction.astype(np.float32), origins.shape))
        hits = raycaster.cast(rays, MAX_RANGE_M)
        radiance = _compute_radiance(raycaster, atmosphere, rays, hits, sky)
        is_free = ~np.isfinite(hits.range_m)
        radiance[is_free] = from_sky
        sees_sky |= is_free & (direction[2] > 0.0)
        mean += radiance
        moment += luminance(radiance)[:, None] * direction
    return mean, moment, sees_sky


def _compute_radiance(
    raycaster: Raycaster, atmosphere: Atmosphere, rays: Rays, hits: RayHits, sky: Float64Array
) -> Float64Array:
    """Compute the light (n, 3) in cd/m² of what rays hit, lit by the sun and an open sky."""
    cosine = hits.normal @ atmosphere.sun_direction
    is_leaf = _IS_LEAF[hits.material]
    cosine = np.where(is_leaf & (cosine < 0.0), -TRANSMITTED_BY_LEAVES * cosine, cosine)
    sunlit = np.flatnonzero(np.isfinite(hits.range_m) & (cosine > 0.0) & (atmosphere.sun_lx > 0.0))
    points = rays.origins[sunlit] + rays.directions[sunlit] * hits.range_m[sunlit, None]
    points = points + hits.normal[sunlit] * RAY_OFFSET_M
    sun = np.broadcast_to(atmosphere.sun_direction.astype(np.float32), points.shape)
    shadowed = np.isfinite(
        raycaster.cast(Rays(points.astype(np.float32), sun), MAX_RANGE_M).range_m
    )
    sun_lx = np.zeros(len(hits.range_m))
    sun_lx[sunlit] = np.where(shadowed, 0.0, atmosphere.sun_lx * cosine[sunlit])
    # Directions go from the zenith down.
    above, below = (np.pi * half.mean(axis=0) for half in np.split(sky, 2))
    upward = (1.0 + hits.normal[:, 2:]) / 2.0
    ambient = above * upward + below * (1.0 - upward)
    lit = sun_lx[:, None] * np.array(atmosphere.sun_colour) + ambient
    return _ALBEDO[hits.material] * lit / np.pi


def _spread_light(layer: Float32Array, is_buried: NDArray[np.bool_]) -> None:
    """Smooth the light of a level, which few directions make uneven.

    Probes inside things, which see no sky, first get the light of the nearest outside.
    """
    light = np.delete(layer, GROUND_CHANNEL, axis=-1)
    if is_buried.any() and not is_buried.all():
        _, label = cv2.distanceTransformWithLabels(
            is_buried.astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
        )
        label = label.astype(np.int64)
        source = np.empty(int(label.max()) + 1, dtype=np.int64)
        source[label[~is_buried]] = np.flatnonzero(~is_buried)
        light[is_buried] = light.reshape(-1, light.shape[-1])[source[label[is_buried]]]
    for number, channel in zip((0, 1, 2, 4, 5, 6), (0, 1, 2, 3, 4, 5), strict=True):
        layer[..., number] = cv2.GaussianBlur(light[..., channel], (3, 3), 0.0)
