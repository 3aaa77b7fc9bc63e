"""Surfaces hit by the beams of one scan, independent of the air: rays, panes and puddles."""

from dataclasses import dataclass, replace

import numpy as np
from advercity_dsl import Lidar
from numpy.typing import NDArray

from advercity.geometry import poses
from advercity.geometry.arrays import FloatArray, IndexArray
from advercity.geometry.poses import Matrix
from advercity.physics import water
from advercity.physics.water import fresnel_reflectance
from advercity.rendering.cover import Cover
from advercity.rendering.raycaster import Raycaster, RayHits, Rays
from advercity.semantics import Semantic
from advercity.sensors.lidar.beams import (
    FIRST_SCAN,
    ScanTime,
    build_ray_directions,
    build_scan_pattern,
)
from advercity.sensors.lidar.received_power import (
    IS_GLASS,
    PANE_TRANSMITTANCE,
    WATER_REFRACTIVE_INDEX_905NM,
)

MAX_GLASS_PANES = 2
"""Largest number of panes on the path of a ray: into a car and out of it."""
_RAY_EPSILON_M = 1e-3
"""Offset of secondary rays from their first surface, so they do not hit it again."""


@dataclass(frozen=True, eq=False)
class SecondaryHits:
    """Hits of rays continued beyond their first surface, through panes or by reflection.

    Attributes:
        ray: (k,) rows of the scan's rays, ascending.
        transmittance: (k,) transmitted or mirrored fraction of the power, both ways.
        hits: (k,) surfaces hit; ranges are path lengths from the sensor.
    """

    ray: IndexArray
    transmittance: FloatArray
    hits: RayHits


@dataclass(frozen=True, eq=False)
class ScanHits:
    """Surfaces hit by the rays of one scan.

    Attributes:
        hits: (n,) first surfaces in the order of `beam_directions`, sub-rays of a beam adjacent.
        behind_glass: Hits behind one, two and more panes.
        puddle_rays: (p,) rows of rays on standing water.
        puddle_reflection: Hits of their mirrored rays; None without puddles.
        world_from_lidar: (4, 4) pose at the frame's instant.
        now_from_then: (azimuths, 4, 4) transform from the LiDAR frame at the passing of each
            azimuth to the LiDAR frame at the frame's instant; None if the scan is instantaneous.
        time: Time of the scan.
        cover: Surfaces above the ground, with no precipitation below; None if there are none.
    """

    hits: RayHits
    behind_glass: tuple[SecondaryHits, ...]
    puddle_rays: IndexArray
    puddle_reflection: SecondaryHits | None
    world_from_lidar: Matrix
    now_from_then: Matrix | None
    time: ScanTime = FIRST_SCAN
    cover: Cover | None = None


def cast_scan(
    lidar: Lidar,
    world_from_lidar: Matrix,
    raycaster: Raycaster,
    *,
    previous_world_from_lidar: Matrix | None = None,
    puddle_coverage: float = 0.0,
    time: ScanTime = FIRST_SCAN,
) -> ScanHits:
    """Cast the rays of one scan.

    Args:
        lidar: The sensor; with `motion_distortion` the scan ends at the frame's instant.
        world_from_lidar: (4, 4) pose at the frame's instant.
        raycaster: Placed at this frame; with `motion_distortion`, also at the scan's start.
        previous_world_from_lidar: (4, 4) pose at the scan's start; None for a sensor at rest.
        puddle_coverage: Fraction of the carriageway under standing water.
        time: Time of the scan, which decides the angles of prisms, and its duration.
    """
    world_from_head = _interpolate_head_poses(lidar, world_from_lidar, previous_world_from_lidar)
    directions = build_ray_directions(build_scan_pattern(lidar, time))
    rays = _build_rays(lidar, directions, world_from_lidar, world_from_head)
    hits = raycaster.cast(rays, lidar.range_m)
    puddled = _find_puddle_rays(rays, hits, puddle_coverage)
    return ScanHits(
        hits=hits,
        behind_glass=_cast_through_glass(rays, hits, raycaster, lidar.range_m),
        puddle_rays=puddled,
        puddle_reflection=_cast_puddle_reflection(rays, hits, puddled, raycaster, lidar.range_m),
        world_from_lidar=world_from_lidar,
        now_from_then=(
            None
            if world_from_head is None
            else poses.invert_pose(world_from_lidar) @ world_from_head
        ),
        time=time,
        cover=raycaster.cover,
    )


def scan_fractions(lidar: Lidar) -> NDArray[np.float64]:
    """Compute the fraction of the scan (azimuths,) elapsed when the head passes each azimuth."""
    return np.arange(lidar.azimuths) / lidar.azimuths


def _interpolate_head_poses(lidar: Lidar, now: Matrix, before: Matrix | None) -> Matrix | None:
    if not lidar.motion_distortion:
        return None
    return poses.interpolate_poses(now if before is None else before, now, scan_fractions(lidar))


