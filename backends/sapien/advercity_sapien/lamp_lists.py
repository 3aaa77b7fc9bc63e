"""Lists of the relevant lamps by place: shaders stay cheap with hundreds of lamps.

A surface looks up all relevant lamps of its cell of the ground and, if it is wet, the lamps of
the bearing under which it is seen: it may mirror them from far beyond their range. Air looks up the
lamps whose glow may be seen in its tile of the image. Lamps fade out where lists end.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from advercity.geometry.arrays import Float32Array, FloatArray
from advercity.physics.atmosphere import Atmosphere
from advercity.physics.lamp_beams import BEAMS, LENS, LOW_BEAM, LampPattern, LightSource
from advercity.physics.scattering import PhaseLobes
from advercity.rendering.backend import CameraView
from advercity.rendering.fog_beams import DROPLET_UM
from advercity_sapien.shader_table import (
    BEARINGS,
    CELL_LAMPS,
    COLUMNS,
    GRID_CELLS,
    KILO,
    LAMPS_PER_BEARING,
    LAMPS_PER_TILE,
    TILES_HIGH,
    TILES_WIDE,
    ShaderTable,
)

GRID_MARGIN_M = 60.0
"""Margin of the cells around all lamps and the ends of all beams."""
MAX_RANGE_M = 300.0
"""Longest distance lit by a lamp."""
NEGLIGIBLE_FRACTION = 1e-3
"""Negligible fraction of the light present everywhere."""
MIN_ILLUMINANCE_LX, MIN_LUMINANCE_CD_M2 = 1e-3, 1e-4
NEGLIGIBLE_SKY_FRACTION = 0.01
"""Fraction of the sky's mean luminance below which glow is left out.

The airlight is no measure: it belongs to air without end, and clear air hides no glow.
"""
MAX_SCATTERED_FRACTION = 0.05
"""Greatest ratio of light scattered out of a beam by fog, at a point, to its light in clear air."""
DROPLETS = PhaseLobes.from_diameter_um(DROPLET_UM)
STREET_LAMP_HEIGHT_M = 6.0
"""Least height of a street lamp above lit surfaces."""
LOW_BEAM_SIGMA_RAD = np.radians(LOW_BEAM.horizontal_sigma_deg)
"""Horizontal spread of a low beam; front fog lamps are wider, which only costs list entries."""
STRAY_BEAM_FRACTION = 0.1
"""Fraction of a beam's peak leaving it upwards and to the sides, into the eyes of others."""
FOG_BEAM_LENGTH_M, MAX_NEARBY_BEAMS, BEAM_VISIBLE_RANGE_M = 40.0, 6, 60.0
"""Length of a beam in fog; number of beams visible from all sides, and from how far."""
BEAM_LUMINANCE_FACTOR = 4e-3
"""Luminance of a beam seen from behind, by its peak and the extinction (weather reference)."""
HALO_COEFFICIENT, HALO_EXPONENT = 75.0, 1.9
"""Glow of a lamp one degree off it (weather reference, halos in fog), and its fall with angle."""
HALO_MAX_RAD = np.radians(60.0)
PAIR_MERGE_M, MAX_PAIR_WIDTH_M = 30.0, 2.5
"""Distance beyond which a pair of lamps lights as one between them, with shadows of the first."""
MIRROR_HALF_ANGLE_RAD = np.radians(9.0)
"""Horizontal angle off a lamp beyond which a wet road does not mirror it."""
NO_ANGLE_LIMIT = -2.0
"""Cosine of a lamp whose glow is seen all around."""


