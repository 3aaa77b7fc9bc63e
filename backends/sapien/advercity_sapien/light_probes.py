"""Daylight at points of a grid: the sky hidden by walls, trees and roofs, and their reflections.

The raster pack has light of the open sky alone. Here rays from every probe into all directions find
the sky, or a surface with the sun's light, and the air before it. Further passes add the
reflections of the light found by the probes next to surfaces in the pass before. The shaders
take the ratio of this light to the open's, so the open stays as it was.

Few directions would miss or hit small bright things all along a wall. So the four probes of a
square look into directions turned against each other; smoothing takes as much of each.

Light is kept as moments of the radiance over all directions: the integral of each colour, and of
luminance times the polynomials of the spherical harmonics of first and second order. Irradiance
follows from them within some per cent (Ramamoorthi and Hanrahan 2001). With the first order alone
walls would have too much light from their sides: 6 % in all in a town.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from advercity.geometry.arrays import Float32Array, Float64Array, FloatArray
from advercity.geometry.directions import spread_directions
from advercity.geometry.poses import rotation_matrix
from advercity.materials import MATERIALS, TRANSMITTED_BY_LEAVES, Texture
from advercity.physics.atmosphere import Atmosphere
from advercity.physics.photometry import cubemap_directions, cubemap_solid_angles, luminance
from advercity.rendering.raycaster import MATERIAL_NAMES, Raycaster, RayHits, Rays
from advercity.rendering.surface_weather import compute_surface_weather
from advercity.world import World
from advercity_sapien.probe_grid import LEVEL_HEIGHTS_M, RAY_OFFSET_M, ProbeGrid, place_grid
from advercity_sapien.skylines import NO_SKYLINES, SKYLINE_LEVEL, Skylines, bake_skylines
from advercity_sapien.weathered_albedo import WeatheredAlbedo

AWAY_M = 1.0
"""How far before a surface its light is looked up, so probes behind it count little."""
DARKEST = 0.05
"""Least irradiance relative to the mean over all directions: few harmonics may make it negative."""
DIRECTION_COUNT, TURNS = 48, 4
"""Directions into which a probe looks; sets of them, each turned against the others."""
MAX_RANGE_M = 200.0
FURTHER_REFLECTIONS = 2
"""Reflections of skylight, and of sunlight after its first; the third has 1 % left in a town."""
GROUND_CHANNEL = 3
MOMENTS = 11
"""Numbers of the light at a probe: integrals of radiance by colour, then of luminance times the
polynomials of `_evaluate_polynomials`."""
IRRADIANCE_FACTORS = np.array([2.0] * 3 + [5.0 / 16.0] + [15.0 / 4.0] * 3 + [15.0 / 16.0])
"""Factors of the last moments, relative to the integral, on irradiance relative to its mean."""
_IS_LEAF = np.array([MATERIALS[name].texture is Texture.LEAVES for name in MATERIAL_NAMES])


@dataclass(frozen=True, eq=False)
class LightProbes:
    """Light at probes relative to the open.

    Attributes:
        light: (levels h, w, 4) float32, level upon level: ratio of the light of all directions to
                the light in the open by colour, then the height of the ground in metres.
            shape: Two of (levels h, w, 4) float32: directional moments relative to all light.
        corner: South-western corner (x, y) of the grid, metres.
        size: Width and height, metres.
        open_shape: The shape (8,) in the open.
        skylines: Obstacles before the sky around each probe.
    """

    light: Float32Array
    shape: tuple[Float32Array, Float32Array]
    corner: tuple[float, float]
    size: tuple[float, float]
    open_shape: Float64Array
    skylines: Skylines

    @property
    def ground(self) -> Float32Array:
        """Height (h, w) of the ground in metres."""
        return self.light[: len(self.light) // len(LEVEL_HEIGHTS_M), :, GROUND_CHANNEL]

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Corner and inverse size, for finding a point on the grid in shaders."""
        width, height = self.size
        return (*self.corner, 1.0 / width if width else 0.0, 1.0 / height if height else 0.0)


_ONE_PROBE = np.ones((len(LEVEL_HEIGHTS_M), 1, 4), np.float32)
NO_PROBES = LightProbes(
    _ONE_PROBE, (_ONE_PROBE, _ONE_PROBE), (0.0, 0.0), (0.0, 0.0), np.zeros(MOMENTS - 3), NO_SKYLINES
)