def _build_rays(
    lidar: Lidar, directions: FloatArray, world_from_lidar: Matrix, world_from_head: Matrix | None
) -> Rays:
    """Build all rays of the scan in the world."""
    per_azimuth = len(directions) // lidar.azimuths
    if world_from_head is None:
        rotation, origin = (part.astype(np.float32) for part in _split_pose(world_from_lidar))
        origins = np.broadcast_to(origin, directions.shape)
        return Rays(origins, _rotate_vectors(directions, rotation), rings=per_azimuth)
    rotations, origins = (part.astype(np.float32) for part in _split_pose(world_from_head))
    rotated = directions.reshape(lidar.azimuths, per_azimuth, 3) @ rotations.swapaxes(1, 2)
    return Rays(
        origins=np.repeat(origins, per_azimuth, axis=0),
        directions=rotated.reshape(-1, 3),
        time_fraction=np.repeat(scan_fractions(lidar), per_azimuth).astype(np.float32),
        rings=per_azimuth,
    )


def _rotate_vectors(vectors: FloatArray, rotation: FloatArray) -> FloatArray:
    """Rotate vectors (n, 3) by a matrix (3, 3)."""
    # Column by column: a BLAS call would start threads and wait for them.
    x, y, z = np.ascontiguousarray(vectors.T)
    return np.stack([by_x * x + by_y * y + by_z * z for by_x, by_y, by_z in rotation], axis=1)


def _split_pose(matrix: Matrix) -> tuple[Matrix, Matrix]:
    return matrix[..., :3, :3], matrix[..., :3, 3]


def _cast_through_glass(
    rays: Rays, hits: RayHits, raycaster: Raycaster, range_m: float
) -> tuple[SecondaryHits, ...]:
    """Continue the rays on glass, pane by pane."""
    found: list[SecondaryHits] = []
    ray = np.flatnonzero(IS_GLASS.take(hits.material) & np.isfinite(hits.range_m))
    pane_m = hits.range_m[ray]
    transmittance = np.ones(len(ray), np.float32)
    while len(ray) and len(found) < MAX_GLASS_PANES:
        transmittance = transmittance * np.float32(PANE_TRANSMITTANCE**2)
        start_m = pane_m + np.float32(_RAY_EPSILON_M)
        behind = _cast_secondary(rays.select(ray), start_m, None, raycaster, range_m)
        found.append(SecondaryHits(ray, transmittance, behind))
        again = np.flatnonzero(IS_GLASS.take(behind.material) & np.isfinite(behind.range_m))
        ray, transmittance = ray[again], transmittance[again]
        pane_m = behind.range_m[again]
    return tuple(found)


def _find_puddle_rays(rays: Rays, hits: RayHits, coverage: float) -> IndexArray:
    """Find the rays on a carriageway under standing water."""
    if not coverage:
        return np.empty(0, np.intp)
    ray = np.flatnonzero((hits.semantic == Semantic.ROAD) | (hits.semantic == Semantic.ROAD_LINE))
    ray = ray.compress(hits.keep_exposed(hits.normal[:, 2]).take(ray) > 0.9)
    path = hits.range_m.take(ray)[:, None] * rays.directions.take(ray, axis=0)
    points = rays.origins.take(ray, axis=0) + path
    return ray.compress(water.is_in_puddle(points, coverage))


def _cast_puddle_reflection(
    rays: Rays, hits: RayHits, puddled: IndexArray, raycaster: Raycaster, range_m: float
) -> SecondaryHits | None:
    """Reflect rays in the level water of puddles, there and back."""
    if not len(puddled):
        return None
    rays_in = rays.select(puddled)
    down = np.abs(rays_in.directions[:, 2])
    up = rays_in.directions * np.array([1.0, 1.0, -1.0], np.float32)
    mirrored = _cast_secondary(rays_in, hits.range_m[puddled], up, raycaster, range_m)
    return SecondaryHits(
        puddled, fresnel_reflectance(down, WATER_REFRACTIVE_INDEX_905NM) ** 2, mirrored
    )


def _cast_secondary(
    rays_in: Rays,
    start_m: FloatArray,
    reflected: FloatArray | None,
    raycaster: Raycaster,
    range_m: float,
) -> RayHits:
    """Continue rays from `start_m`, straight on or along new directions `reflected` (n, 3)."""
    origins = rays_in.origins + start_m[:, None] * rays_in.directions
    directions = rays_in.directions
    if reflected is not None:
        directions = reflected
        origins += np.float32(_RAY_EPSILON_M) * reflected
    hits = raycaster.cast(replace(rays_in, origins=origins, directions=directions), range_m)
    ends_m = hits.range_m + start_m
    # Hits beyond the range lose all their fields, or they would still return power.
    reached = ends_m <= range_m
    return RayHits(
        range_m=np.where(reached, ends_m, np.float32(np.inf)),
        normal=hits.normal * reached[:, None],
        cosine=hits.cosine * reached,
        material=hits.material * reached,
        semantic=hits.semantic * reached,
        instance=hits.instance * reached,
        is_covered=None if hits.is_covered is None else hits.is_covered & reached,
    )
