"""One turn of a LiDAR through the world: what its beams meet, whatever the weather."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from advercity_dsl import Lidar
from numpy.typing import NDArray

from advercity import poses
from advercity.poses import Matrix
from advercity.rendering.casting import Caster, Hits, Rays
from advercity.semantics import Semantic
from advercity.sensors.lidar.beams import directions, head_of
from advercity.sensors.lidar.surfaces import IS_GLASS, PANE_TRANSMITTANCE, WATER_INDEX
from advercity.weather import puddles
from advercity.weather.water import fresnel

Floats = NDArray[np.floating[Any]]
Rows = NDArray[np.intp]

PANES = 2
"""A ray gives up at the next window after that many: into a car and out again."""
_STEP_PAST_M = 1e-3


@dataclass(frozen=True, eq=False)
class Onward:
    """Rays that went on from what they met first.

    Attributes:
        ray: (k,) rows of the turn's rays, ascending.
        passed: (k,) share of the power that comes back through, both ways.
        hits: What they met then; ranges count from the sensor, bends included.
    """

    ray: Rows
    passed: Floats
    hits: Hits


@dataclass(frozen=True, eq=False)
class Scan:
    """What the rays of one turn met.

    Attributes:
        hits: (n,) first surfaces in the order of `beams`, the sub-rays of a beam side by side.
        behind: What was met through one, two and more windows.
        puddled: (p,) rows of rays that met standing water.
        mirrored: What they saw in it; None without puddles.
        world_from_lidar: (4, 4) at the frame's instant.
        now_from_then: (azimuths, 4, 4) from the LiDAR's frame when the head looked along each
            azimuth to that of the frame's instant; None if the turn sees one instant.
    """

    hits: Hits
    behind: tuple[Onward, ...]
    puddled: Rows
    mirrored: Onward | None
    world_from_lidar: Matrix
    now_from_then: Matrix | None


def shoot(
    lidar: Lidar,
    world_from_lidar: Matrix,
    caster: Caster,
    *,
    before: Matrix | None = None,
    puddle_coverage: float = 0.0,
) -> Scan:
    """Cast one turn.

    Args:
        lidar: The sensor; with `motion_distortion` its head takes until now for the turn.
        world_from_lidar: (4, 4) pose now.
        caster: Placed at this frame; with `motion_distortion`, also at the one before.
        before: (4, 4) pose one tick ago; without it the sensor stands still.
        puddle_coverage: Share of the carriageway that mirrors.
    """
    world_from_head = _poses_of_turn(lidar, world_from_lidar, before)
    turn = _rays(lidar, world_from_lidar, world_from_head)
    hits = caster.cast(turn, lidar.range_m)
    puddled = _in_puddles(turn, hits, puddle_coverage)
    return Scan(
        hits=hits,
        behind=_through_windows(turn, hits, caster, lidar.range_m),
        puddled=puddled,
        mirrored=_in_mirrors(turn, hits, puddled, caster, lidar.range_m),
        world_from_lidar=world_from_lidar,
        now_from_then=(
            None if world_from_head is None else poses.inverse(world_from_lidar) @ world_from_head
        ),
    )


def visible_counts(scan: Scan, lidar: Lidar) -> dict[int, int]:
    """Beams that meet each actor first, by its id: the original's test of who is annotated."""
    instance = scan.hits.instance[:: lidar.sub_rays]
    actors, counts = np.unique(instance[instance > 0], return_counts=True)
    return dict(zip(actors.tolist(), counts.tolist(), strict=True))


def turn_shares(lidar: Lidar) -> NDArray[np.float64]:
    """Share of the turn (azimuths,) that is over when the head looks along each azimuth."""
    return np.arange(lidar.azimuths) / lidar.azimuths


def _poses_of_turn(lidar: Lidar, now: Matrix, before: Matrix | None) -> Matrix | None:
    if not lidar.motion_distortion:
        return None
    return poses.between(now if before is None else before, now, turn_shares(lidar))


