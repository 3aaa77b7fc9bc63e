"""Which lamps matter where, as lists that the shaders read, so that hundreds of them stay cheap.

A surface looks up the lamps of its cell of the ground, and on wet ground those of the bearing it is
seen under, whose mirrored images it may show from far beyond their reach. Air looks up the lamps
whose glow may be seen in its tile of the picture. Lamps fade to nothing where lists end, so that no
edges show.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from advercity.geometry.arrays import FloatArray
from advercity.physics.atmosphere import Atmosphere
from advercity.physics.lamp_beams import BEAM_PATTERNS, LampPattern, LightSource, lens_pattern
from advercity.rendering.backend import CameraView
from advercity_sapien.shader_table import (
    BEARINGS,
    COLUMNS,
    GRID_CELLS,
    KILO,
    LAMP_LIST_ROWS,
    LAMPS_PER_BEARING,
    LAMPS_PER_CELL,
    LAMPS_PER_TILE,
    TILES_HIGH,
    TILES_WIDE,
)

GRID_MARGIN_M = 60.0
"""Around the lamps that the cells cover."""

MAX_RANGE_M = 120.0
"""What a lamp lights at most."""
NEGLIGIBLE_FRACTION = 0.02
"""Of the light that is everywhere: what need not be shown."""
MIN_ILLUMINANCE_LX, MIN_LUMINANCE_CD_M2 = 1e-3, 1e-4
NEGLIGIBLE_AIRLIGHT_FRACTION = 0.05
"""Of the airlight: glow that need not be shown."""
STREET_LAMP_HEIGHT_M = 6.0
"""From a street lamp to what it lights, at least."""
LOW_BEAM_SIGMA_RAD = np.radians(12.0)
"""Spread of a dipped beam to either side."""
STRAY_BEAM_FRACTION = 0.1
"""Of a dipped beam's peak, what goes up and to the sides where others look into it."""
FOG_BEAM_LENGTH_M, MAX_NEARBY_BEAMS, BEAM_VISIBLE_RANGE_M = 40.0, 4, 60.0
"""Length of a beam in fog; how many are seen from all sides, and from how far."""
BEAM_LUMINANCE_FACTOR = 4e-3
"""Luminance of a beam seen from behind, by its peak and the extinction (weather reference)."""
HALO_COEFFICIENT, HALO_EXPONENT = 75.0, 1.9
"""Glow of a lamp one degree off it (weather reference, halos in fog), and its fall with angle."""
HALO_MAX_RAD = np.radians(60.0)
MIRROR_HALF_ANGLE_RAD = np.radians(9.0)
"""To the side of a lamp, where a wet road does not mirror it any more."""
NO_ANGLE_LIMIT = -2.0


