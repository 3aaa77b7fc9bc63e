"""Builds vegetation: trees where they stand, and distant woods."""

from itertools import product

import numpy as np
import shapely
from advercity_dsl.road import Species
from numpy.typing import NDArray

from advercity.geometry.arrays import Float64Array
from advercity.geometry.mesh import (
    MeshPart,
    repeat_surface,
)
from advercity.geometry.primitives import grid_sheet
from advercity.randomness import create_generator
from advercity.scene.crops import find_border_points, find_cells_inside, find_free_cells
from advercity.scene.foliage import COVERAGE, build_foliage
from advercity.scene.site import Rectangle, Site, StreetSide
from advercity.scene.trees import Detail, build_tree
from advercity.semantics import Semantic

MAX_TREES = 400
"""Greatest number of trees in one area; larger areas have them further apart."""
TREE_SPACING_M = 8.0
TRUNK_CLEARANCE_M, ROW_CLEARANCE_M = 3.0, 1.0
"""Distance of trunks from reserved areas, where trees are scattered and where they are in rows."""
DETAIL_DISTANCES_M = (11.0, 30.0)
"""Distances from street axes up to which trees are built for close and for middle views."""
_VEGETATION = Semantic.VEGETATION
_SPECIES_WEIGHTS = {
    Species.OAK: 0.34,
    Species.MAPLE: 0.16,
    Species.BIRCH: 0.16,
    Species.POPLAR: 0.14,
    Species.SPRUCE: 0.20,
}
WOODS_HEIGHT_M = 11.0
TREE_TOP_SPACING_M = 4.0
"""Distance between the tops of a wood; larger in a large wood."""
TREE_TOP_LEAF_M = 1.6
"""Length of the leaves on woods, each a branch with its own."""
DEEP_COVERAGE = 0.16
"""Area of the leaves on a wood over its own where other treetops hide most of it."""
WOODS_CLEARANCE_M = 8.0
MAX_TREE_TOPS = 1600


def build_trees(
    points: Float64Array,
    height_m: float | None,
    site: Site,
    key: str,
    species: tuple[Species, ...] = (),
    *,
    clearance_m: float = TRUNK_CLEARANCE_M,
) -> list[MeshPart]:
    """Build trees of several species at points (n, 2), without those on reserved ground."""
    free = points[site.is_free(points, clearance_m)] if len(points) else points
    if not len(free):
        return []
    # One draw each for all trees, in this order: another order would grow other trees.
    draw = create_generator("trees", key)
    feet = site.project_to_ground(free) - (0.0, 0.0, 0.15)
    kinds = species or tuple(Species)
    weights = np.array([_SPECIES_WEIGHTS[name] for name in kinds])
    drawn = draw.choice(len(kinds), len(free), p=weights / weights.sum())
    size = draw.uniform(0.75, 1.25, len(free)) if height_m is None else np.full(len(free), 1.0)
    slender = draw.uniform(0.9, 1.15, len(free))
    yaw = draw.uniform(0.0, 2 * np.pi, len(free))
    away_m = shapely.distance(site.street_axes, shapely.points(free))
    details = np.searchsorted(DETAIL_DISTANCES_M, away_m)
    pieces: list[MeshPart] = []
    for (index, name), detail in product(enumerate(kinds), Detail):
        these = (drawn == index) & (details == detail)
        if not these.any():
            continue
        parts, natural_m = build_tree(name, detail, site.season)
        factor = size[these] * (1.0 if height_m is None else height_m / natural_m)
        scale = np.column_stack([factor, factor, factor * slender[these]])
        for part, material in parts:
            copies = repeat_surface(part, feet[these], yaw=yaw[these], scale=scale)
            pieces.append(MeshPart(copies, material, _VEGETATION))
    return pieces


def scatter_points(band: StreetSide | Rectangle, spacing_m: float, key: str) -> Float64Array:
    """Scatter up to `MAX_TREES` points (n, 2) at about a spacing; along a line they form a row."""
    if isinstance(band, Rectangle):
        return _scatter_points_in_area(band, spacing_m, key)
    return _scatter_points_along_street(band, spacing_m, key)


