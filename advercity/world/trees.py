"""Trees."""

from functools import cache
from itertools import product

import numpy as np
import shapely
from advercity_dsl.base import Point2
from advercity_dsl.road import Species

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
NEAR_M = 14.0
"""From a street's axis: nearer trees have finer leaves."""


def grown(
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
    kinds = species or tuple(Species)
    shares = np.array([_SHARES[name] for name in kinds])
    drawn = draw.choice(len(kinds), len(free), p=shares / shares.sum())
    size = draw.uniform(0.75, 1.25, len(free)) if height_m is None else np.full(len(free), 1.0)
    slender = draw.uniform(0.9, 1.15, len(free))
    yaw = draw.uniform(0.0, 2 * np.pi, len(free))
    near = shapely.distance(site.axes, shapely.points(free)) < NEAR_M
    pieces: list[Piece] = []
    for (index, name), is_near in product(enumerate(kinds), (False, True)):
        these = (drawn == index) & (near == is_near)
        if not these.any():
            continue
        parts, natural_m = _prototype(name, is_near=is_near)
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


_PLANT = Semantic.VEGETATION
_TUFTS, _NEAR_TUFTS = 46, 110
"""Loose triangles of leaves per clump; vegetation is seen from both sides."""
_SHARES = {
    Species.OAK: 0.34,
    Species.MAPLE: 0.16,
    Species.BIRCH: 0.16,
    Species.POPLAR: 0.14,
    Species.SPRUCE: 0.20,
}


@cache
def _prototype(name: Species, *, is_near: bool) -> tuple[tuple[tuple[Surface, str], ...], float]:
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
        _clump(np.array([x, y, z]), np.array([r, r, rise]), draw, is_near=is_near)
        for x, y, z, r, rise in blobs
    ]
    top = max(z + rise for *_, z, _, rise in blobs)
    stem = tube([(0, 0, 0), (0.05, 0, 1.0), (0, 0.05, trunk + 1.0)], [0.24, 0.17, 0.11], sides=6)
    return ((shaded(stem), "bark"), (joined(crown), "leaves")), top


def _clump(centre: Floats, radii: Floats, draw: np.random.Generator, *, is_near: bool) -> Surface:
    """Leaves around a centre: a rough ellipsoid with tufts, lit as if it were a smooth one."""
    sides, bands = 8, 4
    rough = draw.uniform(0.82, 1.1, (bands + 1, sides))
    factor = np.concatenate([rough.reshape(-1), rough.mean(axis=1)[[0, -1]]])
    core = ellipsoid((0, 0, 0), radii, sides=sides, bands=bands)
    tuft_count, size = (_NEAR_TUFTS, 0.085) if is_near else (_TUFTS, 0.15)
    out = draw.normal(size=(tuft_count, 3))
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    spread = draw.normal(scale=size, size=(tuft_count, 3, 3)) * radii.min()
    reach = draw.uniform(0.86, 1.04, (tuft_count, 1))
    tufts = ((reach * out * radii)[:, None] + spread).reshape(-1, 3)
    vertices = np.concatenate([core.vertices * factor[:, None], tufts])
    tuft_triangles = len(core.vertices) + np.arange(3 * tuft_count).reshape(-1, 3)
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
