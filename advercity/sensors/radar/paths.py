"""Paths of a radar's waves to surfaces and back: shooting and bouncing rays.

A ray is a tube of some solid angle. At each surface a part of its power scatters to the radar,
directly or back through the mirrors before it, and a part is mirrored to the next surface. The
wave from a mirror towards the radar adds in phase over the whole area of the mirror: the flashes of
plates and corners (Ling, Chou and Lee, IEEE Trans. Antennas Propag. 37, 194, 1989).
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from advercity.geometry.arrays import Float64Array, FloatArray, IndexArray
from advercity.physics.microwaves import WAVELENGTH_M
from advercity.rendering.raycaster import Raycaster, RayHits, Rays
from advercity.sensors.measurements import PointKind
from advercity.sensors.radar.antenna import (
    compute_echo_factor,
    compute_range_cell_m,
    compute_two_way_gain,
)
from advercity.sensors.radar.motion import SceneMotion
from advercity.sensors.radar.placement import PlacedRadar
from advercity.sensors.radar.rays import RayFan, aim_rays
from advercity.sensors.radar.surfaces import WAVENUMBER_PER_M, HitSurfaces

MIN_MIRRORED = 1e-3
"""Fraction of the power below which a ray is not followed further."""
FADING_ANGLES = (0.2, 0.4)
"""Angles in rad between a mirrored tube and the radar: from the first on the wave fades, at the
second it is gone. A sharp end would itself scatter like an edge."""
MIN_SNR = 1e-3
"""Signal-to-noise ratio in clear air below which a path is left out."""
MIN_FLASH_SNR = 10.0
"""Least signal-to-noise ratio of a mirrored ray for closer rays at the edge of its flash. A few
such rays add up to a strong echo; weaker flashes drown in scattered power."""
GHOST_CELLS = 2.0
"""Distance, in range cells, of a path's apparent place from its surface that makes it a ghost."""
_EPSILON_M = 1e-3


@dataclass(frozen=True, eq=False)
class Paths:
    """n paths to a scatterer and back, as perceived by the radar.

    Attributes:
        direction: (n, 3) float32 towards the arriving wave, unit, radar frame.
        range_m: (n,) float32 half of the path's length.
        rate_m_s: (n,) float32 rate of growth of the range.
        strength: (n,) float32 gain² times cross-section over range⁴, of scattered power.
        field: (n,) complex64 root of the same, of waves that add in phase; 0 for all others.
        detour_m: (n,) float32 length of the path beyond the straight one.
        mirrorings: (n,) uint8 whether mirrors are on no leg, one leg or both legs.
        instance: (n,) int32 id of the actor; 0 for everything else.
        kind: (n,) uint8 of `PointKind`.
    """

    direction: FloatArray
    range_m: FloatArray
    rate_m_s: FloatArray
    strength: FloatArray
    field: NDArray[np.complex64]
    detour_m: FloatArray
    mirrorings: NDArray[np.uint8]
    instance: NDArray[np.int32]
    kind: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.range_m)

    def select(self, rows: IndexArray) -> "Paths":
        """Select paths by row numbers."""
        return Paths(*(getattr(self, item.name)[rows] for item in fields(self)))

    @staticmethod
    def join(parts: "list[Paths]") -> "Paths":
        """Join paths in order."""
        return Paths(
            *(np.concatenate([getattr(one, item.name) for one in parts]) for item in fields(Paths))
        )


@dataclass(frozen=True, eq=False)
class SurfacePaths:
    """Paths to surfaces, and the free range of each ray.

    Attributes:
        paths: The paths, independent of the air.
        directions: (rays, 3) float32 unit vectors of the rays, radar frame.
        free_m: (rays,) float32 range of the first surface; inf if there is none.
    """

    paths: Paths
    directions: FloatArray
    free_m: FloatArray


@dataclass(frozen=True, eq=False)
class _Tubes:
    """The k rays still on their way.

    Attributes:
        ray: (k,) rows of the rays.
        origins: (k, 3) in the world.
        directions: (k, 3) in the world.
        length_m: (k,) length of the path so far.
        rate_m_s: (k,) rate of growth of the length.
        power: (k,) fraction left after mirrors.
        mover: (k, 3) velocity of their starting points.
    """

    ray: IndexArray
    origins: Float64Array
    directions: Float64Array
    length_m: Float64Array
    rate_m_s: Float64Array
    power: Float64Array
    mover: Float64Array

    def select(self, rows: IndexArray) -> "_Tubes":
        """Select tubes by row numbers."""
        return _Tubes(*(getattr(self, item.name)[rows] for item in fields(self)))