class LampLists:
    """The lamps of a frame and the lists in which they are.

    Attributes:
        lamps: Lamps in the order of the table, the brightest first.
        cell_grid: South-western corner (x, y) of the cells in metres, and cells per metre.
    """

    def __init__(self, lamps: Sequence[LightSource], atmosphere: Atmosphere) -> None:
        # If there are more than the table holds, the faintest stay dark.
        brightest = sorted(lamps, key=lambda lamp: -lamp.intensity_cd)[:COLUMNS]
        self.lamps = brightest
        self._position = np.array([lamp.position for lamp in brightest]).reshape(-1, 3)
        self._facing = np.array([lamp.facing for lamp in brightest]).reshape(-1, 3)
        self._kind = np.array([lamp.pattern for lamp in brightest], dtype=int)
        self._is_beam = np.isin(self._kind, list(BEAMS))
        self._intensity_cd = np.array([lamp.intensity_cd for lamp in brightest])
        self._free_path_m = np.array([lamp.unobstructed_m for lamp in brightest])
        self._colour = np.array([lamp.colour for lamp in brightest]).reshape(-1, 3)
        self._extinction = atmosphere.extinction.at_550nm
        faint_lx = NEGLIGIBLE_FRACTION * (atmosphere.street_lx + atmosphere.sky_lx)
        self._faint_lx = max(faint_lx, MIN_ILLUMINANCE_LX)
        faint_cd_m2 = NEGLIGIBLE_SKY_FRACTION * atmosphere.sky_lx / np.pi
        self._faint_cd_m2 = max(faint_cd_m2, MIN_LUMINANCE_CD_M2)
        self._range_m = self._compute_ranges()
        self._is_paired = self._find_pairs()
        self.cell_grid = self._compute_cell_grid()
        self._cells, self._cell_lamps = self._list_by_cell()

    def write_to(self, table: ShaderTable, view: CameraView) -> None:
        """Write the lamps and their lists for a camera into the table."""
        min_cosine, tiles = self._list_by_tile(view)
        light = self._colour * (self._intensity_cd * KILO)[:, None]
        count = len(self._kind)
        lamps = table.section("lamps").reshape(COLUMNS, 4, 4)
        lamps[:count, 0] = np.column_stack([self._position, self._range_m])
        lamps[:count, 1] = np.column_stack([self._facing, min_cosine])
        lamps[:count, 2] = np.column_stack([light, self._kind])
        lamps[:count, 3, 0] = self._free_path_m
        # From the first of a pair to the middle of both.
        lamps[: max(count - 1, 0), 3, 1:] = np.diff(self._position, axis=0) / 2.0
        lists = {"cell_lamps": self._cell_lamps, "tiles": tiles}
        lists["bearings"] = self._list_by_bearing(view)
        table.section("cells").reshape(-1, 4)[: GRID_CELLS**2, :2] = self._cells
        for name, entries in lists.items():
            table.section(name).reshape(-1)[: entries.size] = entries.ravel()

    def _compute_ranges(self) -> FloatArray:
        """Compute the distance (n,) at which each lamp's light becomes negligible, metres."""
        street = np.cbrt(STREET_LAMP_HEIGHT_M * self._intensity_cd / self._faint_lx)
        other = np.sqrt(self._intensity_cd / self._faint_lx)
        return np.minimum(np.where(self._kind == LampPattern.STREET, street, other), MAX_RANGE_M)

    def _find_pairs(self) -> NDArray[np.bool_]:
        """Find lamps (n,) at the first place of a pair; the second is the next lamp."""
        first, second = slice(None, -1), slice(1, None)
        width = np.linalg.norm(np.diff(self._position, axis=0), axis=1)
        alike = (
            (self._kind[first] == self._kind[second])
            & (self._intensity_cd[first] == self._intensity_cd[second])
            & np.all(self._facing[first] == self._facing[second], axis=1)
            & (self._kind[first] != LampPattern.STREET)
            & (width < MAX_PAIR_WIDTH_M)
        )
        is_first = np.zeros(len(self._kind), dtype=bool)
        for lamp in np.flatnonzero(alike):
            is_first[lamp] = lamp == 0 or not is_first[lamp - 1]
        return is_first

    def _compute_cell_grid(self) -> tuple[float, float, float, float]:
        """Compute the south-western corner of the cells, and cells per metre."""
        if not len(self._kind):
            return 0.0, 0.0, 1.0, 1.0
        beams = self._facing[:, :2] * (self._range_m * self._is_beam)[:, None]
        lit = np.concatenate([self._position[:, :2], self._position[:, :2] + beams])
        low = lit.min(axis=0) - GRID_MARGIN_M
        size = lit.max(axis=0) + GRID_MARGIN_M - low
        per_m = GRID_CELLS / size
        return float(low[0]), float(low[1]), float(per_m[0]), float(per_m[1])

    def _list_by_cell(self) -> tuple[NDArray[np.int_], Float32Array]:
        """List lamps lighting a point of a cell more than faintly.

        First texels of the lists of cells and the ones after their last (cells, 2), and the lamps
        of all lists (CELL_LAMPS,), four in a texel, -1 where there is none.
        """
        x, y, per_x, per_y = self.cell_grid
        middle = np.arange(GRID_CELLS) + 0.5
        grid = np.stack(np.meshgrid(x + middle / per_x, y + middle / per_y), axis=-1).reshape(-1, 2)
        half_m = np.hypot(0.5 / per_x, 0.5 / per_y)
        away = grid[:, None] - self._position[None, :, :2]
        distance = np.hypot(away[..., 0], away[..., 1])
        nearest = np.maximum(distance - half_m, 0.0)
        off_axis = _horizontal_angle(away, distance, self._facing[:, :2])
        cell_rad = np.arcsin(half_m / np.maximum(distance, half_m))
        # The lamp's own cell is in every direction from it, whatever the direction of its middle.
        off_axis = np.where(distance < half_m, 0.0, np.maximum(off_axis - cell_rad, 0.0))
        lux = self._intensity_cd * np.select(
            [self._kind == LampPattern.STREET, self._is_beam],
            [
                STREET_LAMP_HEIGHT_M / (nearest**2 + STREET_LAMP_HEIGHT_M**2) ** 1.5,
                _beam_fraction(off_axis) / (nearest**2 + 2.0),
            ],
            LENS.relative_intensity(np.cos(off_axis)) / (nearest**2 + 1.0),
        )
        lux *= self._fraction_left(nearest)
        lux[nearest > self._range_m] = 0.0
        merged = self._is_paired & (nearest > PAIR_MERGE_M)
        # The first stands for both, if the second is in range.
        merged[:, :-1] &= lux[:, 1:] > 0.0
        lux[:, 1:][merged[:, :-1]] = 0.0
        return _pack_lists(np.where(merged, 2.0, 1.0) * lux, merged, self._faint_lx)

    def _fraction_left(self, distance: FloatArray) -> FloatArray:
        """Compute the fraction (cells, n) of lamps' light left by fog at distances (cells, n).

        As in the shaders, street lamps lose no light, and fog scatters a part of a beam down.
        """
        left = np.exp(-DROPLETS.wide_fraction * self._extinction * distance)
        left += MAX_SCATTERED_FRACTION * (1.0 - left)
        return np.where(self._kind == LampPattern.STREET, 1.0, left)

    def _list_by_tile(self, view: CameraView) -> tuple[FloatArray, Float32Array]:
        """List lamps (tiles, LAMPS_PER_TILE) by their glow.

        The first result (n,) is the least cosine off each lamp at which its glow is seen.
        """
        eye = view.world_from_camera[:3, 3]
        away = self._position - eye
        distance = np.maximum(np.linalg.norm(away, axis=1), 0.1)
        left = np.exp(-self._extinction * distance)
        glow = HALO_COEFFICIENT * self._intensity_towards(eye) * self._extinction * left / distance
        angle = np.radians((glow / self._faint_cd_m2) ** (1.0 / HALO_EXPONENT))
        nearness = np.where(angle > HALO_MAX_RAD, 1.0, self._compute_nearness(eye))
        around = nearness > 0.0
        limit = np.cos(np.minimum(angle, HALO_MAX_RAD))
        min_cosine = np.where(around, NO_ANGLE_LIMIT - 1.0 + nearness, limit)

        rays, radius = _compute_tile_rays(view)
        directions = (away / distance[:, None]).astype(np.float32)
        # Not a product of matrices: its threads would idle, busily, while the image is drawn.
        cosine = np.einsum("tk,nk->tn", rays.astype(np.float32), directions)
        off = np.arccos(np.clip(cosine, -1.0, 1.0)) - radius
        score = glow * np.degrees(np.maximum(off, np.radians(0.5))) ** -HALO_EXPONENT
        score = np.where(off > np.where(around, np.pi, angle), 0.0, score)
        score += np.where(around, 1e6 / distance, 0.0)
        return min_cosine, _select_highest(score, LAMPS_PER_TILE, 0.0)

    def _list_by_bearing(self, view: CameraView) -> Float32Array:
        """List lamps (BEARINGS, LAMPS_PER_BEARING) by the brightness of their mirror images."""
        away = self._position - view.world_from_camera[:3, 3]
        distance = np.maximum(np.linalg.norm(away, axis=1), 1.0)
        lux = self._intensity_towards(view.world_from_camera[:3, 3]) / distance**2
        bearing = np.arctan2(away[:, 1], away[:, 0])
        middle = (np.arange(BEARINGS) + 0.5) * (2.0 * np.pi / BEARINGS) - np.pi
        off = np.abs(np.mod(middle[:, None] - bearing + np.pi, 2.0 * np.pi) - np.pi)
        seen = off < MIRROR_HALF_ANGLE_RAD + np.pi / BEARINGS
        return _select_highest(np.where(seen, lux, 0.0), LAMPS_PER_BEARING, MIN_ILLUMINANCE_LX)

    def _intensity_towards(self, eye: FloatArray) -> FloatArray:
        """Compute the rough intensity (n,) in cd of each lamp towards an eye (3,)."""
        away = eye - self._position
        distance = np.maximum(np.linalg.norm(away, axis=1), 0.1)
        level = np.maximum(np.hypot(away[:, 0], away[:, 1]), 0.1)
        off_axis = _horizontal_angle(away[:, :2], level, self._facing[:, :2])
        return self._intensity_cd * np.select(
            [self._kind == LampPattern.STREET, self._is_beam],
            [
                np.maximum(STREET_LAMP_HEIGHT_M / np.maximum(distance, STREET_LAMP_HEIGHT_M), 0.3),
                STRAY_BEAM_FRACTION * _beam_fraction(off_axis),
            ],
            LENS.relative_intensity(np.cos(off_axis)),
        )

    def _compute_nearness(self, eye: FloatArray) -> FloatArray:
        """Compute how much (n,) of beams around an eye (3,) is seen from all sides, 0 to 1.

        The few nearest ones are in every tile, and fade with their distance to nothing.
        """
        away = eye - self._position
        along = np.clip((away * self._facing).sum(axis=1), 0.0, FOG_BEAM_LENGTH_M)
        distance = np.linalg.norm(away - along[:, None] * self._facing, axis=1)
        shown = BEAM_LUMINANCE_FACTOR * self._intensity_cd * self._extinction > self._faint_cd_m2
        distance[~self._is_beam | ~shown] = np.inf
        order = np.argsort(distance, kind="stable")
        ends_m = BEAM_VISIBLE_RANGE_M
        if len(order) > MAX_NEARBY_BEAMS:
            ends_m = min(ends_m, float(distance[order[MAX_NEARBY_BEAMS]]))
        fade = np.clip(1.0 - (distance / max(ends_m, 1e-3)) ** 4, 0.0, 1.0)
        return np.where(np.isfinite(distance), fade, 0.0)


