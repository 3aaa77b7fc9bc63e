"""Crops and ploughed fields, as ridged sheets over grids of points."""

import numpy as np
import shapely
from advercity_dsl.base import Point2
from numpy.typing import NDArray

from advercity.randomness import generator
from advercity.semantics import Semantic
from advercity.world.beside import Side
from advercity.world.shapes import Floats, Piece, Surface, grid
from advercity.world.site import Site, rectangle

CROP_HEIGHT_M = 0.6
CROP_CLEARANCE_M = 0.8
STALKS_WITHIN_M = 30.0
"""Of a street's axis; further off, the ridges look like plants by themselves."""
FURROW_M = 0.28
_ROW_M, _STEP_M = 1.3, 3.0


def rows_over(
    area: tuple[Point2, Point2], step_m: float = _STEP_M, row_m: float = _ROW_M / 2
) -> Floats:
    """Points (n, m, 2) of a field: n along its rows, which follow the longer side."""
    low, high = rectangle(area)
    extent = high - low
    lengthways = int(np.argmax(extent))
    along = np.linspace(low[lengthways], high[lengthways], 2 + int(extent[lengthways] / step_m))
    across = np.arange(low[1 - lengthways], high[1 - lengthways] + 1e-6, row_m)
    first, second = np.meshgrid(along, across, indexing="ij")
    return np.stack([first, second] if lengthways == 0 else [second, first], axis=-1)


def rows_beside(side: Side, step_m: float = _STEP_M, row_m: float = _ROW_M / 2) -> Floats:
    """Points (n, m, 2) of a field beside a street, whose rows follow it."""
    along = np.linspace(0.0, side.length_m, 2 + int(side.length_m / step_m))
    across = np.arange(side.near_m, side.far_m + 1e-6, row_m)
    first, second = np.meshgrid(along, across, indexing="ij")
    return side.at(first, second)


def crops(rows: Floats, height_m: float | None, site: Site, key: str) -> list[Piece]:
    """A field of plants: a ridged surface over the ground, with stalks where one comes near.

    Args:
        rows: (n, m, 2) points: n along the rows, m across.
        height_m: Of the plants.
        site: The ground, and what must stay free.
        key: Of what is random.
    """
    height = height_m or CROP_HEIGHT_M
    sheet, points, grown = _tilled(rows, height, site, generator("crops", key))
    if sheet is None:
        return []
    tops = grown & (np.arange(rows.shape[1]) % 2 == 1)
    near = shapely.distance(site.axes, shapely.points(rows)) < STALKS_WITHIN_M
    stalks = _stalks(points[tops & near], height, key)
    return [Piece(sheet, "crops", Semantic.VEGETATION), Piece(stalks, "crops", Semantic.VEGETATION)]


def tilled_field(rows: Floats, site: Site, key: str) -> list[Piece]:
    """Bare earth in furrows, over points (n, m, 2) as of `crops`."""
    sheet, _, _ = _tilled(rows, FURROW_M, site, generator("field", key))
    return [] if sheet is None else [Piece(sheet, "soil", Semantic.TERRAIN)]


def _tilled(
    rows: Floats, height_m: float, site: Site, draw: np.random.Generator
) -> tuple[Surface | None, Floats, NDArray[np.bool_]]:
    """A ridged sheet, its points (n, m, 3), and which of them (n, m) stand inside."""
    free = site.is_free(rows.reshape(-1, 2), CROP_CLEARANCE_M).reshape(rows.shape[:2])
    cells = free[:-1, :-1] & free[1:, :-1] & free[:-1, 1:] & free[1:, 1:]
    cells &= unfolded(rows)
    inside = ~border(cells)
    ridge = np.where(np.arange(rows.shape[1]) % 2, 1.0, 0.45)
    rise = np.where(inside, height_m * ridge * draw.uniform(0.82, 1.1, free.shape), -0.05)
    points = site.on_ground(rows.reshape(-1, 2)).reshape(*free.shape, 3)
    points[..., 2] += rise
    sheet = grid(points, cells) if cells.any() else None
    return sheet, points, inside


def unfolded(rows: Floats) -> NDArray[np.bool_]:
    """Cells (n - 1, m - 1) of a grid that lie the same way up as most of it."""
    a, b = rows[1:, :-1] - rows[:-1, :-1], rows[:-1, 1:] - rows[:-1, :-1]
    area = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return area * np.sign(np.median(area)) > 0.1 * np.median(np.abs(area))


def _stalks(tops: Floats, height_m: float, key: str) -> Surface:
    """Upright leaves on the ridges, four about every point (n, 3), lit like the field below."""
    draw = generator("stalks", key)
    foot = np.repeat(tops, 4, axis=0)
    foot += draw.uniform(-1, 1, foot.shape) * (0.5, 0.5, 0.0) * _STEP_M / 2
    yaw = draw.uniform(0, 2 * np.pi, len(foot))
    side = 0.16 * np.column_stack([np.cos(yaw), np.sin(yaw), np.zeros(len(foot))])
    lean = draw.uniform((-0.1, -0.1, 0.25), (0.1, 0.1, 0.65), foot.shape) * (1, 1, height_m)
    root = np.array([0.0, 0.0, 0.25])
    corners = np.stack([foot - side - root, foot + side - root, foot + lean], axis=1).reshape(-1, 3)
    triangles = np.arange(len(corners)).reshape(-1, 3)
    return Surface(corners, triangles, np.tile([0.0, 0.0, 1.0], (len(corners), 1)))


def border(cells: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Grid points that are not wholly surrounded by cells of the field."""
    padded = np.pad(cells, 1)
    return ~(padded[:-1, :-1] & padded[1:, :-1] & padded[:-1, 1:] & padded[1:, 1:])
