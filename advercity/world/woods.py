"""Woods far off, too dense to look into."""

import numpy as np
from numpy.typing import NDArray

from advercity.randomness import generator
from advercity.semantics import Semantic
from advercity.world.fields import border, unfolded
from advercity.world.shapes import Floats, Piece, grid
from advercity.world.site import Site

HEIGHT_M = 11.0
STEP_M = 4.0
"""Between tops of trees; further apart in a large wood."""
CLEARANCE_M = 8.0
MOST_TOPS = 1600


def step_m(area_m2: float) -> float:
    """How far apart tops stand in a wood as large as that."""
    return max(STEP_M, float(np.sqrt(area_m2 / MOST_TOPS)))


def woods(rows: Floats, height_m: float | None, site: Site, key: str) -> list[Piece]:
    """Tops and edges of a wood over points (n, m, 2), as of `fields.rows_over`."""
    height = height_m or HEIGHT_M
    draw = generator("woods", key)
    free = site.is_free(rows.reshape(-1, 2), CLEARANCE_M).reshape(rows.shape[:2])
    grown = free & _within_a_rough_rim(rows)
    cells = grown[:-1, :-1] & grown[1:, :-1] & grown[:-1, 1:] & grown[1:, 1:] & unfolded(rows)
    if not cells.any():
        return []
    spread = np.linalg.norm(rows[1, 0] - rows[0, 0])
    shifted = rows + draw.uniform(-0.35, 0.35, rows.shape) * spread
    points = site.on_ground(shifted.reshape(-1, 2)).reshape(*free.shape, 3)
    tops = draw.uniform(0.62, 1.0, free.shape) * height
    points[..., 2] += np.where(border(cells), -0.3, tops)
    return [Piece(grid(points, cells), "leaves", Semantic.VEGETATION)]


def _within_a_rough_rim(rows: Floats) -> NDArray[np.bool_]:
    """Which points of a grid (n, m, 2) lie inside a rounded outline with bays in it."""
    u, v = (np.linspace(-1, 1, count) for count in rows.shape[:2])
    x, y = rows[..., 0], rows[..., 1]
    bays = np.sin(x / 17 + np.sin(y / 41)) + np.sin(y / 23 + np.sin(x / 37))
    return u[:, None] ** 4 + v**4 < 0.95 + 0.22 * bays