def _beam_fraction(aside_rad: FloatArray) -> FloatArray:
    """Compute the fraction (...) of a low beam's peak at horizontal angles off its axis."""
    fraction = np.exp(-0.5 * (aside_rad / LOW_BEAM_SIGMA_RAD) ** 2)
    return np.where(aside_rad < np.pi / 2, fraction, 0.0)


def _horizontal_angle(away: FloatArray, distance: FloatArray, facing: FloatArray) -> FloatArray:
    """Compute the angle (...) between level vectors (..., 2) and directions of lamps (n, 2)."""
    return np.arccos(np.clip((away * facing).sum(axis=-1) / np.maximum(distance, 1e-3), -1.0, 1.0))


def _pack_lists(
    lux: FloatArray, merged: NDArray[np.bool_], above: float
) -> tuple[NDArray[np.int_], Float32Array]:
    """Pack the columns above a limit of each row (cells, lamps) as `_list_by_cell` returns them.

    Merged ones have `COLUMNS` added. If all are more than there is room for, the highest remain.
    """
    # Each list may leave three places of its last texel empty.
    room = CELL_LAMPS - 3 * len(lux)
    if lux.size > room:
        above = max(above, float(np.partition(lux, -room - 1, axis=None)[-room - 1]))
    row, lamp = np.nonzero(lux > above)
    counts = np.bincount(row, minlength=len(lux))
    ends = np.cumsum(-(-counts // 4))
    first = np.concatenate([[0], ends[:-1]])
    packed = np.full(CELL_LAMPS, -1.0, dtype=np.float32)
    place_in_list = np.arange(len(row)) - (np.cumsum(counts) - counts)[row]
    packed[4 * first[row] + place_in_list] = lamp + COLUMNS * merged[row, lamp]
    return np.stack([first, ends], axis=1), packed


def _select_highest(score: FloatArray, most: int, above: float) -> Float32Array:
    """Select the columns (n, most) of the highest scores (n, lamps) of each row, then -1."""
    best = np.full((len(score), most), -1.0, dtype=np.float32)
    # Most lamps are in no list, and a partition of ties alone is slow.
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
    """Compute directions (tiles, 3) through the middles of tiles, and a tile's angular radius."""
    half_width = np.tan(view.horizontal_fov_rad / 2.0)
    half_height = half_width * view.height_px / view.width_px
    column = (1.0 - 2.0 * (np.arange(TILES_WIDE) + 0.5) / TILES_WIDE) * half_width
    row = (1.0 - 2.0 * (np.arange(TILES_HIGH) + 0.5) / TILES_HIGH) * half_height
    left, above = np.meshgrid(column, row)
    rays = np.stack([np.ones_like(left), left, above], axis=-1).reshape(-1, 3)
    rays = rays @ view.world_from_camera[:3, :3].T
    radius = float(np.hypot(half_width / TILES_WIDE, half_height / TILES_HIGH))
    return rays / np.linalg.norm(rays, axis=1, keepdims=True), radius
