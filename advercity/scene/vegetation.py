"""Builds vegetation: crops and tilled fields as ridged sheets, places of trees, distant woods."""

from itertools import product

import numpy as np
import shapely
from advercity_dsl.road import Species
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from advercity.geometry.arrays import Float64Array
from advercity.geometry.mesh import (
    MeshPart,
    TriangleSurface,
    extract_polygons,
    normalize,
    repeat_surface,
    xyz,
)
from advercity.geometry.primitives import grid_sheet
from advercity.randomness import create_generator
from advercity.scene.foliage import build_foliage
from advercity.scene.seasons import find_crop
from advercity.scene.site import Rectangle, Site, StreetSide
from advercity.scene.trees import Detail, build_tree
from advercity.semantics import Semantic

VERGE_M, TUFTS_PER_M, MAX_TUFTS = 4.0, 9.0, 40_000
"""Width of the strip along paved edges that has tufts of grass, and how many."""
CROP_CLEARANCE_M = 0.8
STALKS_MAX_DISTANCE_M = 30.0
"""Distance from street axes within which crops have stalks; beyond, ridges look like plants."""
STALKS_PER_TOP, STALK_WIDTH_M = 12, 0.05
"""Leaves about every point of a ridge, and how wide they are at the foot."""
FURROW_HEIGHT_M = 0.28
_ROW_SPACING_M, _ALONG_ROW_STEP_M = 1.3, 3.0
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
WOODS_CLEARANCE_M = 8.0
MAX_TREE_TOPS = 1600


def sample_rows(band: StreetSide | Rectangle) -> Float64Array:
    """Sample the points (n, m, 2) of a field, n along its rows, with two rows of points a ridge."""
    return band.sample_grid(_ALONG_ROW_STEP_M, _ROW_SPACING_M / 2)


def build_crops(rows: Float64Array, height_m: float | None, site: Site, key: str) -> list[MeshPart]:
    """Build a field of plants: a ridged sheet over the ground, with stalks near streets.

    Points are (n, m, 2), n along the rows and m across; plants have a usual height without one.
    The season decides what is left of them.
    """
    crop = find_crop(site.season, height_m)
    draw = create_generator("crops", key)
    sheet, points, grown = _build_ridged_sheet(rows, crop.height_m, site, draw)
    if sheet is None:
        return []
    tops = grown & (np.arange(rows.shape[1]) % 2 == 1)
    near = shapely.distance(site.street_axes, shapely.points(rows)) < STALKS_MAX_DISTANCE_M
    stalks = _build_stalks(points[tops & near], crop.height_m, key)
    return [MeshPart(surface, crop.material, _VEGETATION) for surface in (sheet, stalks)]


def build_tilled_field(rows: Float64Array, site: Site, key: str) -> list[MeshPart]:
    """Build bare earth in furrows over points (n, m, 2), as in `build_crops`."""
    sheet, _, _ = _build_ridged_sheet(rows, FURROW_HEIGHT_M, site, create_generator("field", key))
    return [] if sheet is None else [MeshPart(sheet, "soil", Semantic.TERRAIN)]


def _build_ridged_sheet(
    rows: Float64Array, height_m: float, site: Site, draw: np.random.Generator
) -> tuple[TriangleSurface | None, Float64Array, NDArray[np.bool_]]:
    """Build a ridged sheet, its points (n, m, 3), and a mask (n, m) of those off its border."""
    free = site.is_free(rows.reshape(-1, 2), CROP_CLEARANCE_M).reshape(rows.shape[:2])
    cells = _find_free_cells(rows, free)
    inside = ~_find_border_points(cells)
    # Borders are below the ground, so that the sheet has no open edge.
    ridge = np.where(np.arange(rows.shape[1]) % 2, 1.0, 0.45)
    rise = np.where(inside, height_m * ridge * draw.uniform(0.82, 1.1, free.shape), -0.05)
    points = site.project_to_ground(rows.reshape(-1, 2)).reshape(*free.shape, 3)
    points[..., 2] += rise
    sheet = grid_sheet(points, cells) if cells.any() else None
    return sheet, points, inside