@dataclass(frozen=True, eq=False)
class _Arrival:
    """Tubes at their hits, with the surfaces, and the path from there to the radar."""

    tubes: _Tubes
    points: Float64Array
    hits: RayHits
    surfaces: HitSurfaces
    mover: Float64Array
    back: Float64Array
    back_m: Float64Array


@dataclass(frozen=True, eq=False)
class _FanPaths:
    """Paths of the rays of a fan.

    Attributes:
        paths: The n paths.
        ray: (n,) row of the ray of each.
        free_m: (rays,) range of the first surface; inf if there is none.
    """

    paths: Paths
    ray: IndexArray
    free_m: FloatArray


class PathTracer:
    """Traces the paths of rays of one radar at one instant.

    Args:
        placed: The radar.
        raycaster: Placed at the frame.
        motion: Motion of the actors.
        wetness: Wetness of roads, 0 dry to 1 soaked.
        fan: The rays.
    """

    def __init__(
        self,
        placed: PlacedRadar,
        raycaster: Raycaster,
        motion: SceneMotion,
        wetness: float,
        fan: RayFan,
    ) -> None:
        radar, pose = placed.radar, placed.world_from_radar
        self._radar, self._raycaster, self._motion = radar, raycaster, motion
        self._rotation, self._origin = pose[:3, :3], pose[:3, 3]
        self._velocity, self._wetness = placed.velocity, wetness
        self._fan = fan
        self._least_strength = MIN_SNR / compute_echo_factor(radar)

    def trace(self, *, only_flashes: bool = False) -> _FanPaths:
        """Trace all paths, or only paths by mirrors alone."""
        tubes, found = self._shoot(), list[tuple[Paths, IndexArray]]()
        free_m = np.full(len(tubes.ray), np.inf, np.float32)
        for bounce in range(self._radar.bounces):
            arrival = self._cast(tubes)
            if not bounce:
                free_m[arrival.tubes.ray] = arrival.hits.range_m
            found.append(self._flash(arrival))
            if not only_flashes:
                found += self._scatter(arrival, is_direct=not bounce)
            tubes = _mirror(arrival)
        paths, rays = zip(*found, strict=True)
        return _FanPaths(Paths.join(list(paths)), np.concatenate(rays), free_m)

    def _shoot(self) -> _Tubes:
        directions = self._fan.directions @ self._rotation.T
        count = len(directions)
        return _Tubes(
            ray=np.arange(count),
            origins=np.tile(self._origin, (count, 1)),
            directions=directions,
            length_m=np.zeros(count),
            rate_m_s=np.zeros(count),
            power=np.ones(count),
            mover=np.tile(self._velocity, (count, 1)),
        )

    def _cast(self, tubes: _Tubes) -> _Arrival:
        rays = Rays(tubes.origins.astype(np.float32), tubes.directions.astype(np.float32))
        hits = self._raycaster.cast(rays, self._radar.range_m)
        length_m = tubes.length_m + hits.range_m
        rows = np.flatnonzero(length_m <= self._radar.range_m)
        hits, tubes = hits.select(rows), tubes.select(rows)
        points = tubes.origins + hits.range_m[:, None] * tubes.directions
        mover = self._motion.compute_velocities(points, hits.instance, hits.material)
        growth = np.einsum("ni,ni->n", tubes.directions, mover - tubes.mover)
        back = self._origin - points
        back_m = np.maximum(np.linalg.norm(back, axis=1), _EPSILON_M)
        return _Arrival(
            tubes=_Tubes(
                *(tubes.ray, tubes.origins, tubes.directions),
                *(length_m[rows], tubes.rate_m_s + growth, tubes.power, tubes.mover),
            ),
            points=points,
            hits=hits,
            surfaces=HitSurfaces.from_hits(hits, self._wetness),
            mover=mover,
            back=back / back_m[:, None],
            back_m=back_m,
        )

    def _scatter(self, arrival: _Arrival, *, is_direct: bool) -> Iterator[tuple[Paths, IndexArray]]:
        """Yield the paths scattered to the radar by an arrival's surfaces, with their rays."""
        yield self._scatter_back(arrival, is_direct=is_direct)
        if not is_direct:
            yield from self._scatter_home(arrival)

    def _scatter_back(self, arrival: _Arrival, *, is_direct: bool) -> tuple[Paths, IndexArray]:
        """Scatter straight back, along the path of the incoming wave."""
        tubes, surfaces = arrival.tubes, arrival.surfaces
        area_per_m2 = self._fan.solid_angle_sr[tubes.ray] / surfaces.cosine
        scattering = surfaces.compute_scattering(tubes.directions, -tubes.directions)
        direction = self._fan.directions[tubes.ray]
        gain = compute_two_way_gain(self._radar, direction, direction)
        return self._build(
            arrival,
            np.arange(len(tubes.ray)),
            direction=direction,
            range_m=tubes.length_m,
            rate_m_s=tubes.rate_m_s,
            strength=gain * tubes.power**2 * scattering * area_per_m2 / tubes.length_m**2,
            detour_m=2.0 * (tubes.length_m - arrival.back_m),
            mirrorings=0 if is_direct else 2,
        )

    def _scatter_home(self, arrival: _Arrival) -> Iterator[tuple[Paths, IndexArray]]:
        """Scatter directly to the radar after mirrors; also yield the same paths backwards."""
        tubes, surfaces = arrival.tubes, arrival.surfaces
        out, home = self._fan.directions[tubes.ray], self._locate_home(arrival)
        scattering = surfaces.compute_scattering(tubes.directions, arrival.back)
        gain = compute_two_way_gain(self._radar, out, home)
        area = self._fan.solid_angle_sr[tubes.ray] / surfaces.cosine
        strength = gain * tubes.power * scattering * area / arrival.back_m**2
        rows = np.flatnonzero(strength > 0.0)
        rows = rows[self._is_free(arrival, rows)]
        rate = tubes.rate_m_s + self._rate_home(arrival)
        for direction in (home, out):
            yield self._build(
                arrival,
                rows,
                direction=direction,
                range_m=(tubes.length_m + arrival.back_m) / 2.0,
                rate_m_s=rate / 2.0,
                strength=strength,
                detour_m=tubes.length_m - arrival.back_m,
                mirrorings=1,
            )

    def _flash(self, arrival: _Arrival) -> tuple[Paths, IndexArray]:
        """Mirror tubes towards the radar; they add in phase."""
        tubes, surfaces = arrival.tubes, arrival.surfaces
        onward = _reflect(tubes.directions, surfaces.normal)
        off = np.linalg.norm(onward - arrival.back, axis=1)
        rows = np.flatnonzero(off < FADING_ANGLES[1])
        ray, length_m, back_m = tubes.ray[rows], tubes.length_m[rows], arrival.back_m[rows]
        section_m2 = length_m**2 * self._fan.solid_angle_sr[ray]
        spread = np.sinc(np.sqrt(section_m2) * off[rows] / WAVELENGTH_M)
        power = tubes.power[rows] * surfaces.compute_mirror_power()[rows]
        first, last = FADING_ANGLES
        fading = np.cos(math.pi / 2.0 * np.clip((off[rows] - first) / (last - first), 0.0, 1.0))
        home = self._locate_home(arrival)
        gain = compute_two_way_gain(self._radar, self._fan.directions[ray], home[rows])
        root = np.sqrt(gain) * np.sqrt(4.0 * math.pi * power) / WAVELENGTH_M
        phase = np.exp(-1j * WAVENUMBER_PER_M * (length_m + back_m))
        field = np.zeros(len(tubes.ray), np.complex64)
        field[rows] = root * section_m2 * spread * fading**2 * phase / (length_m * back_m)
        # An array of transmitters and receivers adds the phases of both ways. The echo seems to
        # come from between them: from the corner itself, wherever a ray enters it.
        between = self._fan.directions[tubes.ray] + home
        return self._build(
            arrival,
            rows,
            direction=between / np.linalg.norm(between, axis=1, keepdims=True),
            range_m=(tubes.length_m + arrival.back_m) / 2.0,
            rate_m_s=(tubes.rate_m_s + self._rate_home(arrival)) / 2.0,
            field=field,
        )

    def _locate_home(self, arrival: _Arrival) -> FloatArray:
        """Compute the directions (n, 3) of the last leg as seen from the radar, in its frame."""
        return (-arrival.back @ self._rotation).astype(np.float32)

    def _rate_home(self, arrival: _Arrival) -> Float64Array:
        """Compute the growth (n,) of the straight path to the radar, m/s."""
        return np.einsum("ni,ni->n", arrival.back, self._velocity - arrival.mover)

    def _is_free(self, arrival: _Arrival, rows: IndexArray) -> NDArray[np.bool_]:
        """Find which rows have a free path from their points to the radar."""
        start = arrival.points[rows] + _EPSILON_M * arrival.surfaces.normal[rows]
        rays = Rays(start.astype(np.float32), arrival.back[rows].astype(np.float32))
        hits = self._raycaster.cast(rays, 2.0 * self._radar.range_m)
        return hits.range_m >= arrival.back_m[rows] - 2.0 * _EPSILON_M

    def _build(
        self,
        arrival: _Arrival,
        rows: IndexArray,
        *,
        direction: FloatArray,
        range_m: Float64Array,
        rate_m_s: Float64Array,
        strength: Float64Array | None = None,
        field: NDArray[np.complex64] | None = None,
        detour_m: Float64Array | None = None,
        mirrorings: int = 0,
    ) -> tuple[Paths, IndexArray]:
        """Build paths of some rows, with their rays.

        A path with an apparent place away from its surface is a ghost.
        """
        if strength is not None:
            rows = rows[strength[rows] > self._least_strength]
        count, apparent = len(range_m), range_m[:, None] * direction
        true = (arrival.points - self._origin) @ self._rotation
        off_m = np.linalg.norm(apparent - true, axis=1)
        is_ghost = off_m > GHOST_CELLS * compute_range_cell_m(self._radar)
        zeros = np.zeros(count, np.float32)
        paths = Paths(
            direction=direction.astype(np.float32),
            range_m=range_m.astype(np.float32),
            rate_m_s=rate_m_s.astype(np.float32),
            strength=zeros if strength is None else strength.astype(np.float32),
            field=zeros.astype(np.complex64) if field is None else field,
            detour_m=zeros if detour_m is None else detour_m.astype(np.float32),
            mirrorings=np.full(count, mirrorings, np.uint8),
            instance=arrival.hits.instance,
            kind=np.where(is_ghost, PointKind.GHOST, PointKind.SURFACE).astype(np.uint8),
        )
        return paths.select(rows), arrival.tubes.ray[rows]


