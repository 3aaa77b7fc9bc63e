"""Trees, crops and fields."""

from functools import cache

import numpy as np
import shapely
from advercity_dsl.base import Point2
from advercity_dsl.road import Species
from numpy.typing import NDArray

from advercity.randomness import generator
from advercity.semantics import Semantic
from advercity.world.beside import Side
from advercity.world.shapes import (
    Floats,
    Piece,
    Surface,
    ellipsoid,
    joined,
    loft,
    repeated,
    shaded,
    tube,
)
from advercity.world.site import Site, rectangle

MOST_TREES = 400
"""In one area."""
TREE_SPACING_M = 8.0
TRUNK_CLEARANCE_M, ROW_CLEARANCE_M = 3.0, 1.0
CROP_HEIGHT_M = 0.6
CROP_CLEARANCE_M = 0.8
STALKS_WITHIN_M = 30.0
"""Of a street's axis; further off, the ridges look like plants by themselves."""
FURROW_M = 0.28
_ROW_M, _STEP_M = 1.3, 3.0


def trees(
    points: Floats,
    height_m: float | None,
    site: Site,
    key: str,
    species: tuple[Species, ...] = (),
    *,
    clearance_m: float = TRUNK_CLEARANCE_M,
) -> list[Piece]:
    """Trees at points (n, 2), of several species; those on what must stay free are left out."""
    free = points[site.is_free(points, clearance_m)] if len(points) else points
    if not len(free):
        return []
    draw = generator("trees", key)
    feet = site.on_ground(free) - (0.0, 0.0, 0.15)
    grown = species or tuple(Species)
    shares = np.array([_SHARES[name] for name in grown])
    drawn = draw.choice(len(grown), len(free), p=shares / shares.sum())
    size = draw.uniform(0.75, 1.25, len(free)) if height_m is None else np.full(len(free), 1.0)
    slender = draw.uniform(0.9, 1.15, len(free))
    yaw = draw.uniform(0.0, 2 * np.pi, len(free))
    pieces: list[Piece] = []
    for index, name in enumerate(grown):
        these = drawn == index
        if not these.any():
            continue
        parts, natural_m = _prototype(name)
        factor = size[these] * (1.0 if height_m is None else height_m / natural_m)
        scale = np.column_stack([factor, factor, factor * slender[these]])
        pieces += [
            Piece(repeated(part, feet[these], yaw=yaw[these], scale=scale), material, _PLANT)
            for part, material in parts
        ]
    return pieces


def scattered(area: tuple[Point2, Point2], spacing_m: float, key: str) -> Floats:
    """Points (n, 2) over an area at about a spacing, in no visible order; `MOST_TREES` at most."""
    low, high = rectangle(area)
    step = max(spacing_m, float(np.sqrt(np.prod(high - low) / MOST_TREES)))
    count = np.maximum(((high - low) / step).astype(int), 1)
    column, row = np.meshgrid(np.arange(count[0]), np.arange(count[1]), indexing="ij")
    cell = np.stack([column, row], axis=-1).reshape(-1, 2)
    jitter = generator("scattered", key).uniform(0.12, 0.88, cell.shape)
    return low + (cell + jitter) * (high - low) / count


def scattered_beside(side: Side, spacing_m: float, key: str) -> Floats:
    """Points (n, 2) over a band beside a street, or along a line; `MOST_TREES` at most."""
    depth = side.far_m - side.near_m
    if depth < spacing_m:
        return side.spread(spacing_m, (side.near_m + side.far_m) / 2)
    step = max(spacing_m, float(np.sqrt(side.length_m * depth / MOST_TREES)))
    count = max(1, int(side.length_m / step)), max(1, int(depth / step))
    cell = np.stack(np.meshgrid(*map(np.arange, count), indexing="ij"), axis=-1).reshape(-1, 2)
    jitter = generator("scattered", key, side.sign).uniform(0.12, 0.88, cell.shape)
    along, across = ((cell + jitter) / count * (side.length_m, depth)).T
    points = side.at(along, side.near_m + across)
    return points[side.holds(points, side.near_m + across)]


def rows_over(area: tuple[Point2, Point2]) -> Floats:
    """Points (n, m, 2) of a field: n along its rows, which follow the longer side."""
    low, high = rectangle(area)
    extent = high - low
    lengthways = int(np.argmax(extent))
    along = np.linspace(low[lengthways], high[lengthways], 2 + int(extent[lengthways] / _STEP_M))
    across = np.arange(low[1 - lengthways], high[1 - lengthways] + 1e-6, _ROW_M / 2)
    first, second = np.meshgrid(along, across, indexing="ij")
    return np.stack([first, second] if lengthways == 0 else [second, first], axis=-1)


