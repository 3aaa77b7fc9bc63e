"""Which lamps matter where, as lists that the shaders read, so that hundreds of them stay cheap.

A surface looks up the lamps of its cell of the ground, and on wet ground those of the bearing it is
seen under, whose mirrored images it may show from far beyond their reach. Air looks up the lamps
whose glow may be seen in its tile of the picture. Lamps fade to nothing where lists end, so that no
edges show.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from advercity.rendering.backend import CameraView
from advercity.rendering.lamps import BEAMS, Kind, LitLamp, lens_share
from advercity.weather.atmosphere import Atmosphere
from advercity_sapien.tables import COLUMNS, KILO, LIST_ROWS

Array = NDArray[np.floating[Any]]

CELLS, PER_CELL = 32, 16
"""Along both edges of the ground that has lamps."""
TILES_HIGH, TILES_WIDE, PER_TILE = 18, 32, 12
BEARINGS, PER_BEARING = 64, 8
"""Of all around, clockwise from -180 degrees."""
MARGIN_M = 60.0
"""Around the lamps that the cells cover."""

REACH_M = 120.0
"""What a lamp lights at most."""
FAINT_SHARE = 0.02
"""Of the light that is everywhere: what need not be shown."""
FAINTEST_LX, FAINTEST_CD_M2 = 1e-3, 1e-4
VEIL_SHARE = 0.05
"""Of the airlight: glow that need not be shown."""
MOUNTED_M = 6.0
"""From a street lamp to what it lights, at least."""
WIDE_BEAM_RAD = np.radians(12.0)
"""Spread of a dipped beam to either side."""
STRAY_BEAM = 0.1
"""Of a dipped beam's peak, what goes up and to the sides where others look into it."""
BEAM_M, BEAMS_AROUND, BEAM_SEEN_M = 40.0, 4, 60.0
"""Length of a beam in fog; how many are seen from all sides, and from how far."""
BEAM_GLOW = 4e-3
"""Luminance of a beam seen from behind, by its peak and the extinction (weather reference)."""
HALO, HALO_FALL = 75.0, 1.9
"""Glow of a lamp one degree off it (weather reference, halos in fog), and its fall with angle."""
HALO_RAD = np.radians(60.0)
AROUND_RAD = np.radians(9.0)
"""To the side of a lamp, where a wet road does not mirror it any more."""
NO_WINDOW = -2.0