def bake_light_probes(world: World, atmosphere: Atmosphere) -> LightProbes:
    """Bake the probes of a world by day and at dusk; in the dark they have no effect."""
    if atmosphere.is_dark or not world.lanes:
        return NO_PROBES
    raycaster = Raycaster(world)
    grid = place_grid(world)
    around = _Surroundings.from_atmosphere(atmosphere)
    levels = [_gather_light(raycaster, grid, height, around) for height in LEVEL_HEIGHTS_M]
    found = np.stack([grid.smooth(level.moments, level.is_buried) for level in levels])
    for _ in range(FURTHER_REFLECTIONS):
        moments = [_add_reflections(grid, around, level, found) for level in levels]
        found = np.stack(
            [grid.smooth(m, level.is_buried) for m, level in zip(moments, levels, strict=True)]
        )
    in_the_open = around.compute_moments()
    sources = found.reshape(-1, MOMENTS)

    def shade(points: FloatArray, hits: RayHits) -> Float64Array:
        lux = _compute_sunlight(raycaster, atmosphere, points, hits)
        source = grid.find_nearest(points + AWAY_M * hits.normal)
        lux += compute_irradiance(sources[source], hits.normal.astype(np.float64))
        return around.albedo.look_up(hits.material, hits.normal[:, 2]) / np.pi * lux

    light = np.empty((*found.shape[:3], 4), np.float32)
    light[..., :3] = found[..., :3] / in_the_open[:3]
    light[..., GROUND_CHANNEL] = grid.ground
    shape = (found[..., 3:] / _compute_mean(found)[..., None]).astype(np.float32)
    first, second = (
        np.ascontiguousarray(half.reshape(-1, grid.columns, 4))
        for half in np.split(shape, 2, axis=-1)
    )
    return LightProbes(
        light.reshape(-1, grid.columns, 4),
        (first, second),
        grid.corner,
        grid.size,
        in_the_open[3:] / _compute_mean(in_the_open),
        bake_skylines(raycaster, grid, levels[SKYLINE_LEVEL].is_buried, shade),
    )


def compute_irradiance(moments: Float64Array, normal: FloatArray) -> Float64Array:
    """Compute the irradiance (n, 3) in lx on surfaces of normals (n, 3) by moments (n, MOMENTS)."""
    factors = IRRADIANCE_FACTORS * _evaluate_polynomials(normal)
    along = np.einsum("nk,nk->n", moments[:, 3:], factors)
    relative = np.maximum(1.0 + along / _compute_mean(moments), DARKEST)
    return moments[:, :3] * relative[:, None] / 4.0


def _compute_mean(moments: Float64Array) -> Float64Array:
    """Compute the luminance (...) of moments (..., MOMENTS) without direction, never quite 0."""
    return np.maximum(luminance(moments[..., :3]), 1e-9)


def _evaluate_polynomials(directions: FloatArray) -> Float64Array:
    """Evaluate the polynomials (n, 8) of harmonics along unit vectors (n, 3)."""
    x, y, z = directions.T.astype(np.float64)
    return np.stack([x, y, z, 3 * z * z - 1, x * y, y * z, z * x, x * x - y * y], axis=1)


def _compute_moments(radiance: Float64Array, directions: Float64Array) -> Float64Array:
    """Compute the moments (n, MOMENTS) of radiance (n, 3) around one direction (n, 3) of each."""
    along = luminance(radiance)[:, None] * _evaluate_polynomials(directions)
    return np.column_stack([radiance, along]) * (4.0 * np.pi / DIRECTION_COUNT)


@dataclass(frozen=True, eq=False)
class _Surroundings:
    """Light in the open, and the air.

    Attributes:
        atmosphere: Source of all of it.
        albedo: Albedo of surfaces in this weather.
        directions: (DIRECTION_COUNT, TURNS, 3) unit vectors.
        sky: (DIRECTION_COUNT, TURNS, 3) radiance of the sky and the open ground around each, cd/m².
        airlight: (DIRECTION_COUNT, TURNS, 4), as in `Atmosphere`.
    """

    atmosphere: Atmosphere
    albedo: WeatheredAlbedo
    directions: Float64Array
    sky: Float64Array
    airlight: Float64Array

    @classmethod
    def from_atmosphere(cls, atmosphere: Atmosphere) -> "_Surroundings":
        """Average the light around each direction."""
        turned = [
            spread_directions(DIRECTION_COUNT) @ rotation_matrix(yaw=yaw)[:3, :3].T
            for yaw in np.arange(TURNS) * (2.0 * np.pi / TURNS)
        ]
        sky, airlight = (
            np.stack([_average_around(directions, faces) for directions in turned], axis=1)
            for faces in (atmosphere.sky, atmosphere.airlight)
        )
        albedo = WeatheredAlbedo(compute_surface_weather(atmosphere))
        return cls(atmosphere, albedo, np.stack(turned, axis=1), sky, airlight)

    def compute_moments(self) -> Float64Array:
        """Compute the moments (MOMENTS,) of light in the open."""
        sky, directions = self.sky.reshape(-1, 3), self.directions.reshape(-1, 3)
        return _compute_moments(sky, directions).sum(axis=0) / TURNS


