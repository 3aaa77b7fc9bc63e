"""Crops and ploughed fields, as ridged sheets over grids of points.

Trees.

Woods far off, too dense to look into.
"""

from functools import cache
from itertools import product

import numpy as np
import shapely
from advercity_dsl.road import Species
from advercity_dsl.units import Point2
from numpy.typing import NDArray

from advercity.geometry.arrays import Float64Array
from advercity.geometry.mesh import (
    MeshPart,
    TriangleSurface,
    join_surfaces,
    repeat_surface,
    shade_smooth,
)
from advercity.geometry.primitives import ellipsoid, grid_sheet, loft_rings, tube
from advercity.randomness import create_generator
from advercity.scene.site import Site, StreetSide, rectangle_corners
from advercity.semantics import Semantic

CROP_HEIGHT_M = 0.6
CROP_CLEARANCE_M = 0.8
STALKS_MAX_DISTANCE_M = 30.0
"""Of a street's axis; further off, the ridges look like plants by themselves."""
FURROW_HEIGHT_M = 0.28
_ROW_SPACING_M, _ALONG_ROW_STEP_M = 1.3, 3.0


def sample_rows_in_area(
    area: tuple[Point2, Point2],
    step_m: float = _ALONG_ROW_STEP_M,
    row_m: float = _ROW_SPACING_M / 2,
) -> Float64Array:
    """Points (n, m, 2) of a field: n along its rows, which follow the longer side."""
    low, high = rectangle_corners(area)
    extent = high - low
    lengthways = int(np.argmax(extent))
    along = np.linspace(low[lengthways], high[lengthways], 2 + int(extent[lengthways] / step_m))
    across = np.arange(low[1 - lengthways], high[1 - lengthways] + 1e-6, row_m)
    first, second = np.meshgrid(along, across, indexing="ij")
    return np.stack([first, second] if lengthways == 0 else [second, first], axis=-1)


def sample_rows_along_street(
    side: StreetSide, step_m: float = _ALONG_ROW_STEP_M, row_m: float = _ROW_SPACING_M / 2
) -> Float64Array:
    """Points (n, m, 2) of a field beside a street, whose rows follow it."""
    along = np.linspace(0.0, side.length_m, 2 + int(side.length_m / step_m))
    across = np.arange(side.near_offset_m, side.far_offset_m + 1e-6, row_m)
    first, second = np.meshgrid(along, across, indexing="ij")
    return side.points_at(first, second)


def build_crops(rows: Float64Array, height_m: float | None, site: Site, key: str) -> list[MeshPart]:
    """A field of plants: a ridged surface over the ground, with stalks where one comes near.

    Args:
        rows: (n, m, 2) points: n along the rows, m across.
        height_m: Of the plants.
        site: The ground, and what must stay free.
        key: Of what is random.
    """
    height = height_m or CROP_HEIGHT_M
    sheet, points, grown = _build_ridged_sheet(rows, height, site, create_generator("crops", key))
    if sheet is None:
        return []
    tops = grown & (np.arange(rows.shape[1]) % 2 == 1)
    near = shapely.distance(site.street_axes, shapely.points(rows)) < STALKS_MAX_DISTANCE_M
    stalks = _build_stalks(points[tops & near], height, key)
    return [
        MeshPart(sheet, "crops", Semantic.VEGETATION),
        MeshPart(stalks, "crops", Semantic.VEGETATION),
    ]


def build_tilled_field(rows: Float64Array, site: Site, key: str) -> list[MeshPart]:
    """Bare earth in furrows, over points (n, m, 2) as of `crops`."""
    sheet, _, _ = _build_ridged_sheet(rows, FURROW_HEIGHT_M, site, create_generator("field", key))
    return [] if sheet is None else [MeshPart(sheet, "soil", Semantic.TERRAIN)]


def _build_ridged_sheet(
    rows: Float64Array, height_m: float, site: Site, draw: np.random.Generator
) -> tuple[TriangleSurface | None, Float64Array, NDArray[np.bool_]]:
    """A ridged sheet, its points (n, m, 3), and which of them (n, m) stand inside."""
    free = site.is_free(rows.reshape(-1, 2), CROP_CLEARANCE_M).reshape(rows.shape[:2])
    cells = free[:-1, :-1] & free[1:, :-1] & free[:-1, 1:] & free[1:, 1:]
    cells &= find_unfolded_cells(rows)
    inside = ~find_border_points(cells)
    ridge = np.where(np.arange(rows.shape[1]) % 2, 1.0, 0.45)
    rise = np.where(inside, height_m * ridge * draw.uniform(0.82, 1.1, free.shape), -0.05)
    points = site.project_to_ground(rows.reshape(-1, 2)).reshape(*free.shape, 3)
    points[..., 2] += rise
    sheet = grid_sheet(points, cells) if cells.any() else None
    return sheet, points, inside