def _find_free_cells(rows: Float64Array, free: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Find the cells (n - 1, m - 1) with free corners and the orientation of most of the grid."""
    a, b = rows[1:, :-1] - rows[:-1, :-1], rows[:-1, 1:] - rows[:-1, :-1]
    area = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    unfolded = area * np.sign(np.median(area)) > 0.1 * np.median(np.abs(area))
    return unfolded & free[:-1, :-1] & free[1:, :-1] & free[:-1, 1:] & free[1:, 1:]


def _build_stalks(tops: Float64Array, height_m: float, key: str) -> TriangleSurface:
    """Build upright leaves about points (n, 3), with the upward normal of the field."""
    draw = create_generator("stalks", key)
    foot = np.repeat(tops, STALKS_PER_TOP, axis=0)
    foot += draw.uniform(-1, 1, foot.shape) * (0.5, 0.5, 0.0) * _ALONG_ROW_STEP_M / 2
    yaw = draw.uniform(0, 2 * np.pi, len(foot))
    side = STALK_WIDTH_M / 2 * np.column_stack([np.cos(yaw), np.sin(yaw), np.zeros(len(foot))])
    lean = draw.uniform((-0.1, -0.1, 0.25), (0.1, 0.1, 0.65), foot.shape) * (1, 1, height_m)
    root = np.array([0.0, 0.0, 0.25])
    corners = np.stack([foot - side - root, foot + side - root, foot + lean], axis=1).reshape(-1, 3)
    triangles = np.arange(len(corners)).reshape(-1, 3)
    return TriangleSurface(corners, triangles, np.tile([0.0, 0.0, 1.0], (len(corners), 1)))


def build_verge_grass(site: Site, key: str) -> list[MeshPart]:
    """Build tufts of grass along the edges of what is paved, denser next to it."""
    draw = create_generator("verge grass", key)
    starts, steps = _list_edges(site.paved_area)
    length = np.linalg.norm(steps, axis=1)
    count = min(int(length.sum() * TUFTS_PER_M), MAX_TUFTS)
    edge = draw.choice(len(length), count, p=length / length.sum())
    along = draw.uniform(size=(count, 1)) * steps[edge]
    away = VERGE_M * draw.uniform(size=(count, 1)) ** 1.6 * draw.choice([-1.0, 1.0], (count, 1))
    across = steps[edge][:, ::-1] * (1.0, -1.0) / length[edge, None]
    foot = starts[edge] + along + away * across
    foot = foot[site.is_free(foot, 0.04)]
    if not len(foot):
        return []
    blades = _build_blades(site.project_to_ground(foot), draw)
    return [MeshPart(blades, "grass_blades", Semantic.TERRAIN)]


def _list_edges(area: BaseGeometry) -> tuple[Float64Array, Float64Array]:
    """List straight edges of an area: their starts (n, 2) and the steps (n, 2) to their ends."""
    rings = [
        np.asarray(ring.coords)[:, :2]
        for polygon in extract_polygons(area)
        for ring in (polygon.exterior, *polygon.interiors)
    ]
    steps = [np.diff(ring, axis=0) for ring in rings]
    return np.concatenate([ring[:-1] for ring in rings]), np.concatenate(steps)


def _build_blades(tufts: Float64Array, draw: np.random.Generator) -> TriangleSurface:
    """Build four blades around each of some points (n, 3), with upward normals as of a lawn."""
    foot = np.repeat(tufts, 4, axis=0)
    foot += draw.normal(scale=(0.05, 0.05, 0.0), size=foot.shape)
    yaw = draw.uniform(0.0, 2.0 * np.pi, len(foot))
    side = 0.014 * np.column_stack([np.cos(yaw), np.sin(yaw), np.zeros(len(foot))])
    lean = draw.uniform((-0.08, -0.08, 0.07), (0.08, 0.08, 0.2), foot.shape)
    corners = np.stack([foot - side, foot + side, foot + lean], axis=1).reshape(-1, 3)
    normals = normalize(xyz(z=1.0) + draw.normal(scale=0.3, size=foot.shape))
    triangles = np.arange(len(corners)).reshape(-1, 3)
    return TriangleSurface(corners, triangles, np.repeat(normals, 3, axis=0))


def _find_border_points(cells: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Find the grid points that are not surrounded by cells of the field."""
    padded = np.pad(cells, 1)
    return ~(padded[:-1, :-1] & padded[1:, :-1] & padded[:-1, 1:] & padded[1:, 1:])


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
    cells = _find_free_cells(rows, grown)
    if not cells.any():
        return []
    spread = np.linalg.norm(rows[1, 0] - rows[0, 0])
    shifted = rows + draw.uniform(-0.35, 0.35, rows.shape) * spread
    points = site.project_to_ground(shifted.reshape(-1, 2)).reshape(*free.shape, 3)
    tops = draw.uniform(0.62, 1.0, free.shape) * height - TREE_TOP_LEAF_M / 2
    points[..., 2] += np.where(_find_border_points(cells), -0.3, tops)
    return build_foliage(grid_sheet(points, cells), TREE_TOP_LEAF_M, draw)


def _is_inside_rough_outline(rows: Float64Array) -> NDArray[np.bool_]:
    """Test which points of a grid (n, m, 2) lie inside a rounded outline with bays."""
    u, v = (np.linspace(-1, 1, count) for count in rows.shape[:2])
    x, y = rows[..., 0], rows[..., 1]
    bays = np.sin(x / 17 + np.sin(y / 41)) + np.sin(y / 23 + np.sin(x / 37))
    return u[:, None] ** 4 + v**4 < 0.95 + 0.22 * bays