def _average_around(directions: Float64Array, faces: Float32Array) -> Float64Array:
    """Average a cubemap (6, n, n, c) over the texels nearest to each direction (k, 3): (k, c)."""
    size = faces.shape[1]
    step = max(size // 64, 1)
    texels = cubemap_directions(size)[:, ::step, ::step].reshape(-1, 3)
    values = faces[:, ::step, ::step].reshape(-1, faces.shape[3]).astype(np.float64)
    weight = np.tile(cubemap_solid_angles(size)[::step, ::step].ravel(), 6)
    cell = np.argmax(texels @ directions.T, axis=1)
    total = [np.bincount(cell, weight * channel, len(directions)) for channel in values.T]
    return np.stack(total, axis=1) / np.bincount(cell, weight, len(directions))[:, None]


@dataclass(frozen=True, eq=False)
class _GatheredLight:
    """Light at the n probes of a level, and the hits of their rays.

    Attributes:
        moments: (n, MOMENTS) of the light of the sky, the air and surfaces in the sun.
        is_buried: (n,) whether a probe sees no sky.
        hits: For each direction, the surfaces with further reflections.
    """

    moments: Float64Array
    is_buried: NDArray[np.bool_]
    hits: list["_ReflectingHits"]


@dataclass(frozen=True, eq=False)
class _ReflectingHits:
    """Surfaces hit by m rays of one direction, turned with their probes.

    Attributes:
        receiver: (m,) number of the probe on its level.
        source: (m,) number of the probe before the surface.
        normal: (m, 3) of the surface.
        material: (m,) into `MATERIAL_NAMES`.
        transmittance: (m,) of the air.
    """

    receiver: NDArray[np.int32]
    source: NDArray[np.int32]
    normal: NDArray[np.float16]
    material: NDArray[np.int16]
    transmittance: NDArray[np.float16]


def _gather_light(
    raycaster: Raycaster, grid: ProbeGrid, height_m: float, around: _Surroundings
) -> _GatheredLight:
    """Gather the light of the sky, the air and surfaces in the sun at the probes of a level."""
    origins = grid.list_points(height_m)
    moments = np.zeros((len(origins), MOMENTS))
    sees_sky = np.zeros(len(origins), dtype=bool)
    found: list[_ReflectingHits] = []
    extinction, turns = around.atmosphere.extinction.at_550nm, grid.turns
    # Successive rays of similar directions make fast packets.
    order = np.argsort(turns, kind="stable")
    back = np.argsort(order)
    for number in range(DIRECTION_COUNT):
        directions, air = around.directions[number, turns], around.airlight[number, turns]
        rays = Rays(origins[order], directions[order].astype(np.float32))
        hits = raycaster.cast(rays, MAX_RANGE_M).select(back)
        is_hit = np.isfinite(hits.range_m)
        receiver = np.flatnonzero(is_hit)
        seen, air = hits.select(receiver), air[receiver]
        depth = (extinction * seen.range_m.astype(np.float64))[:, None]
        left = np.exp(-depth)
        points = origins[receiver] + directions[receiver] * seen.range_m[:, None]
        by_sun = _compute_sunlight(raycaster, around.atmosphere, points, seen)
        radiance = around.sky[number, turns]
        opacity = 1.0 - left + air[:, 3:] * (1.0 - left * (1.0 + depth))
        albedo = around.albedo.look_up(seen.material, seen.normal[:, 2])
        radiance[receiver] = albedo / np.pi * by_sun * left + opacity * air[:, :3]
        moments += _compute_moments(radiance, directions)
        sees_sky |= ~is_hit & (directions[:, 2] > 0.0)
        found.append(
            _ReflectingHits(
                receiver.astype(np.int32),
                grid.find_nearest(points + AWAY_M * seen.normal),
                seen.normal.astype(np.float16),
                seen.material,
                left[:, 0].astype(np.float16),
            )
        )
    return _GatheredLight(moments, ~sees_sky, found)


def _compute_sunlight(
    raycaster: Raycaster, atmosphere: Atmosphere, points: FloatArray, hits: RayHits
) -> Float64Array:
    """Compute the illuminance (n, 3) in lx by the sun at points (n, 3) of hit surfaces."""
    cosine = hits.normal @ atmosphere.sun_direction
    is_leaf = _IS_LEAF[hits.material]
    cosine = np.where(is_leaf & (cosine < 0.0), -TRANSMITTED_BY_LEAVES * cosine, cosine)
    facing = np.flatnonzero((cosine > 0.0) & (atmosphere.sun_lx > 0.0))
    outside = (points[facing] + hits.normal[facing] * RAY_OFFSET_M).astype(np.float32)
    sun = np.broadcast_to(atmosphere.sun_direction.astype(np.float32), outside.shape)
    shadowed = np.isfinite(raycaster.cast(Rays(outside, sun), MAX_RANGE_M).range_m)
    lux = np.zeros(len(points))
    lux[facing] = np.where(shadowed, 0.0, atmosphere.sun_lx * cosine[facing])
    return lux[:, None] * np.array(atmosphere.sun_colour)


def _add_reflections(
    grid: ProbeGrid, around: _Surroundings, level: _GatheredLight, found: Float64Array
) -> Float64Array:
    """Add surfaces' reflections of the light (levels, rows, columns, MOMENTS) at all probes."""
    moments, sources, turns = level.moments.copy(), found.reshape(-1, MOMENTS), grid.turns
    for hits, directions in zip(level.hits, around.directions, strict=True):
        lux = compute_irradiance(sources[hits.source], hits.normal.astype(np.float64))
        albedo = around.albedo.look_up(hits.material, hits.normal[:, 2])
        radiance = albedo / np.pi * lux * hits.transmittance[:, None]
        moments[hits.receiver] += _compute_moments(radiance, directions[turns[hits.receiver]])
    return moments