def find_unfolded_cells(rows: Float64Array) -> NDArray[np.bool_]:
    """Cells (n - 1, m - 1) of a grid that lie the same way up as most of it."""
    a, b = rows[1:, :-1] - rows[:-1, :-1], rows[:-1, 1:] - rows[:-1, :-1]
    area = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return area * np.sign(np.median(area)) > 0.1 * np.median(np.abs(area))


def _build_stalks(tops: Float64Array, height_m: float, key: str) -> TriangleSurface:
    """Upright leaves on the ridges, four about every point (n, 3), lit like the field below."""
    draw = create_generator("stalks", key)
    foot = np.repeat(tops, 4, axis=0)
    foot += draw.uniform(-1, 1, foot.shape) * (0.5, 0.5, 0.0) * _ALONG_ROW_STEP_M / 2
    yaw = draw.uniform(0, 2 * np.pi, len(foot))
    side = 0.16 * np.column_stack([np.cos(yaw), np.sin(yaw), np.zeros(len(foot))])
    lean = draw.uniform((-0.1, -0.1, 0.25), (0.1, 0.1, 0.65), foot.shape) * (1, 1, height_m)
    root = np.array([0.0, 0.0, 0.25])
    corners = np.stack([foot - side - root, foot + side - root, foot + lean], axis=1).reshape(-1, 3)
    triangles = np.arange(len(corners)).reshape(-1, 3)
    return TriangleSurface(corners, triangles, np.tile([0.0, 0.0, 1.0], (len(corners), 1)))


