"""One turn of a LiDAR through the world: what its beams meet, whatever the weather."""

from dataclasses import dataclass, replace

import numpy as np
from advercity_dsl import Lidar
from numpy.typing import NDArray

from advercity.geometry import poses
from advercity.geometry.arrays import FloatArray, IndexArray
from advercity.geometry.poses import Matrix
from advercity.physics import water
from advercity.physics.water import fresnel_reflectance
from advercity.rendering.raycaster import Raycaster, RayHits, Rays
from advercity.semantics import Semantic
from advercity.sensors.lidar.beams import build_ray_directions, build_scan_pattern
from advercity.sensors.lidar.received_power import (
    IS_GLASS,
    PANE_TRANSMITTANCE,
    WATER_REFRACTIVE_INDEX_905NM,
)

MAX_GLASS_PANES = 2
"""A ray gives up at the next window after that many: into a car and out again."""
_RAY_EPSILON_M = 1e-3


@dataclass(frozen=True, eq=False)
class SecondaryHits:
    """Rays that went on from what they met first.

    Attributes:
        ray: (k,) rows of the turn's rays, ascending.
        transmittance: (k,) share of the power that comes back through, both ways.
        hits: What they met then; ranges count from the sensor, bends included.
    """

    ray: IndexArray
    transmittance: FloatArray
    hits: RayHits


@dataclass(frozen=True, eq=False)
class ScanHits:
    """What the rays of one turn met.

    Attributes:
        hits: (n,) first surfaces in the order of `beams`, the sub-rays of a beam side by side.
        behind_glass: What was met through one, two and more windows.
        puddle_rays: (p,) rows of rays that met standing water.
        puddle_reflection: What they saw in it; None without puddles.
        world_from_lidar: (4, 4) at the frame's instant.
        now_from_then: (azimuths, 4, 4) from the LiDAR's frame when the head looked along each
            azimuth to that of the frame's instant; None if the turn sees one instant.
    """

    hits: RayHits
    behind_glass: tuple[SecondaryHits, ...]
    puddle_rays: IndexArray
    puddle_reflection: SecondaryHits | None
    world_from_lidar: Matrix
    now_from_then: Matrix | None


def cast_scan(
    lidar: Lidar,
    world_from_lidar: Matrix,
    raycaster: Raycaster,
    *,
    previous_world_from_lidar: Matrix | None = None,
    puddle_coverage: float = 0.0,
) -> ScanHits:
    """Cast one turn.

    Args:
        lidar: The sensor; with `motion_distortion` its head takes until now for the turn.
        world_from_lidar: (4, 4) pose now.
        raycaster: Placed at this frame; with `motion_distortion`, also at the one before.
        previous_world_from_lidar: (4, 4) pose one tick ago; without it the sensor stands still.
        puddle_coverage: Share of the carriageway that mirrors.
    """
    world_from_head = _head_poses(lidar, world_from_lidar, previous_world_from_lidar)
    turn = _build_rays(lidar, world_from_lidar, world_from_head)
    hits = raycaster.cast(turn, lidar.range_m)
    puddled = _find_puddle_rays(turn, hits, puddle_coverage)
    return ScanHits(
        hits=hits,
        behind_glass=_cast_through_glass(turn, hits, raycaster, lidar.range_m),
        puddle_rays=puddled,
        puddle_reflection=_cast_puddle_reflection(turn, hits, puddled, raycaster, lidar.range_m),
        world_from_lidar=world_from_lidar,
        now_from_then=(
            None
            if world_from_head is None
            else poses.invert_pose(world_from_lidar) @ world_from_head
        ),
    )


def scan_fractions(lidar: Lidar) -> NDArray[np.float64]:
    """Share of the turn (azimuths,) that is over when the head looks along each azimuth."""
    return np.arange(lidar.azimuths) / lidar.azimuths


def _head_poses(lidar: Lidar, now: Matrix, before: Matrix | None) -> Matrix | None:
    if not lidar.motion_distortion:
        return None
    return poses.interpolate_poses(now if before is None else before, now, scan_fractions(lidar))