class LampLists:
    """The lamps of a frame and where each of them matters."""

    def __init__(self, lamps: Sequence[LitLamp], atmosphere: Atmosphere) -> None:
        # Where there are more than the table holds, the faintest stay dark.
        brightest = sorted(lamps, key=lambda lamp: -lamp.intensity_cd)[:COLUMNS]
        self._position = np.array([lamp.position for lamp in brightest]).reshape(-1, 3)
        self._facing = np.array([lamp.facing for lamp in brightest]).reshape(-1, 3)
        self._kind = np.array([lamp.kind for lamp in brightest], dtype=int)
        self._is_beam = np.isin(self._kind, list(BEAMS))
        self._intensity_cd = np.array([lamp.intensity_cd for lamp in brightest])
        self._open_m = np.array([lamp.open_m for lamp in brightest])
        self._colour = np.array([lamp.colour for lamp in brightest]).reshape(-1, 3)
        self._extinction = atmosphere.extinction_550nm
        self._faint_lx = max(FAINT_SHARE * (atmosphere.street_lx + atmosphere.sky_lx), FAINTEST_LX)
        self._faint_cd_m2 = max(VEIL_SHARE * max(atmosphere.airlight_low), FAINTEST_CD_M2)
        self._reach_m = self._reaches()
        self.ground = self._ground()
        self._cells = self._of_cells()

    def rows(self, view: CameraView) -> NDArray[np.float32]:
        """The table's rows (16, COLUMNS, 4) for a camera."""
        table = np.full((sum(LIST_ROWS.values()), COLUMNS, 4), -1.0, dtype=np.float32)
        count = len(self._kind)
        if count:
            window, tiles = self._of_tiles(view)
            table[0, :count] = np.column_stack([self._position, self._kind])
            table[1, :count] = np.column_stack([self._facing, window])
            light = self._colour * (self._intensity_cd * KILO)[:, None]
            table[2, :count] = np.column_stack([light, self._reach_m])
            lists = (self._cells, tiles, self._of_bearings(view))
            first = LIST_ROWS["lamps"]
            for entries, height in zip(lists, list(LIST_ROWS.values())[1:], strict=True):
                table[first : first + height].reshape(-1)[: entries.size] = entries.ravel()
                first += height
        return table

    def _reaches(self) -> Array:
        """Where each lamp's light falls below what need not be shown."""
        street = np.cbrt(MOUNTED_M * self._intensity_cd / self._faint_lx)
        other = np.sqrt(self._intensity_cd / self._faint_lx)
        faint = np.where(self._kind == Kind.STREET, street, other)
        return np.minimum(faint, np.minimum(self._open_m, REACH_M))

    def _ground(self) -> tuple[float, float, float, float]:
        """South-western corner of the cells and how many of them go into a metre."""
        if not len(self._kind):
            return 0.0, 0.0, 1.0, 1.0
        low = self._position[:, :2].min(axis=0) - MARGIN_M
        size = self._position[:, :2].max(axis=0) + MARGIN_M - low
        return float(low[0]), float(low[1]), CELLS / float(size[0]), CELLS / float(size[1])

    def _of_cells(self) -> NDArray[np.float32]:
        """Lamps (cells, PER_CELL) by what they give to the brightest place of each cell."""
        x, y, per_x, per_y = self.ground
        middle = np.arange(CELLS) + 0.5
        grid = np.stack(np.meshgrid(x + middle / per_x, y + middle / per_y), axis=-1).reshape(-1, 2)
        half_m = np.hypot(0.5 / per_x, 0.5 / per_y)
        away = grid[:, None] - self._position[None, :, :2]
        distance = np.hypot(away[..., 0], away[..., 1])
        nearest = np.maximum(distance - half_m, 0.0)
        aside = _aside(away, distance, self._facing[:, :2])
        cell_rad = np.arcsin(half_m / np.maximum(distance, half_m))
        # Around a lamp within it a cell lies in every direction, also where its middle is behind.
        aside = np.where(distance < half_m, 0.0, np.maximum(aside - cell_rad, 0.0))
        lux = self._intensity_cd * np.select(
            [self._kind == Kind.STREET, self._is_beam],
            [
                MOUNTED_M / (nearest**2 + MOUNTED_M**2) ** 1.5,
                _beam(aside) / (nearest**2 + 2.0),
            ],
            lens_share(np.cos(aside)) / (nearest**2 + 1.0),
        )
        lux[nearest > self._reach_m] = 0.0
        return _best(lux, PER_CELL, self._faint_lx)

    def _of_tiles(self, view: CameraView) -> tuple[Array, NDArray[np.float32]]:
        """Cosine within which each lamp's glow is seen, and lamps (tiles, PER_TILE) by it."""
        eye = view.world_from_camera[:3, 3]
        away = self._position - eye
        distance = np.maximum(np.linalg.norm(away, axis=1), 0.1)
        left = np.exp(-self._extinction * distance)
        glow = HALO * self._towards(eye) * self._extinction * left / distance
        angle = np.radians((glow / self._faint_cd_m2) ** (1.0 / HALO_FALL))
        around = (angle > HALO_RAD) | self._near_beams(eye)
        window = np.where(around, NO_WINDOW, np.cos(np.minimum(angle, HALO_RAD)))

        rays, radius = _tile_rays(view)
        ways = (away / distance[:, None]).astype(np.float32)
        off = np.arccos(np.clip(rays.astype(np.float32) @ ways.T, -1.0, 1.0)) - radius
        score = glow * np.degrees(np.maximum(off, np.radians(0.5))) ** -HALO_FALL
        score = np.where(off > np.where(around, np.pi, angle), 0.0, score)
        score += np.where(around, 1e6 / distance, 0.0)
        return window, _best(score, PER_TILE, 0.0)

    def _of_bearings(self, view: CameraView) -> NDArray[np.float32]:
        """Lamps (BEARINGS, PER_BEARING) by how bright the road mirrors them."""
        away = self._position - view.world_from_camera[:3, 3]
        distance = np.maximum(np.linalg.norm(away, axis=1), 1.0)
        lux = self._towards(view.world_from_camera[:3, 3]) / distance**2
        bearing = np.arctan2(away[:, 1], away[:, 0])
        middle = (np.arange(BEARINGS) + 0.5) * (2.0 * np.pi / BEARINGS) - np.pi
        apart = np.abs(np.mod(middle[:, None] - bearing + np.pi, 2.0 * np.pi) - np.pi)
        seen = apart < AROUND_RAD + np.pi / BEARINGS
        return _best(np.where(seen, lux, 0.0), PER_BEARING, FAINTEST_LX)

    def _towards(self, eye: Array) -> Array:
        """Intensity (n,) in cd that each lamp sends about where it is looked at from."""
        away = eye - self._position
        distance = np.maximum(np.linalg.norm(away, axis=1), 0.1)
        level = np.maximum(np.hypot(away[:, 0], away[:, 1]), 0.1)
        aside = _aside(away[:, :2], level, self._facing[:, :2])
        return self._intensity_cd * np.select(
            [self._kind == Kind.STREET, self._is_beam],
            [
                np.maximum(MOUNTED_M / np.maximum(distance, MOUNTED_M), 0.3),
                STRAY_BEAM * _beam(aside),
            ],
            lens_share(np.cos(aside)),
        )

    def _near_beams(self, eye: Array) -> NDArray[np.bool_]:
        """Dipped beams that cross the air about the eye."""
        away = eye - self._position
        along = np.clip((away * self._facing).sum(axis=1), 0.0, BEAM_M)
        distance = np.linalg.norm(away - along[:, None] * self._facing, axis=1)
        shown = BEAM_GLOW * self._intensity_cd * self._extinction > self._faint_cd_m2
        distance[~self._is_beam | (distance > BEAM_SEEN_M) | ~shown] = np.inf
        near = np.zeros(len(distance), dtype=bool)
        near[np.argsort(distance, kind="stable")[:BEAMS_AROUND]] = True
        return near & np.isfinite(distance)


