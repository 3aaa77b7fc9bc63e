"""Shadows of lamps in the raster pack: the reach of each lamp's light.

SAPIEN's shadow maps belong to its own lights, each with a pass over the scene, and a street has
hundreds of lamps. Here Embree casts a small map for every lamp once a frame, and all cameras
of the frame use it. The ground casts no shadows: hardly any light of a street is hidden by it,
and a texel holds many metres of it, since lamps are low.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from advercity.frames import Frame
from advercity.geometry.arrays import Float32Array, FloatArray
from advercity.physics.lamp_beams import BEAMS, LightSource
from advercity.rendering.light_sources import LAMP_HEIGHT_M
from advercity.rendering.raycaster import Raycaster, Rays
from advercity.world import World
from advercity_sapien.lamp_lists import MAX_RANGE_M
from advercity_sapien.probe_grid import GROUND_CLASSES
from advercity_sapien.shader_table import COLUMNS

HOUSING_M = 0.25
"""Distance around a lamp without obstacles to its light."""
REACH_RANGE_M = MAX_RANGE_M
CELL_COLUMNS, CELL_ROWS, CELLS_PER_ROW = 96, 24, 8
"""Texels of the texture for each lamp, of which its map fills a corner, and lamps side by side."""


@dataclass(frozen=True)
class ReachMap:
    """Layout of the map of a lamp: rays through a plane one metre ahead, evenly spaced.

    Attributes:
        columns: Texels from left to right.
        rows: Texels from bottom to top.
        half_width_m: Half of the width of the plane; beyond it the map's edge goes on.
        half_height_m: Half of its height.
    """

    columns: int
    rows: int
    half_width_m: float
    half_height_m: float

    def list_rays(self) -> FloatArray:
        """List rays (rows columns, 3): to the right, upwards, and 1 ahead."""
        right = ((np.arange(self.columns) + 0.5) / self.columns * 2.0 - 1.0) * self.half_width_m
        up = ((np.arange(self.rows) + 0.5) / self.rows * 2.0 - 1.0) * self.half_height_m
        plane = np.stack(np.meshgrid(right, up), axis=-1).reshape(-1, 2)
        return np.column_stack([plane, np.ones(len(plane))])


BEAM_REACH, LENS_REACH = ReachMap(96, 20, 1.0, 0.2), ReachMap(24, 24, 2.0, 2.0)
"""Maps of headlamps and of all other lamps. A pedestrian is 1.2 texels of a beam wide at 20 m."""
NO_SHADOWS: Float32Array = np.full((1, 1), REACH_RANGE_M, dtype=np.float32)
"""Map where no lamps are lit."""


class LampShadows:
    """Maps of the distances ahead of lamps at which their light meets a surface.

    Attributes:
        texels: (h, w) float32, metres, a cell for each lamp of the shader's table.
    """

    def __init__(self, world: World) -> None:
        casters = tuple(mesh for mesh in world.static if mesh.semantic not in GROUND_CLASSES)
        self._raycaster = Raycaster(replace(world, static=casters))
        height = COLUMNS // CELLS_PER_ROW * CELL_ROWS
        self.texels: Float32Array = np.full(
            (height, CELLS_PER_ROW * CELL_COLUMNS), REACH_RANGE_M, dtype=np.float32
        )

    def place(self, frame: Frame, lamps: Sequence[LightSource]) -> None:
        """Cast the maps of the lamps of a frame, in the order of the table."""
        self._raycaster.place(frame)
        for layout in (BEAM_REACH, LENS_REACH):
            is_beam = layout is BEAM_REACH
            rows = [row for row, lamp in enumerate(lamps) if (lamp.pattern in BEAMS) == is_beam]
            if rows:
                reach = self._cast([lamps[row] for row in rows], layout)
                if is_beam:
                    _end_above_ground(reach, layout)
                for row, reached_m in zip(rows, reach, strict=True):
                    self._write(row, reached_m)

    def _cast(self, lamps: Sequence[LightSource], layout: ReachMap) -> Float32Array:
        """Cast rays of lamps: metres ahead (lamps, rows, columns) at which they meet a surface."""
        rays = layout.list_rays()
        length = np.linalg.norm(rays, axis=1, keepdims=True)
        rays /= length
        axes = _compute_axes(np.array([lamp.facing for lamp in lamps]))
        directions = (rays @ axes).astype(np.float32)
        position = np.array([lamp.position for lamp in lamps], dtype=np.float32)
        origins = position[:, None] + np.float32(HOUSING_M) * directions
        found = self._raycaster.cast(
            Rays(origins.reshape(-1, 3), directions.reshape(-1, 3)), REACH_RANGE_M
        )
        reach_m = np.minimum(found.range_m + HOUSING_M, REACH_RANGE_M).reshape(len(lamps), -1)
        ahead_m = (reach_m / length[:, 0]).astype(np.float32)
        return ahead_m.reshape(len(lamps), layout.rows, layout.columns)

    def _write(self, number: int, reach: Float32Array) -> None:
        rows, columns = reach.shape
        row, column = divmod(number, CELLS_PER_ROW)
        row, column = row * CELL_ROWS, column * CELL_COLUMNS
        self.texels[row : row + rows, column : column + columns] = reach


def _end_above_ground(reach: Float32Array, layout: ReachMap) -> None:
    """Give rays below the ground the reach of the ones above them: they miss all walls."""
    slope = layout.list_rays()[:: layout.columns, 1]
    for row in np.flatnonzero(slope < 0.0)[::-1]:
        is_below = reach[:, row] > -LAMP_HEIGHT_M / slope[row]
        reach[:, row] = np.where(is_below, reach[:, row + 1], reach[:, row])


def _compute_axes(facing: FloatArray) -> FloatArray:
    """Compute the axes (n, 3, 3) of lamps facing directions (n, 3): right, up and ahead."""
    x, y, _ = facing.T
    level = np.hypot(x, y)
    # A lamp facing straight down has east on the right.
    is_level = level > 0.0
    level = np.where(is_level, level, 1.0)
    right = np.stack([np.where(is_level, y / level, 1.0), -x / level, np.zeros_like(x)], axis=-1)
    return np.stack([right, np.cross(right, facing), facing], axis=1)
