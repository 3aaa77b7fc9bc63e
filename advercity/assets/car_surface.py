"""The smooth surface of a car's body: a cubic B-spline over a cage, with wheel arches cut in.

Places on it are (u, v): columns of the cage from nose to tail, and rows from the floor's edge over
the left to the centre of the roof. It is the limit of subdivision by Catmull and Clark.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from advercity.assets.car_forms import CENTRE, COLUMN_COUNT, SHOULDER, SILL, CarForm, build_car_cage
from advercity.geometry.arrays import Float64Array
from advercity.geometry.mesh import TriangleSurface, normalize

ARCH_RADII = 1.13
"""Radius of a wheel arch in radii of the wheel."""
_FLARE_M, _FLARE_WIDTH_M = 0.018, 0.05
"""How far the edge of a wheel arch bulges, and over which distance."""
_MIRROR = np.array([1.0, -1.0, 1.0])
_STEP = 2e-3
"""Difference of u and v for computing normals."""


@dataclass(frozen=True, eq=False)
class CarSurface:
    """Body of one car; lengths in metres, x forward, y left, on the ground."""

    form: CarForm
    length: float
    half: float
    height: float
    wheel_m: float

    @cached_property
    def _cage(self) -> Float64Array:
        """Compute the cage with the mirrored and extrapolated points around it."""
        cage = build_car_cage(self.form, self.length, self.half, self.height)
        cage = np.concatenate([cage[1:2] * _MIRROR, cage, cage[-2:-1] * _MIRROR])
        below = 2 * cage[:, :1] - cage[:, 1:2]
        return np.concatenate([below, cage, cage[:, -2:-1] * _MIRROR], axis=1)

    @cached_property
    def _station_table(self) -> tuple[Float64Array, Float64Array]:
        u = np.linspace(0.0, COLUMN_COUNT - 1.0, 801)
        return 0.5 - self._locate_uncut(u, np.full(801, 2.0))[:, 0] / self.length, u

    def x_at(self, station: float) -> float:
        """Compute x of a station."""
        return self.length * (0.5 - station)

    def u_at(self, station: float | Float64Array) -> Float64Array:
        """Compute u of a station on the flanks."""
        return np.asarray(np.interp(station, *self._station_table))

    def locate(self, u: ArrayLike, v: ArrayLike) -> Float64Array:
        """Locate points (n, 3) of the left half at u and v, one or (n,) each."""
        u, v = (np.array(item, dtype=np.float64) for item in np.broadcast_arrays(u, v))
        points = self._locate_uncut(u, v)
        lines, line = np.unique(u, return_inverse=True)
        rows = [np.full_like(lines, row) for row in (2.0, SILL, SHOULDER + 0.6)]
        reference, low, high = (self._locate_uncut(lines, row)[line] for row in rows)
        for axle in self.form.axles:
            ahead = reference[:, 0] - self.x_at(axle)
            _cut_arch(points, ahead, (low[:, 2], high[:, 2]), v, self.wheel_m)
        return points

    def compute_normals(self, u: ArrayLike, v: ArrayLike) -> Float64Array:
        """Compute the outward normals (n, 3) at u and v."""
        u, v = (np.array(item, dtype=np.float64) for item in np.broadcast_arrays(u, v))
        along = self.locate(u + _STEP, v) - self.locate(u - _STEP, v)
        upward = self.locate(u, v + _STEP) - self.locate(u, v - _STEP)
        return normalize(np.cross(along, upward) + 1e-12)

    def build_patch(self, u: ArrayLike, v: ArrayLike, lift_m: ArrayLike = 0.0) -> TriangleSurface:
        """Build the sheet over lines u (n,) and v (m,), lifted by one distance or (n, m)."""
        u, v = np.asarray(u, dtype=np.float64), np.asarray(v, dtype=np.float64)
        grid_u, grid_v = (grid.ravel() for grid in np.meshgrid(u, v, indexing="ij"))
        points = self.locate(grid_u, grid_v)
        if np.any(lift_m):
            lift = np.broadcast_to(lift_m, (len(u), len(v))).reshape(-1, 1)
            points += lift * self.compute_normals(grid_u, grid_v)
        i, j = np.meshgrid(np.arange(len(u) - 1), np.arange(len(v) - 1), indexing="ij")
        a = (i * len(v) + j).ravel()
        b = a + len(v)
        triangles = np.stack([a, b, b + 1, a, b + 1, a + 1], axis=-1).reshape(-1, 3)
        return TriangleSurface(points, triangles)

    def _locate_uncut(self, u: Float64Array, v: Float64Array) -> Float64Array:
        column, along = _compute_weights(u, COLUMN_COUNT)
        row, upward = _compute_weights(v, CENTRE + 1)
        near = self._cage[column[:, :, None], row[:, None, :]]
        return np.einsum("nijk,ni,nj->nk", near, along, upward)


def _compute_weights(at: Float64Array, count: int) -> tuple[np.ndarray, Float64Array]:
    """Compute the four points (n, 4) of a cubic B-spline around parameters, and their weights."""
    first = np.clip(np.floor(at).astype(np.int64), 0, count - 2)
    t = at - first
    weights = [(1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, -3 * t**3 + 3 * t**2 + 3 * t + 1, t**3]
    return first[:, None] + np.arange(4), np.stack(weights, axis=-1) / 6


def _cut_arch(
    points: Float64Array,
    ahead: Float64Array,
    heights: tuple[Float64Array, Float64Array],
    v: Float64Array,
    wheel_m: float,
) -> None:
    """Raise the lower edge of points (n, 3) around a wheel in place, with a bulging edge.

    `ahead` (n,) is their distance from the axle; between `heights` the flank gives way.
    """
    low, high = heights
    radius = ARCH_RADII * wheel_m
    arch = np.minimum(wheel_m + np.sqrt(np.maximum(radius**2 - ahead**2, 0.0)), high - 0.04)
    inside = (np.abs(ahead) < radius) & (v < SHOULDER + 0.6)
    fraction = np.clip((points[:, 2] - low) / (high - low), 0.0, 1.0)
    points[inside, 2] = (arch + fraction * (high - arch))[inside]
    away = np.abs(np.hypot(ahead, points[:, 2] - wheel_m) - radius)
    bulge = _FLARE_M * np.exp(-((away / _FLARE_WIDTH_M) ** 2)) * np.clip(v, 0, 1)
    points[:, 1] += np.where(v < SHOULDER + 0.6, bulge, 0.0)
