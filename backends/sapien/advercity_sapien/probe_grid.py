"""Places of light probes: a grid around the lanes, on the ground below trees and roofs."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from advercity.geometry.arrays import Float32Array, Float64Array, FloatArray
from advercity.rendering.raycaster import Raycaster, Rays
from advercity.semantics import Semantic
from advercity.world import World

PROBE_SPACING_M, MAX_PROBES_PER_EDGE = 3.0, 128
LEVEL_HEIGHTS_M = (0.3, 1.5, 3.5, 6.5, 11.0)
"""Heights of probes above the ground."""
MARGIN_M = 30.0
"""Greatest distance of probes from the lanes."""
RAY_OFFSET_M = 0.02
GROUND_CLASSES = (
    Semantic.ROAD,
    Semantic.ROAD_LINE,
    Semantic.SIDEWALK,
    Semantic.TERRAIN,
    Semantic.GROUND,
)
TOP_M = 500.0
"""Height above everything in a world."""


@dataclass(frozen=True, eq=False)
class ProbeGrid:
    """Places of probes.

    Attributes:
        corner: South-western corner (x, y), metres.
        spacing_m: Distance between probes, which are in the middle of cells.
        ground: Height (rows, columns) of the ground, below trees and roofs.
    """

    corner: tuple[float, float]
    spacing_m: float
    ground: Float64Array

    @property
    def columns(self) -> int:
        """Number of probes from west to east."""
        return self.ground.shape[1]

    @property
    def size(self) -> tuple[float, float]:
        """Width and height, metres."""
        return self.columns * self.spacing_m, len(self.ground) * self.spacing_m

    @property
    def turns(self) -> NDArray[np.uint16]:
        """Which set of directions each probe (n,) has."""
        row, column = np.indices(self.ground.shape)
        return (2 * (row % 2) + column % 2).ravel().astype(np.uint16)

    def list_points(self, height_m: float) -> Float32Array:
        """List the points (n, 3) at a height above the ground."""
        rows, columns = self.ground.shape
        x = self.corner[0] + (np.arange(columns) + 0.5) * self.spacing_m
        y = self.corner[1] + (np.arange(rows) + 0.5) * self.spacing_m
        points = np.stack([*np.meshgrid(x, y), self.ground + height_m], axis=-1)
        return points.reshape(-1, 3).astype(np.float32)

    def find_nearest(self, points: FloatArray) -> NDArray[np.int32]:
        """Find the probes (n,) nearest to points (n, 3), numbered by level, row and column."""
        place = np.floor((points[:, :2] - self.corner) / self.spacing_m).astype(np.int32)
        last = np.array(self.ground.shape[::-1], np.int32) - 1
        column, row = np.clip(place, 0, last).T
        between = np.convolve(LEVEL_HEIGHTS_M, (0.5, 0.5), "valid")
        level = np.searchsorted(between, points[:, 2] - self.ground[row, column])
        return ((level * len(self.ground) + row) * self.columns + column).astype(np.int32)

    def smooth(self, values: Float64Array, is_buried: NDArray[np.bool_]) -> Float64Array:
        """Smooth values (n, c) of probes, which few directions make uneven: (rows, columns, c).

        Probes inside things, (n,) `is_buried`, first get the values of the nearest outside.
        """
        filled = values.copy()
        if is_buried.any() and not is_buried.all():
            _, label = cv2.distanceTransformWithLabels(
                is_buried.reshape(self.ground.shape).astype(np.uint8),
                cv2.DIST_L2,
                5,
                labelType=cv2.DIST_LABEL_PIXEL,
            )
            label = label.ravel().astype(np.int64)
            source = np.empty(int(label.max()) + 1, dtype=np.int64)
            source[label[~is_buried]] = np.flatnonzero(~is_buried)
            filled[is_buried] = filled[source[label[is_buried]]]
        channels = filled.reshape(*self.ground.shape, -1).transpose(2, 0, 1)
        smooth = [cv2.GaussianBlur(np.ascontiguousarray(one), (3, 3), 0.0) for one in channels]
        return np.stack(smooth, axis=-1).astype(np.float64)


def place_grid(world: World) -> ProbeGrid:
    """Place the grid around the lanes."""
    points = np.concatenate([lane.left[:, :2] for lane in world.lanes])
    low, high = points.min(axis=0) - MARGIN_M, points.max(axis=0) + MARGIN_M
    spacing = max(PROBE_SPACING_M, float((high - low).max()) / MAX_PROBES_PER_EDGE)
    columns, rows = (int(count) for count in np.ceil((high - low) / spacing))
    level = ProbeGrid((float(low[0]), float(low[1])), spacing, np.zeros((rows, columns)))
    return replace(level, ground=_find_ground(world, level))


def select_static(world: World, *classes: Semantic) -> World:
    """Return a world with the static meshes of some classes alone."""
    return replace(world, static=tuple(mesh for mesh in world.static if mesh.semantic in classes))


def _find_ground(world: World, grid: ProbeGrid) -> Float64Array:
    """Find the height (rows, columns) of the ground, below trees and roofs."""
    # Rays meet the ground alone: which of two faces in one plane they would hit is not decided.
    raycaster = Raycaster(select_static(world, *GROUND_CLASSES))
    origins = grid.list_points(TOP_M)
    down = np.broadcast_to(np.array([0.0, 0.0, -1.0], np.float32), origins.shape)
    range_m = raycaster.cast(Rays(origins, down), 2.0 * TOP_M).range_m
    ground = np.where(np.isfinite(range_m), origins[:, 2] - range_m, np.nan)
    return np.where(np.isnan(ground), np.nanmedian(ground), ground).reshape(grid.ground.shape)