class LampLists:
    """The lamps of a frame and where each of them matters."""

    def __init__(self, lamps: Sequence[LightSource], atmosphere: Atmosphere) -> None:
        # Where there are more than the table holds, the faintest stay dark.
        brightest = sorted(lamps, key=lambda lamp: -lamp.intensity_cd)[:COLUMNS]
        self._position = np.array([lamp.position for lamp in brightest]).reshape(-1, 3)
        self._facing = np.array([lamp.facing for lamp in brightest]).reshape(-1, 3)
        self._kind = np.array([lamp.pattern for lamp in brightest], dtype=int)
        self._is_beam = np.isin(self._kind, list(BEAM_PATTERNS))
        self._intensity_cd = np.array([lamp.intensity_cd for lamp in brightest])
        self._free_range_m = np.array([lamp.unobstructed_m for lamp in brightest])
        self._colour = np.array([lamp.colour for lamp in brightest]).reshape(-1, 3)
        self._extinction = atmosphere.extinction_550nm
        self._faint_lx = max(
            NEGLIGIBLE_FRACTION * (atmosphere.street_lx + atmosphere.sky_lx), MIN_ILLUMINANCE_LX
        )
        self._faint_cd_m2 = max(
            NEGLIGIBLE_AIRLIGHT_FRACTION * max(atmosphere.horizon_airlight), MIN_LUMINANCE_CD_M2
        )
        self._range_m = self._compute_ranges()
        self.cell_grid = self._compute_cell_grid()
        self._cells = self._list_by_cell()

    def build_rows(self, view: CameraView) -> NDArray[np.float32]:
        """The table's rows (16, COLUMNS, 4) for a camera."""
        table = np.full((sum(LAMP_LIST_ROWS.values()), COLUMNS, 4), -1.0, dtype=np.float32)
        count = len(self._kind)
        if count:
            window, tiles = self._list_by_tile(view)
            table[0, :count] = np.column_stack([self._position, self._kind])
            table[1, :count] = np.column_stack([self._facing, window])
            light = self._colour * (self._intensity_cd * KILO)[:, None]
            table[2, :count] = np.column_stack([light, self._range_m])
            lists = (self._cells, tiles, self._list_by_bearing(view))
            first = LAMP_LIST_ROWS["lamps"]
            for entries, height in zip(lists, list(LAMP_LIST_ROWS.values())[1:], strict=True):
                table[first : first + height].reshape(-1)[: entries.size] = entries.ravel()
                first += height
        return table

    def _compute_ranges(self) -> FloatArray:
        """Where each lamp's light falls below what need not be shown."""
        street = np.cbrt(STREET_LAMP_HEIGHT_M * self._intensity_cd / self._faint_lx)
        other = np.sqrt(self._intensity_cd / self._faint_lx)
        faint = np.where(self._kind == LampPattern.STREET, street, other)
        return np.minimum(faint, np.minimum(self._free_range_m, MAX_RANGE_M))

    def _compute_cell_grid(self) -> tuple[float, float, float, float]:
        """South-western corner of the cells and how many of them go into a metre."""
        if not len(self._kind):
            return 0.0, 0.0, 1.0, 1.0
        low = self._position[:, :2].min(axis=0) - GRID_MARGIN_M
        size = self._position[:, :2].max(axis=0) + GRID_MARGIN_M - low
        return (
            float(low[0]),
            float(low[1]),
            GRID_CELLS / float(size[0]),
            GRID_CELLS / float(size[1]),
        )

    def _list_by_cell(self) -> NDArray[np.float32]:
        """Lamps (cells, PER_CELL) by what they give to the brightest place of each cell."""
        x, y, per_x, per_y = self.cell_grid
        middle = np.arange(GRID_CELLS) + 0.5
        grid = np.stack(np.meshgrid(x + middle / per_x, y + middle / per_y), axis=-1).reshape(-1, 2)
        half_m = np.hypot(0.5 / per_x, 0.5 / per_y)
        away = grid[:, None] - self._position[None, :, :2]
        distance = np.hypot(away[..., 0], away[..., 1])
        nearest = np.maximum(distance - half_m, 0.0)
        aside = _horizontal_angle(away, distance, self._facing[:, :2])
        cell_rad = np.arcsin(half_m / np.maximum(distance, half_m))
        # Around a lamp within it a cell lies in every direction, also where its middle is behind.
        aside = np.where(distance < half_m, 0.0, np.maximum(aside - cell_rad, 0.0))
        lux = self._intensity_cd * np.select(
            [self._kind == LampPattern.STREET, self._is_beam],
            [
                STREET_LAMP_HEIGHT_M / (nearest**2 + STREET_LAMP_HEIGHT_M**2) ** 1.5,
                _beam_fraction(aside) / (nearest**2 + 2.0),
            ],
            lens_pattern(np.cos(aside)) / (nearest**2 + 1.0),
        )
        lux[nearest > self._range_m] = 0.0
        return _select_highest(lux, LAMPS_PER_CELL, self._faint_lx)

    def _list_by_tile(self, view: CameraView) -> tuple[FloatArray, NDArray[np.float32]]:
        """Cosine within which each lamp's glow is seen, and lamps (tiles, PER_TILE) by it."""
        eye = view.world_from_camera[:3, 3]
        away = self._position - eye
        distance = np.maximum(np.linalg.norm(away, axis=1), 0.1)
        left = np.exp(-self._extinction * distance)
        glow = HALO_COEFFICIENT * self._intensity_towards(eye) * self._extinction * left / distance
        angle = np.radians((glow / self._faint_cd_m2) ** (1.0 / HALO_EXPONENT))
        around = (angle > HALO_MAX_RAD) | self._find_nearby_beams(eye)
        window = np.where(around, NO_ANGLE_LIMIT, np.cos(np.minimum(angle, HALO_MAX_RAD)))

        rays, radius = _compute_tile_rays(view)
        ways = (away / distance[:, None]).astype(np.float32)
        off = np.arccos(np.clip(rays.astype(np.float32) @ ways.T, -1.0, 1.0)) - radius
        score = glow * np.degrees(np.maximum(off, np.radians(0.5))) ** -HALO_EXPONENT
        score = np.where(off > np.where(around, np.pi, angle), 0.0, score)
        score += np.where(around, 1e6 / distance, 0.0)
        return window, _select_highest(score, LAMPS_PER_TILE, 0.0)

    def _list_by_bearing(self, view: CameraView) -> NDArray[np.float32]:
        """Lamps (BEARINGS, PER_BEARING) by how bright the road mirrors them."""
        away = self._position - view.world_from_camera[:3, 3]
        distance = np.maximum(np.linalg.norm(away, axis=1), 1.0)
        lux = self._intensity_towards(view.world_from_camera[:3, 3]) / distance**2
        bearing = np.arctan2(away[:, 1], away[:, 0])
        middle = (np.arange(BEARINGS) + 0.5) * (2.0 * np.pi / BEARINGS) - np.pi
        apart = np.abs(np.mod(middle[:, None] - bearing + np.pi, 2.0 * np.pi) - np.pi)
        seen = apart < MIRROR_HALF_ANGLE_RAD + np.pi / BEARINGS
        return _select_highest(np.where(seen, lux, 0.0), LAMPS_PER_BEARING, MIN_ILLUMINANCE_LX)

    def _intensity_towards(self, eye: FloatArray) -> FloatArray:
        """Intensity (n,) in cd that each lamp sends about where it is looked at from."""
        away = eye - self._position
        distance = np.maximum(np.linalg.norm(away, axis=1), 0.1)
        level = np.maximum(np.hypot(away[:, 0], away[:, 1]), 0.1)
        aside = _horizontal_angle(away[:, :2], level, self._facing[:, :2])
        return self._intensity_cd * np.select(
            [self._kind == LampPattern.STREET, self._is_beam],
            [
                np.maximum(STREET_LAMP_HEIGHT_M / np.maximum(distance, STREET_LAMP_HEIGHT_M), 0.3),
                STRAY_BEAM_FRACTION * _beam_fraction(aside),
            ],
            lens_pattern(np.cos(aside)),
        )

    def _find_nearby_beams(self, eye: FloatArray) -> NDArray[np.bool_]:
        """Dipped beams that cross the air about the eye."""
        away = eye - self._position
        along = np.clip((away * self._facing).sum(axis=1), 0.0, FOG_BEAM_LENGTH_M)
        distance = np.linalg.norm(away - along[:, None] * self._facing, axis=1)
        shown = BEAM_LUMINANCE_FACTOR * self._intensity_cd * self._extinction > self._faint_cd_m2
        distance[~self._is_beam | (distance > BEAM_VISIBLE_RANGE_M) | ~shown] = np.inf
        near = np.zeros(len(distance), dtype=bool)
        near[np.argsort(distance, kind="stable")[:MAX_NEARBY_BEAMS]] = True
        return near & np.isfinite(distance)


def _beam_fraction(aside_rad: FloatArray) -> FloatArray:
    """Of a dipped beam's peak, to the side of its axis."""
    return np.where(
        aside_rad < np.pi / 2, np.exp(-0.5 * (aside_rad / LOW_BEAM_SIGMA_RAD) ** 2), 0.0
    )


def _horizontal_angle(away: FloatArray, distance: FloatArray, facing: FloatArray) -> FloatArray:
    """Angle (...) between level vectors (..., 2) of that length and where lamps (n, 2) face."""
    return np.arccos(np.clip((away * facing).sum(axis=-1) / np.maximum(distance, 1e-3), -1.0, 1.0))


def _select_highest(score: FloatArray, most: int, above: float) -> NDArray[np.float32]:
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


def _compute_tile_rays(view: CameraView) -> tuple[FloatArray, float]:
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
