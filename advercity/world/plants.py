"""Trees and crops."""

from functools import cache

import numpy as np
from advercity_dsl.base import Point2
from numpy.typing import NDArray

from advercity.randomness import generator
from advercity.semantics import Semantic
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
TRUNK_CLEARANCE_M = 3.0
CROP_HEIGHT_M = 0.6
CROP_CLEARANCE_M = 0.8
_ROW_M, _STEP_M = 1.3, 3.0


def trees(points: Floats, height_m: float | None, site: Site, key: str) -> list[Piece]:
    """Trees at points (n, 2), of several species; those on what must stay free are left out."""
    free = points[site.is_free(points, TRUNK_CLEARANCE_M)] if len(points) else points
    if not len(free):
        return []
    draw = generator("trees", key)
    feet = site.on_ground(free) - (0.0, 0.0, 0.15)
    species = draw.choice(len(_SPECIES), len(free), p=_SHARES)
    size = draw.uniform(0.75, 1.25, len(free)) if height_m is None else np.full(len(free), 1.0)
    slender = draw.uniform(0.9, 1.15, len(free))
    yaw = draw.uniform(0.0, 2 * np.pi, len(free))
    pieces: list[Piece] = []
    for index, name in enumerate(_SPECIES):
        these = species == index
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


def crops(area: tuple[Point2, Point2], height_m: float | None, site: Site, key: str) -> list[Piece]:
    """A field of plants in rows along its longer side: a ridged surface over the ground."""
    low, high = rectangle(area)
    lengthways = int(np.argmax(high - low))
    across = np.arange(low[1 - lengthways], high[1 - lengthways] + 1e-6, _ROW_M / 2)
    along = np.linspace(
        low[lengthways],
        high[lengthways],
        2 + int(np.ptp((low, high), axis=0)[lengthways] / _STEP_M),
    )
    first, second = np.meshgrid(along, across, indexing="ij")
    plane = np.stack([first, second] if lengthways == 0 else [second, first], axis=-1)
    flat = plane.reshape(-1, 2)
    grown = site.is_free(flat, CROP_CLEARANCE_M).reshape(first.shape)
    cells = grown[:-1, :-1] & grown[1:, :-1] & grown[:-1, 1:] & grown[1:, 1:]
    if not cells.any():
        return []
    ridge = np.where(np.arange(len(across)) % 2, 1.0, 0.45)
    rough = generator("crops", key).uniform(0.82, 1.1, first.shape)
    rise = (height_m or CROP_HEIGHT_M) * ridge * rough
    rise[_border(cells)] = -0.05
    points = site.on_ground(flat) + np.column_stack([np.zeros_like(flat), rise.reshape(-1)])
    rows = np.zeros_like(grown)
    rows[:, 1::2] = True
    sheet = _sheet(points, cells, flip=lengthways == 1)
    stalks = _stalks(points[(rows & ~_border(cells)).reshape(-1)], key)
    return [Piece(sheet, "crops", _PLANT), Piece(stalks, "crops", _PLANT)]


def _stalks(tops: Floats, key: str) -> Surface:
    """Upright leaves on the ridges, four about every point (n, 3), lit like the field below."""
    draw = generator("stalks", key)
    foot = np.repeat(tops, 4, axis=0)
    foot += draw.uniform(-1, 1, foot.shape) * (0.5, 0.5, 0.0) * _STEP_M / 2
    yaw = draw.uniform(0, 2 * np.pi, len(foot))
    side = 0.16 * np.column_stack([np.cos(yaw), np.sin(yaw), np.zeros(len(foot))])
    lean = draw.uniform((-0.1, -0.1, 0.15), (0.1, 0.1, 0.4), foot.shape)
    root = np.array([0.0, 0.0, 0.25])
    corners = np.stack([foot - side - root, foot + side - root, foot + lean], axis=1).reshape(-1, 3)
    triangles = np.arange(len(corners)).reshape(-1, 3)
    return Surface(corners, triangles, np.tile([0.0, 0.0, 1.0], (len(corners), 1)))


def _border(cells: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Grid points that are not wholly surrounded by cells of the field."""
    padded = np.pad(cells, 1)
    return ~(padded[:-1, :-1] & padded[1:, :-1] & padded[:-1, 1:] & padded[1:, 1:])


def _sheet(points: Floats, cells: NDArray[np.bool_], *, flip: bool) -> Surface:
    columns = cells.shape[1] + 1
    i, j = np.nonzero(cells)
    a, b = i * columns + j, (i + 1) * columns + j
    quads = np.stack([a, b, b + 1, a, b + 1, a + 1], axis=-1).reshape(-1, 3)
    return Surface(points, quads[:, ::-1] if flip else quads)


_PLANT = Semantic.VEGETATION
_TUFTS = 26
"""Loose triangles of leaves per clump; vegetation is seen from both sides."""
_SPECIES = ("broad", "tall", "young", "spruce", "bushy")
_SHARES = (0.34, 0.14, 0.16, 0.20, 0.16)


@cache
def _prototype(name: str) -> tuple[tuple[tuple[Surface, str], ...], float]:
    """Shaded parts of a tree of a species, standing at the origin, and its height in metres."""
    if name == "spruce":
        return _spruce(), 10.8
    trunk, blobs = {
        "broad": (
            3.2,
            ((0, 0, 5.6, 2.5, 1.9), (1.4, 0.6, 4.7, 1.6, 1.3), (-1.2, 1.0, 4.9, 1.6, 1.3)),
        ),
        "tall": (2.6, ((0, 0, 6.2, 1.25, 3.8), (0.3, 0.2, 4.2, 1.2, 2.0))),
        "young": (2.0, ((0, 0, 3.6, 1.4, 1.6), (0.4, -0.3, 2.9, 1.1, 0.9))),
        "bushy": (
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
    spread = draw.normal(scale=0.24, size=(_TUFTS, 3, 3)) * radii.min()
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