def _scatter_points_in_area(area: Rectangle, spacing_m: float, key: str) -> Float64Array:
    step = max(spacing_m, float(np.sqrt(np.prod(area.extent) / MAX_TREES)))
    count = np.maximum((area.extent / step).astype(int), 1)
    column, row = np.meshgrid(np.arange(count[0]), np.arange(count[1]), indexing="ij")
    cell = np.stack([column, row], axis=-1).reshape(-1, 2)
    jitter = create_generator("scattered", key).uniform(0.12, 0.88, cell.shape)
    return area.low + (cell + jitter) * area.extent / count


def _scatter_points_along_street(side: StreetSide, spacing_m: float, key: str) -> Float64Array:
    depth = side.depth_m
    if depth < spacing_m:
        return side.space_points(spacing_m, (side.near_offset_m + side.far_offset_m) / 2)
    step = max(spacing_m, float(np.sqrt(side.length_m * depth / MAX_TREES)))
    count = max(1, int(side.length_m / step)), max(1, int(depth / step))
    cell = np.stack(np.meshgrid(*map(np.arange, count), indexing="ij"), axis=-1).reshape(-1, 2)
    jitter = create_generator("scattered", key, side.sign).uniform(0.12, 0.88, cell.shape)
    along, across = ((cell + jitter) / count * (side.length_m, depth)).T
    points = side.points_at(along, side.near_offset_m + across)
    return points[side.is_unfolded(points, side.near_offset_m + across)]


def build_woods(
    band: StreetSide | Rectangle, height_m: float | None, site: Site, key: str
) -> list[MeshPart]:
    """Build the tops and edges of a wood that is seen from afar."""
    extent = band.extent if isinstance(band, Rectangle) else (band.length_m, band.depth_m)
    spacing_m = max(TREE_TOP_SPACING_M, float(np.sqrt(np.prod(extent) / MAX_TREE_TOPS)))
    rows = band.sample_grid(spacing_m, spacing_m)
    height = height_m or WOODS_HEIGHT_M
    draw = create_generator("woods", key)
    free = site.is_free(rows.reshape(-1, 2), WOODS_CLEARANCE_M).reshape(rows.shape[:2])
    grown = free & _is_inside_rough_outline(rows)
    cells = find_free_cells(rows, grown)
    if not cells.any():
        return []
    spread = np.linalg.norm(rows[1, 0] - rows[0, 0])
    shifted = rows + draw.uniform(-0.35, 0.35, rows.shape) * spread
    points = site.project_to_ground(shifted.reshape(-1, 2)).reshape(*free.shape, 3)
    tops = draw.uniform(0.62, 1.0, free.shape) * height - TREE_TOP_LEAF_M / 2
    points[..., 2] += np.where(find_border_points(cells), -0.3, tops)
    depths = [(cells, COVERAGE)]
    deep = _find_deep_cells(cells)
    if deep.any():
        depths = [(cells & ~deep, COVERAGE), (deep, DEEP_COVERAGE)]
    return [
        part
        for of, coverage in depths
        for part in build_foliage(grid_sheet(points, of), TREE_TOP_LEAF_M, draw, coverage)
    ]


def _find_deep_cells(cells: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Find the cells of a wood that two others at least lie around."""
    for _ in range(2):
        cells = cells & find_cells_inside(~find_border_points(cells))
    return cells


def _is_inside_rough_outline(rows: Float64Array) -> NDArray[np.bool_]:
    """Test which points of a grid (n, m, 2) lie inside a rounded outline with bays."""
    u, v = (np.linspace(-1, 1, count) for count in rows.shape[:2])
    x, y = rows[..., 0], rows[..., 1]
    bays = np.sin(x / 17 + np.sin(y / 41)) + np.sin(y / 23 + np.sin(x / 37))
    return u[:, None] ** 4 + v**4 < 0.95 + 0.22 * bays