def rows_beside(side: Side) -> Floats:
    """Points (n, m, 2) of a field beside a street, whose rows follow it."""
    along = np.linspace(0.0, side.length_m, 2 + int(side.length_m / _STEP_M))
    across = np.arange(side.near_m, side.far_m + 1e-6, _ROW_M / 2)
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
    return [Piece(sheet, "crops", _PLANT), Piece(stalks, "crops", _PLANT)]


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
    cells &= _unfolded(rows)
    inside = ~_border(cells)
    ridge = np.where(np.arange(rows.shape[1]) % 2, 1.0, 0.45)
    rise = np.where(inside, height_m * ridge * draw.uniform(0.82, 1.1, free.shape), -0.05)
    points = site.on_ground(rows.reshape(-1, 2)).reshape(*free.shape, 3)
    points[..., 2] += rise
    sheet = _sheet(points, cells) if cells.any() else None
    return sheet, points, inside


def _unfolded(rows: Floats) -> NDArray[np.bool_]:
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


def _border(cells: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Grid points that are not wholly surrounded by cells of the field."""
    padded = np.pad(cells, 1)
    return ~(padded[:-1, :-1] & padded[1:, :-1] & padded[:-1, 1:] & padded[1:, 1:])


def _sheet(points: Floats, cells: NDArray[np.bool_]) -> Surface:
    columns = cells.shape[1] + 1
    i, j = np.nonzero(cells)
    a, b = i * columns + j, (i + 1) * columns + j
    quads = np.stack([a, b, b + 1, a, b + 1, a + 1], axis=-1).reshape(-1, 3)
    flat = points.reshape(-1, 3)
    corner = flat[quads[0]]
    up = np.cross(corner[1] - corner[0], corner[2] - corner[0])[2]
    return Surface(flat, quads if up > 0 else quads[:, ::-1])


_PLANT = Semantic.VEGETATION
_TUFTS = 46
"""Loose triangles of leaves per clump; vegetation is seen from both sides."""
_SHARES = {
    Species.OAK: 0.34,
    Species.MAPLE: 0.16,
    Species.BIRCH: 0.16,
    Species.POPLAR: 0.14,
    Species.SPRUCE: 0.20,
}


@cache
def _prototype(name: Species) -> tuple[tuple[tuple[Surface, str], ...], float]:
    """Shaded parts of a tree of a species, standing at the origin, and its height in metres."""
    if name is Species.SPRUCE:
        return _spruce(), 10.8
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
    draw = generator("tree", name)
    crown = [
        _clump(np.array([x, y, z]), np.array([r, r, rise]), draw) for x, y, z, r, rise in blobs
    ]
    top = max(z + rise for *_, z, _, rise in blobs)
    stem = tube([(0, 0, 0), (0.05, 0, 1.0), (0, 0.05, trunk + 1.0)], [0.24, 0.17, 0.11], sides=6)
    return ((shaded(stem), "bark"), (joined(crown), "leaves")), top


def _clump(centre: Floats, radii: Floats, draw: np.random.Generator) -> Surface:
    """Leaves around a centre: a rough ellipsoid with tufts, lit as if it were a smooth one."""
    sides, bands = 8, 4
    rough = draw.uniform(0.82, 1.1, (bands + 1, sides))
    factor = np.concatenate([rough.reshape(-1), rough.mean(axis=1)[[0, -1]]])
    core = ellipsoid((0, 0, 0), radii, sides=sides, bands=bands)
    out = draw.normal(size=(_TUFTS, 3))
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    spread = draw.normal(scale=0.15, size=(_TUFTS, 3, 3)) * radii.min()
    tufts = ((0.98 * out * radii)[:, None] + spread).reshape(-1, 3)
    vertices = np.concatenate([core.vertices * factor[:, None], tufts])
    tuft_triangles = len(core.vertices) + np.arange(3 * _TUFTS).reshape(-1, 3)
    normals = vertices / radii**2
    return Surface(
        vertices + centre,
        np.concatenate([core.triangles, tuft_triangles]),
        normals / np.linalg.norm(normals, axis=1, keepdims=True),
    )


def _spruce() -> tuple[tuple[Surface, str], ...]:
    angle = 2 * np.pi * np.arange(10) / 10
    draw = generator("tree", "spruce")
    tiers: list[Surface] = []
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
        tiers.append(loft(np.stack(rings)))
    stem = tube([(0, 0, 0), (0, 0, 5.0)], [0.22, 0.12], sides=6)
    return (shaded(stem), "bark"), (shaded(joined(tiers)), "needles")