def _rays(lidar: Lidar, world_from_lidar: Matrix, world_from_head: Matrix | None) -> Rays:
    """All rays of the turn in the world."""
    own = directions(head_of(lidar))
    each = len(own) // lidar.azimuths
    ring = np.tile(np.arange(each, dtype=np.uint16), lidar.azimuths)
    if world_from_head is None:
        turn, place = (part.astype(np.float32) for part in _parts(world_from_lidar))
        return Rays(np.tile(place, (len(own), 1)), _turned(own, turn), ring=ring)
    turns, places = (part.astype(np.float32) for part in _parts(world_from_head))
    turned = own.reshape(lidar.azimuths, each, 3) @ turns.swapaxes(1, 2)
    return Rays(
        origins=np.repeat(places, each, axis=0),
        directions=turned.reshape(-1, 3),
        share=np.repeat(turn_shares(lidar), each).astype(np.float32),
        ring=ring,
    )


def _turned(vectors: Floats, rotation: Floats) -> Floats:
    """Vectors (n, 3) turned, column by column: a BLAS call would wait for threads it cannot use."""
    x, y, z = vectors.T
    turned = np.empty_like(vectors)
    for axis, (by_x, by_y, by_z) in enumerate(rotation):
        turned[:, axis] = by_x * x + by_y * y + by_z * z
    return turned


def _parts(matrix: Matrix) -> tuple[Matrix, Matrix]:
    return matrix[..., :3, :3], matrix[..., :3, 3]


def _through_windows(turn: Rays, hits: Hits, caster: Caster, range_m: float) -> tuple[Onward, ...]:
    """What rays meet behind windows, pane by pane."""
    found: list[Onward] = []
    ray = np.flatnonzero(IS_GLASS[hits.material] & np.isfinite(hits.range_m))
    passed_m = hits.range_m[ray]
    passed = np.ones(len(ray), np.float32)
    while len(ray) and len(found) < PANES:
        passed = passed * np.float32(PANE_TRANSMITTANCE**2)
        start_m = passed_m + np.float32(_STEP_PAST_M)
        onward = _cast_on(turn.rows(ray), start_m, None, caster, range_m)
        found.append(Onward(ray, passed, onward))
        again = np.flatnonzero(IS_GLASS[onward.material] & np.isfinite(onward.range_m))
        ray, passed, passed_m = ray[again], passed[again], onward.range_m[again]
    return tuple(found)


def _in_puddles(turn: Rays, hits: Hits, coverage: float) -> Rows:
    """Rays that end on a carriageway under standing water."""
    if not coverage:
        return np.empty(0, np.intp)
    ray = np.flatnonzero((hits.semantic == Semantic.ROAD) | (hits.semantic == Semantic.ROAD_LINE))
    ray = ray.compress(hits.normal[:, 2].take(ray) > 0.9)
    along = turn.directions.take(ray, axis=0)
    points = turn.origins.take(ray, axis=0) + hits.range_m.take(ray)[:, None] * along
    return ray.compress(puddles.covered(points, coverage))


def _in_mirrors(
    turn: Rays, hits: Hits, puddled: Rows, caster: Caster, range_m: float
) -> Onward | None:
    """What rays see in puddles, whose water is level; weakened by both mirrorings."""
    if not len(puddled):
        return None
    rays_in = turn.rows(puddled)
    down = np.abs(rays_in.directions[:, 2])
    up = rays_in.directions * np.array([1.0, 1.0, -1.0], np.float32)
    mirrored = _cast_on(rays_in, hits.range_m[puddled], up, caster, range_m)
    return Onward(puddled, fresnel(down, WATER_INDEX) ** 2, mirrored)


def _cast_on(
    rays_in: Rays, start_m: Floats, bent: Floats | None, caster: Caster, range_m: float
) -> Hits:
    """Hits of rays that start anew where they had got to, straight on or along `bent`."""
    origins = rays_in.origins + start_m[:, None] * rays_in.directions
    directions = rays_in.directions
    if bent is not None:
        directions = bent
        origins += np.float32(_STEP_PAST_M) * bent
    hits = caster.cast(replace(rays_in, origins=origins, directions=directions), range_m)
    ends_m = hits.range_m + start_m
    ends_m[ends_m > range_m] = np.inf
    return replace(hits, range_m=ends_m)