def _beam(aside_rad: Array) -> Array:
    """Of a dipped beam's peak, to the side of its axis."""
    return np.where(aside_rad < np.pi / 2, np.exp(-0.5 * (aside_rad / WIDE_BEAM_RAD) ** 2), 0.0)


def _aside(away: Array, distance: Array, facing: Array) -> Array:
    """Angle (...) between level vectors (..., 2) of that length and where lamps (n, 2) face."""
    return np.arccos(np.clip((away * facing).sum(axis=-1) / np.maximum(distance, 1e-3), -1.0, 1.0))


def _best(score: Array, most: int, above: float) -> NDArray[np.float32]:
    """Columns (n, most) of the highest scores (n, lamps) in each row; -1 behind the last."""
    best = np.full((len(score), most), -1.0, dtype=np.float32)
    # Most lamps matter nowhere in the list, and partitions of nothing but ties are slow.
    lamps = np.flatnonzero((score > above).any(axis=0))
    rows = np.flatnonzero((score > above).any(axis=1))
    score = score[np.ix_(rows, lamps)]
    order = np.broadcast_to(np.arange(len(lamps)), score.shape)
    if len(lamps) > most:
        order = np.argpartition(score, -most, axis=1)[:, -most:]
    ranking = np.argsort(-np.take_along_axis(score, order, axis=1), axis=1, kind="stable")
    order = np.take_along_axis(order, ranking, axis=1)
    found = np.take_along_axis(score, order, axis=1)
    best[rows, : order.shape[1]] = np.where(found > above, lamps[order], -1)
    return best


def _tile_rays(view: CameraView) -> tuple[Array, float]:
    """Directions (tiles, 3) through the middles of a picture's tiles, and their angular radius."""
    aside = np.tan(view.horizontal_fov_rad / 2.0)
    up = aside * view.height_px / view.width_px
    column = (1.0 - 2.0 * (np.arange(TILES_WIDE) + 0.5) / TILES_WIDE) * aside
    row = (1.0 - 2.0 * (np.arange(TILES_HIGH) + 0.5) / TILES_HIGH) * up
    left, above = np.meshgrid(column, row)
    rays = np.stack([np.ones_like(left), left, above], axis=-1).reshape(-1, 3)
    rays = rays @ view.world_from_camera[:3, :3].T
    return (
        rays / np.linalg.norm(rays, axis=1, keepdims=True),
        float(np.hypot(aside / TILES_WIDE, up / TILES_HIGH)),
    )