def find_border_points(cells: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Grid points that are not wholly surrounded by cells of the field."""
    padded = np.pad(cells, 1)
    return ~(padded[:-1, :-1] & padded[1:, :-1] & padded[:-1, 1:] & padded[1:, 1:])


MAX_TREES = 400
"""In one area."""
TREE_SPACING_M = 8.0
TRUNK_CLEARANCE_M, ROW_CLEARANCE_M = 3.0, 1.0
FINE_LEAVES_DISTANCE_M = 14.0
"""From a street's axis: nearer trees have finer leaves."""


def build_trees(
    points: Float64Array,
    height_m: float | None,
    site: Site,
    key: str,
    species: tuple[Species, ...] = (),
    *,
    clearance_m: float = TRUNK_CLEARANCE_M,
) -> list[MeshPart]:
    """Trees at points (n, 2), of several species; those on what must stay free are left out."""
    free = points[site.is_free(points, clearance_m)] if len(points) else points
    if not len(free):
        return []
    draw = create_generator("trees", key)
    feet = site.project_to_ground(free) - (0.0, 0.0, 0.15)
    kinds = species or tuple(Species)
    shares = np.array([_SPECIES_WEIGHTS[name] for name in kinds])
    drawn = draw.choice(len(kinds), len(free), p=shares / shares.sum())
    size = draw.uniform(0.75, 1.25, len(free)) if height_m is None else np.full(len(free), 1.0)
    slender = draw.uniform(0.9, 1.15, len(free))
    yaw = draw.uniform(0.0, 2 * np.pi, len(free))
    near = shapely.distance(site.street_axes, shapely.points(free)) < FINE_LEAVES_DISTANCE_M
    pieces: list[MeshPart] = []
    for (index, name), is_near in product(enumerate(kinds), (False, True)):
        these = (drawn == index) & (near == is_near)
        if not these.any():
            continue
        parts, natural_m = _build_tree(name, is_near=is_near)
        factor = size[these] * (1.0 if height_m is None else height_m / natural_m)
        scale = np.column_stack([factor, factor, factor * slender[these]])
        pieces += [
            MeshPart(
                repeat_surface(part, feet[these], yaw=yaw[these], scale=scale),
                material,
                _VEGETATION,
            )
            for part, material in parts
        ]
    return pieces


def scatter_points_in_area(area: tuple[Point2, Point2], spacing_m: float, key: str) -> Float64Array:
    """Points (n, 2) over an area at about a spacing, in no visible order; `MOST_TREES` at most."""
    low, high = rectangle_corners(area)
    step = max(spacing_m, float(np.sqrt(np.prod(high - low) / MAX_TREES)))
    count = np.maximum(((high - low) / step).astype(int), 1)
    column, row = np.meshgrid(np.arange(count[0]), np.arange(count[1]), indexing="ij")
    cell = np.stack([column, row], axis=-1).reshape(-1, 2)
    jitter = create_generator("scattered", key).uniform(0.12, 0.88, cell.shape)
    return low + (cell + jitter) * (high - low) / count


def scatter_points_along_street(side: StreetSide, spacing_m: float, key: str) -> Float64Array:
    """Points (n, 2) over a band beside a street, or along a line; `MOST_TREES` at most."""
    depth = side.far_offset_m - side.near_offset_m
    if depth < spacing_m:
        return side.space_points(spacing_m, (side.near_offset_m + side.far_offset_m) / 2)
    step = max(spacing_m, float(np.sqrt(side.length_m * depth / MAX_TREES)))
    count = max(1, int(side.length_m / step)), max(1, int(depth / step))
    cell = np.stack(np.meshgrid(*map(np.arange, count), indexing="ij"), axis=-1).reshape(-1, 2)
    jitter = create_generator("scattered", key, side.sign).uniform(0.12, 0.88, cell.shape)
    along, across = ((cell + jitter) / count * (side.length_m, depth)).T
    points = side.points_at(along, side.near_offset_m + across)
    return points[side.is_unfolded(points, side.near_offset_m + across)]


_VEGETATION = Semantic.VEGETATION
_TUFTS_PER_CLUMP, _TUFTS_PER_NEAR_CLUMP = 46, 110
"""Loose triangles of leaves per clump; vegetation is seen from both sides."""
_SPECIES_WEIGHTS = {
    Species.OAK: 0.34,
    Species.MAPLE: 0.16,
    Species.BIRCH: 0.16,
    Species.POPLAR: 0.14,
    Species.SPRUCE: 0.20,
}


@cache
def _build_tree(
    name: Species, *, is_near: bool
) -> tuple[tuple[tuple[TriangleSurface, str], ...], float]:
    """Shaded parts of a tree of a species, standing at the origin, and its height in metres."""
    if name is Species.SPRUCE:
        return _build_spruce(), 10.8
    trunk, blobs = {
        Species.OAK: (
            3.2,
            ((0, 0, 5.6, 2.5, 1.9), (1.4, 0.6, 4.7, 1.6, 1.3), (-1.2, 1.0, 4.9, 1.6, 1.3)),
        ),
        Species.POPLAR: (2.6, ((0, 0, 6.2, 1.25, 3.8), (0.3, 0.2, 4.2, 1.2, 2.0))),
        Species.BIRCH: (2.0, ((0, 0, 3.6, 1.4, 1.6), (0.4, -0.3, 2.9, 1.1, 0.9))),
        Species.MAPLE: (
            2.2,
            ((0.9, 0, 3.8, 1.8, 1.5), (-1.0, 0.8, 4.3, 1.9, 1.6), (0, -1.1, 3.6, 1.6, 1.3)),
        ),
    }[name]
    draw = create_generator("tree", name)
    crown = [
        _build_leaf_clump(np.array([x, y, z]), np.array([r, r, rise]), draw, is_near=is_near)
        for x, y, z, r, rise in blobs
    ]
    top = max(z + rise for *_, z, _, rise in blobs)
    stem = tube([(0, 0, 0), (0.05, 0, 1.0), (0, 0.05, trunk + 1.0)], [0.24, 0.17, 0.11], sides=6)
    return ((shade_smooth(stem), "bark"), (join_surfaces(crown), "leaves")), top


def _build_leaf_clump(
    centre: Float64Array, radii: Float64Array, draw: np.random.Generator, *, is_near: bool
) -> TriangleSurface:
    """Leaves around a centre: a rough ellipsoid with tufts, lit as if it were a smooth one."""
    sides, bands = 8, 4
    rough = draw.uniform(0.82, 1.1, (bands + 1, sides))
    factor = np.concatenate([rough.reshape(-1), rough.mean(axis=1)[[0, -1]]])
    core = ellipsoid((0, 0, 0), radii, sides=sides, bands=bands)
    tuft_count, size = (_TUFTS_PER_NEAR_CLUMP, 0.085) if is_near else (_TUFTS_PER_CLUMP, 0.15)
    out = draw.normal(size=(tuft_count, 3))
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    spread = draw.normal(scale=size, size=(tuft_count, 3, 3)) * radii.min()
    reach = draw.uniform(0.86, 1.04, (tuft_count, 1))
    tufts = ((reach * out * radii)[:, None] + spread).reshape(-1, 3)
    vertices = np.concatenate([core.vertices * factor[:, None], tufts])
    tuft_triangles = len(core.vertices) + np.arange(3 * tuft_count).reshape(-1, 3)
    normals = vertices / radii**2
    return TriangleSurface(
        vertices + centre,
        np.concatenate([core.triangles, tuft_triangles]),
        normals / np.linalg.norm(normals, axis=1, keepdims=True),
    )


def _build_spruce() -> tuple[tuple[TriangleSurface, str], ...]:
    angle = 2 * np.pi * np.arange(10) / 10
    draw = create_generator("tree", "spruce")
    tiers: list[TriangleSurface] = []
    for foot, top, radius in ((1.3, 4.8, 2.3), (3.3, 6.9, 1.9), (5.3, 9.0, 1.4), (7.3, 10.8, 0.9)):
        reach = radius * draw.uniform(0.85, 1.1, 10)
        circle = np.column_stack([np.cos(angle), np.sin(angle)])
        rings = [
            np.column_stack([circle * (share * reach)[:, None], np.full(10, z)])
            for share, z in (
                (0.35, foot + 0.35),
                (1.0, foot),
                (0.45, (foot + top) / 2),
                (0.03, top),
            )
        ]
        tiers.append(loft_rings(np.stack(rings)))
    stem = tube([(0, 0, 0), (0, 0, 5.0)], [0.22, 0.12], sides=6)
    return (shade_smooth(stem), "bark"), (shade_smooth(join_surfaces(tiers)), "needles")


WOODS_HEIGHT_M = 11.0
TREE_TOP_SPACING_M = 4.0
"""Between tops of trees; further apart in a large wood."""
WOODS_CLEARANCE_M = 8.0
MAX_TREE_TOPS = 1600


def compute_tree_top_spacing_m(area_m2: float) -> float:
    """How far apart tops stand in a wood as large as that."""
    return max(TREE_TOP_SPACING_M, float(np.sqrt(area_m2 / MAX_TREE_TOPS)))


def build_woods(rows: Float64Array, height_m: float | None, site: Site, key: str) -> list[MeshPart]:
    """Tops and edges of a wood over points (n, m, 2), as of `fields.rows_over`."""
    height = height_m or WOODS_HEIGHT_M
    draw = create_generator("woods", key)
    free = site.is_free(rows.reshape(-1, 2), WOODS_CLEARANCE_M).reshape(rows.shape[:2])
    grown = free & _is_inside_rough_outline(rows)
    cells = (
        grown[:-1, :-1]
        & grown[1:, :-1]
        & grown[:-1, 1:]
        & grown[1:, 1:]
        & find_unfolded_cells(rows)
    )
    if not cells.any():
        return []
    spread = np.linalg.norm(rows[1, 0] - rows[0, 0])
    shifted = rows + draw.uniform(-0.35, 0.35, rows.shape) * spread
    points = site.project_to_ground(shifted.reshape(-1, 2)).reshape(*free.shape, 3)
    tops = draw.uniform(0.62, 1.0, free.shape) * height
    points[..., 2] += np.where(find_border_points(cells), -0.3, tops)
    return [MeshPart(grid_sheet(points, cells), "leaves", Semantic.VEGETATION)]


def _is_inside_rough_outline(rows: Float64Array) -> NDArray[np.bool_]:
    """Which points of a grid (n, m, 2) lie inside a rounded outline with bays in it."""
    u, v = (np.linspace(-1, 1, count) for count in rows.shape[:2])
    x, y = rows[..., 0], rows[..., 1]
    bays = np.sin(x / 17 + np.sin(y / 41)) + np.sin(y / 23 + np.sin(x / 37))
    return u[:, None] ** 4 + v**4 < 0.95 + 0.22 * bays
