"""Rays of a radar: evenly spread, and closer towards road users, poles, signs and rails.

Rays at the edges of flashing areas, where surfaces mirror them back, are closer still.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from advercity_dsl import Radar
from numpy.typing import NDArray

from advercity.frames import ActorState
from advercity.geometry.arrays import Float64Array, FloatArray, IndexArray
from advercity.rendering.raycaster import Raycaster, Rays
from advercity.sensors.radar.antenna import build_directions, compute_angles
from advercity.sensors.radar.placement import PlacedRadar

SPACING_M = 0.1
"""Largest distance between rays on road users and thin things: ten meet a corner of 0.3 m."""
FLASH_SPACING_M = 0.025
"""Largest distance between rays at the edge of a flashing area: 80 meet a corner of 0.3 m."""
MAX_FLASH_PARTS = 4
"""Largest number of parts, in each direction, of a ray at such an edge."""
_UNIT_CORNERS = np.indices((2, 2, 2)).reshape(3, 8).T == 1
"""(8, 3) whether a corner of a box is on its upper side, by axis."""
_AROUND = np.delete(np.indices((3, 3)).reshape(2, 9).T - 1, 4, axis=0)
"""(8, 2) steps to the rows and columns next to one."""


@dataclass(frozen=True, eq=False)
class RayFan:
    """Rays through the field of view.

    Attributes:
        directions: (n, 3) float32, unit, in the radar's frame.
        solid_angle_sr: (n,) float32 of each ray.
        grid: The even rays before the split.
        places: (n, 2) row and column of each, in steps of the grid from its first corner.
        parts: (n,) divisor of the step of its even ray.
    """

    directions: FloatArray
    solid_angle_sr: FloatArray
    grid: "_RayGrid"
    places: Float64Array
    parts: NDArray[np.intp]

    def split_flashes(self, flash_m: Float64Array) -> tuple[IndexArray, "RayFan"]:
        """Split the rays at the edges of flashing areas.

        Args:
            flash_m: (n,) one-way length of the path of each flashing ray; 0 for other rays.

        Returns:
            The rows (k,) of the split rays, and their parts.
        """
        flashes = np.flatnonzero(flash_m)
        around = self._find_around(flashes)
        at_edge = (flash_m[around] == 0.0).any(axis=1)
        # A ray next to flashing ones may be split for each of them; the longest path counts.
        reach_m = flash_m.copy()
        np.maximum.at(reach_m, around[at_edge], flash_m[flashes[at_edge], None])
        rows = np.unique(np.concatenate([flashes[at_edge], around[at_edge].ravel()]))
        spacing_m = reach_m[rows] * np.sqrt(self.solid_angle_sr[rows])
        finer = np.ceil(spacing_m / FLASH_SPACING_M).clip(1, MAX_FLASH_PARTS).astype(np.intp)
        rows, finer = rows[finer > 1], finer[finer > 1]
        return rows, self.grid.split(self.places[rows], self.parts[rows], finer)

    def _find_around(self, rows: IndexArray) -> IndexArray:
        """Find the rays (k, 8) around some, each at the distance of its own neighbours."""
        cells = np.floor(self.places).astype(np.intp)
        # Parts of an even ray are successive: the first one and their number locate them all.
        starts = np.flatnonzero(np.diff(cells, axis=0, prepend=-1).any(axis=1))
        first = np.empty((self.grid.rows, self.grid.columns), np.intp)
        first[tuple(cells[starts].T)] = starts
        places = self.places[rows, None] + _AROUND / self.parts[rows, None, None]
        places = places.clip(0.0, np.nextafter(first.shape, 0.0))
        met = np.floor(places).astype(np.intp)
        start = first[met[..., 0], met[..., 1]]
        parts = self.parts[start]
        row, column = np.moveaxis(((places - met) * parts[..., None]).astype(np.intp), -1, 0)
        return start + row * parts + column


def build_ray_fan(radar: Radar) -> RayFan:
    """Build the rays of a radar, evenly spread over azimuth and elevation.

    Rays are in rows from the lowest up, each from right to left.
    """
    return _RayGrid.from_radar(radar).build_fan()


def aim_rays(placed: PlacedRadar, raycaster: Raycaster, states: Iterable[ActorState]) -> RayFan:
    """Build the rays of a radar, split into closer ones towards road users and thin things.

    The sum of solid angles stays the same, so echoes do not change and only their error shrinks.

    Args:
        placed: The radar.
        raycaster: Placed at the frame; surfaces hit by its rays hide road users behind them.
        states: Road users of the frame.
    """
    grid = _RayGrid.from_radar(placed.radar)
    even, pose = grid.build_fan(), placed.world_from_radar
    origins = np.tile(pose[:3, 3].astype(np.float32), (len(even.directions), 1))
    rays = Rays(origins, even.directions @ pose[:3, :3].T.astype(np.float32))
    free_m = raycaster.cast(rays, placed.radar.range_m).range_m.reshape(grid.rows, grid.columns)
    parts = np.ones(free_m.shape, np.intp)
    for corners in _locate_corners(placed, raycaster, states):
        nearest_m = float(np.linalg.norm(corners, axis=1).min())
        count = math.ceil(nearest_m * max(grid.wide_rad, grid.high_rad) / SPACING_M)
        if count > 1:
            met = grid.find_rays(corners)
            is_seen = free_m[met] > nearest_m - SPACING_M
            parts[met] = np.where(is_seen, np.maximum(parts[met], count), parts[met])
    return grid.build_fan(parts)


def _locate_corners(
    placed: PlacedRadar, raycaster: Raycaster, states: Iterable[ActorState]
) -> Float64Array:
    """Locate the corners (k, 8, 3) of the boxes in front of a radar, in its frame."""
    others = [state for state in states if state.actor.id != placed.carrier]
    corners = np.array([state.box.corners for state in others]).reshape(-1, 8, 3)
    world_from_body = np.array([state.world_from_body for state in others]).reshape(-1, 4, 4)
    moving = corners @ world_from_body[:, :3, :3].mT + world_from_body[:, None, :3, 3]
    low, high = raycaster.reflector_boxes[:, :1], raycaster.reflector_boxes[:, 1:]
    found = np.concatenate([moving, np.where(_UNIT_CORNERS, high, low)])
    pose, range_m = placed.world_from_radar, placed.radar.range_m
    found = (found - pose[:3, 3]) @ pose[:3, :3]
    is_near = np.linalg.norm(found, axis=2).min(axis=1) < range_m
    return found[is_near & (found[..., 0] > 0.0).any(axis=1)]


@dataclass(frozen=True)
class _RayGrid:
    """Rows and columns of equal steps in elevation and azimuth."""

    rows: int
    columns: int
    high_rad: float
    wide_rad: float

    @staticmethod
    def from_radar(radar: Radar) -> "_RayGrid":
        wide_deg, high_deg = radar.azimuth_fov_deg, radar.elevation_fov_deg
        columns = max(1, round(math.sqrt(radar.rays * wide_deg / high_deg)))
        rows = max(1, round(radar.rays / columns))
        return _RayGrid(
            rows, columns, math.radians(high_deg) / rows, math.radians(wide_deg) / columns
        )

    def find_rays(self, corners: Float64Array) -> tuple[slice, slice]:
        """Find the rows and columns around a box, by its corners (8, 3)."""
        azimuth, elevation = compute_angles(corners / np.linalg.norm(corners, axis=1)[:, None])
        # A box behind the radar does not reach around it.
        middle = math.atan2(*corners.mean(axis=0)[[1, 0]])
        azimuth = middle + np.angle(np.exp(1j * (azimuth - middle)))
        row, column = elevation / self.high_rad, azimuth / self.wide_rad
        return _find_steps(row, self.rows), _find_steps(column, self.columns)

    def build_fan(self, parts: NDArray[np.intp] | None = None) -> RayFan:
        """Build rays; each is split into its number of `parts` (rows, columns), squared."""
        if parts is None:
            return _build_even_fan(self)
        cells = np.indices(parts.shape, np.float64).reshape(2, -1).T + 0.5
        return self.split(cells, np.ones(len(cells), np.intp), parts.ravel())

    def split(
        self, places: Float64Array, parts: NDArray[np.intp], finer: NDArray[np.intp]
    ) -> RayFan:
        """Split rays at `places` (n, 2), parts of a step, into `finer` (n,) rows and columns."""
        pieces = [
            self._split_alike(places[finer == count], parts[finer == count], int(count))
            for count in np.unique(finer)
        ] or [(places, parts)]
        place = np.concatenate([piece[0] for piece in pieces])
        part = np.concatenate([piece[1] for piece in pieces])
        middle = np.array([self.rows / 2, self.columns / 2])
        elevation, azimuth = ((place - middle) * [self.high_rad, self.wide_rad]).T
        area = self.high_rad * self.wide_rad / part**2
        return RayFan(
            build_directions(azimuth, elevation).astype(np.float32),
            (np.cos(elevation) * area).astype(np.float32),
            *(self, place, part),
        )

    @staticmethod
    def _split_alike(
        places: Float64Array, parts: NDArray[np.intp], count: int
    ) -> tuple[Float64Array, NDArray[np.intp]]:
        """Split rays (n, 2) into `count` rows and columns each: their places and parts."""
        within = (np.arange(count) + 0.5) / count - 0.5
        offsets = np.stack(np.meshgrid(within, within, indexing="ij"), axis=-1).reshape(-1, 2)
        split = places[:, None] + offsets / parts[:, None, None]
        return split.reshape(-1, 2), np.repeat(parts * count, count**2)


@lru_cache(maxsize=8)
def _build_even_fan(grid: _RayGrid) -> RayFan:
    fan = grid.build_fan(np.ones((grid.rows, grid.columns), np.intp))
    fan.directions.flags.writeable = False
    return fan


def _find_steps(places: Float64Array, count: int) -> slice:
    """Find the steps in an interval of places, which count from the middle of `count` steps."""
    first, last = math.floor(places.min() + count / 2), math.floor(places.max() + count / 2)
    return slice(max(first, 0), max(last + 1, 0))