def _build_rays(lidar: Lidar, world_from_lidar: Matrix, world_from_head: Matrix | None) -> Rays:
    """All rays of the turn in the world."""
    own = build_ray_directions(build_scan_pattern(lidar))
    each = len(own) // lidar.azimuths
    ring = np.tile(np.arange(each, dtype=np.uint16), lidar.azimuths)
    if world_from_head is None:
        turn, place = (part.astype(np.float32) for part in _split_pose(world_from_lidar))
        return Rays(np.tile(place, (len(own), 1)), _rotate_vectors(own, turn), ring=ring)
    turns, places = (part.astype(np.float32) for part in _split_pose(world_from_head))
    turned = own.reshape(lidar.azimuths, each, 3) @ turns.swapaxes(1, 2)
    return Rays(
        origins=np.repeat(places, each, axis=0),
        directions=turned.reshape(-1, 3),
        time_fraction=np.repeat(scan_fractions(lidar), each).astype(np.float32),
        ring=ring,
    )


def _rotate_vectors(vectors: FloatArray, rotation: FloatArray) -> FloatArray:
    """Vectors (n, 3) turned, column by column: a BLAS call would wait for threads it cannot use."""
    x, y, z = vectors.T
    turned = np.empty_like(vectors)
    for axis, (by_x, by_y, by_z) in enumerate(rotation):
        turned[:, axis] = by_x * x + by_y * y + by_z * z
    return turned


def _split_pose(matrix: Matrix) -> tuple[Matrix, Matrix]:
    return matrix[..., :3, :3], matrix[..., :3, 3]


def _cast_through_glass(
    turn: Rays, hits: RayHits, caster: Raycaster, range_m: float
) -> tuple[SecondaryHits, ...]:
    """What rays meet behind windows, pane by pane."""
    found: list[SecondaryHits] = []
    ray = np.flatnonzero(IS_GLASS[hits.material] & np.isfinite(hits.range_m))
    passed_m = hits.range_m[ray]
    passed = np.ones(len(ray), np.float32)
    while len(ray) and len(found) < MAX_GLASS_PANES:
        passed = passed * np.float32(PANE_TRANSMITTANCE**2)
        start_m = passed_m + np.float32(_RAY_EPSILON_M)
        onward = _cast_secondary(turn.select(ray), start_m, None, caster, range_m)
        found.append(SecondaryHits(ray, passed, onward))
        again = np.flatnonzero(IS_GLASS[onward.material] & np.isfinite(onward.range_m))
        ray, passed, passed_m = ray[again], passed[again], onward.range_m[again]
    return tuple(found)


def _find_puddle_rays(turn: Rays, hits: RayHits, coverage: float) -> IndexArray:
    """Rays that end on a carriageway under standing water."""
    if not coverage:
        return np.empty(0, np.intp)
    ray = np.flatnonzero((hits.semantic == Semantic.ROAD) | (hits.semantic == Semantic.ROAD_LINE))
    ray = ray.compress(hits.normal[:, 2].take(ray) > 0.9)
    along = turn.directions.take(ray, axis=0)
    points = turn.origins.take(ray, axis=0) + hits.range_m.take(ray)[:, None] * along
    return ray.compress(water.is_in_puddle(points, coverage))


def _cast_puddle_reflection(
    turn: Rays, hits: RayHits, puddled: IndexArray, caster: Raycaster, range_m: float
) -> SecondaryHits | None:
    """What rays see in puddles, whose water is level; weakened by both mirrorings."""
    if not len(puddled):
        return None
    rays_in = turn.select(puddled)
    down = np.abs(rays_in.directions[:, 2])
    up = rays_in.directions * np.array([1.0, 1.0, -1.0], np.float32)
    mirrored = _cast_secondary(rays_in, hits.range_m[puddled], up, caster, range_m)
    return SecondaryHits(
        puddled, fresnel_reflectance(down, WATER_REFRACTIVE_INDEX_905NM) ** 2, mirrored
    )


def _cast_secondary(
    rays_in: Rays, start_m: FloatArray, bent: FloatArray | None, caster: Raycaster, range_m: float
) -> RayHits:
    """Hits of rays that start anew where they had got to, straight on or along `bent`."""
    origins = rays_in.origins + start_m[:, None] * rays_in.directions
    directions = rays_in.directions
    if bent is not None:
        directions = bent
        origins += np.float32(_RAY_EPSILON_M) * bent
    hits = caster.cast(replace(rays_in, origins=origins, directions=directions), range_m)
    ends_m = hits.range_m + start_m
    ends_m[ends_m > range_m] = np.inf
    return replace(hits, range_m=ends_m)