def trace_paths(
    placed: PlacedRadar, raycaster: Raycaster, motion: SceneMotion, *, wetness: float = 0.0
) -> SurfacePaths:
    """Trace all paths of a radar; arguments as in `PathTracer`."""
    fan = aim_rays(placed, raycaster, motion.frame.states)
    traced = PathTracer(placed, raycaster, motion, wetness, fan).trace()
    snr = np.abs(traced.paths.field) ** 2 * compute_echo_factor(placed.radar)
    flashes = np.flatnonzero(snr > MIN_FLASH_SNR)
    flash_m = np.zeros(len(traced.free_m))
    np.maximum.at(flash_m, traced.ray[flashes], traced.paths.range_m[flashes])
    split, closer = fan.split_flashes(flash_m)
    finer = PathTracer(placed, raycaster, motion, wetness, closer).trace(only_flashes=True)
    is_replaced = (traced.paths.field != 0.0) & np.isin(traced.ray, split)
    kept = traced.paths.select(np.flatnonzero(~is_replaced))
    return SurfacePaths(Paths.join([kept, finer.paths]), fan.directions, traced.free_m)


def _mirror(arrival: _Arrival) -> _Tubes:
    """Mirror the tubes, except tubes with too little power left."""
    tubes, surfaces = arrival.tubes, arrival.surfaces
    power = tubes.power * surfaces.compute_mirror_power()
    rows = np.flatnonzero(power > MIN_MIRRORED)
    directions = _reflect(tubes.directions[rows], surfaces.normal[rows])
    return _Tubes(
        ray=tubes.ray[rows],
        origins=arrival.points[rows] + _EPSILON_M * directions,
        directions=directions,
        length_m=tubes.length_m[rows] + _EPSILON_M,
        rate_m_s=tubes.rate_m_s[rows],
        power=power[rows],
        mover=arrival.mover[rows],
    )


def _reflect(directions: Float64Array, normal: FloatArray) -> Float64Array:
    return directions - 2.0 * np.einsum("ni,ni->n", directions, normal)[:, None] * normal
