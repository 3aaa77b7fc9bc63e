"""Builds distant woods: crowns along their edges, and a canopy hidden behind them."""

from functools import cache

import numpy as np
import shapely
from numpy.typing import NDArray

from advercity.geometry.arrays import Float64Array
from advercity.geometry.mesh import (
    MeshPart,
    TriangleSurface,
    join_surfaces,
    normalize,
    repeat_surface,
    shade_smooth,
)
from advercity.geometry.primitives import ellipsoid, grid_sheet, loft_rings
from advercity.randomness import create_generator
from advercity.scene.crops import find_border_points, find_free_cells
from advercity.scene.foliage import roughen, strew_leaves
from advercity.scene.site import Rectangle, Site, StreetSide
from advercity.semantics import Semantic

WOODS_HEIGHT_M = 11.0
TREE_SPACING_M, MAX_TREES = 6.0, 700
"""Distance between the trees of a wood, larger where there would be more of them."""
WOODS_CLEARANCE_M = 10.0
SPRUCE_FRACTION = 0.25
SHAPES = 6
"""Number of different crowns of a kind; others differ in size and turn only."""
CROWN_RADIUS_M = 0.55 * TREE_SPACING_M
LEAF_M, COVERAGE = 1.0, 0.16
"""Length of the leaves on crowns, each a twig with its own, and their area over the crowns'."""
SEEN_FRACTION = 0.5
"""Part of the edge with trees, near streets; the other side has only the canopy."""
CANOPY_RATIOS = (0.5, 0.85)
"""Heights of treetops behind the edge, over the wood's."""


def build_woods(
    band: StreetSide | Rectangle, height_m: float | None, site: Site, key: str
) -> list[MeshPart]:
    """Build the edges and tops of a distant wood."""
    extent = band.extent if isinstance(band, Rectangle) else (band.length_m, band.depth_m)
    spacing_m = max(TREE_SPACING_M, float(np.sqrt(np.prod(extent) / MAX_TREES)))
    rows = band.sample_grid(spacing_m, spacing_m)
    height = height_m or WOODS_HEIGHT_M
    draw = create_generator("woods", key)
    free = site.is_free(rows.reshape(-1, 2), WOODS_CLEARANCE_M).reshape(rows.shape[:2])
    cells = find_free_cells(rows, free & _is_inside_rough_outline(rows))
    if not cells.any():
        return []
    spread = np.linalg.norm(rows[1, 0] - rows[0, 0])
    shifted = rows + draw.uniform(-0.35, 0.35, rows.shape) * spread
    ground = site.project_to_ground(shifted.reshape(-1, 2)).reshape(*free.shape, 3)
    edge = ground[find_border_points(cells) & _touch(cells)]
    away_m = shapely.distance(site.street_axes, shapely.points(edge[:, :2]))
    seen = edge[away_m <= np.quantile(away_m, SEEN_FRACTION)]
    return [_build_canopy(ground, cells, height, draw), *_build_edge(seen, height, draw)]


def _touch(cells: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Find the grid points at a corner of any of some cells."""
    padded = np.pad(cells, 1)
    return padded[:-1, :-1] | padded[1:, :-1] | padded[:-1, 1:] | padded[1:, 1:]


def _build_canopy(
    ground: Float64Array, cells: NDArray[np.bool_], height_m: float, draw: np.random.Generator
) -> MeshPart:
    """Build the dense part behind the edge's trees, over ground (n, m, 3), lower than most."""
    points = ground.copy()
    tops = draw.uniform(*CANOPY_RATIOS, points.shape[:2]) * height_m
    points[..., 2] += np.where(find_border_points(cells), -0.3, tops)
    return MeshPart(grid_sheet(points, cells), "inner_leaves", Semantic.VEGETATION)


def _build_edge(feet: Float64Array, height_m: float, draw: np.random.Generator) -> list[MeshPart]:
    """Build trees with branches down to the ground at feet (n, 3)."""
    is_spruce = draw.random(len(feet)) < SPRUCE_FRACTION
    shape = draw.integers(SHAPES, size=len(feet))
    yaw = draw.uniform(0.0, 2.0 * np.pi, len(feet))
    size = draw.uniform(0.6, 1.0, len(feet))
    tall = size * height_m / WOODS_HEIGHT_M
    scale = np.column_stack([0.5 + 0.6 * size, 0.5 + 0.6 * size, tall])
    parts: list[MeshPart] = []
    for of_spruces, number in np.ndindex(2, SHAPES):
        these = (is_spruce == bool(of_spruces)) & (shape == number)
        if not these.any():
            continue
        for part, material in _build_crown(bool(of_spruces), number):
            copies = repeat_surface(part, feet[these], yaw=yaw[these], scale=scale[these])
            parts.append(MeshPart(copies, material, Semantic.VEGETATION))
    return parts


@cache
def _build_crown(is_spruce: bool, number: int) -> tuple[tuple[TriangleSurface, str], ...]:
    """Build a crown of a height of `WOODS_HEIGHT_M`, and leaves on it."""
    draw = create_generator("woods/crown", is_spruce, number)
    inside = shade_smooth(_build_cone(draw)) if is_spruce else _build_dome(draw)
    leaves = strew_leaves(inside, LEAF_M, draw, COVERAGE)
    kind = "needles" if is_spruce else "leaves"
    return (inside, f"inner_{kind}"), (leaves, kind)


def _build_dome(draw: np.random.Generator) -> TriangleSurface:
    """Build the crown of a broad-leaved tree, and a shrub below it."""
    high, wide = WOODS_HEIGHT_M, CROWN_RADIUS_M
    crown = (*draw.uniform(-0.3, 0.3, 2), 0.6 * high), (wide, wide, 0.4 * high), (8, 5)
    aside = draw.uniform(-1.5, 1.5, 2)
    shrub = (*aside, 0.12 * high), (0.95 * wide, 0.95 * wide, 0.26 * high), (7, 4)
    pieces: list[TriangleSurface] = []
    for centre, radii, (sides, bands) in (crown, shrub):
        ball = ellipsoid((0, 0, 0), (1, 1, 1), sides=sides, bands=bands)
        bumps = draw.uniform(0.8, 1.12, (len(ball.vertices), 1))
        vertices = ball.vertices * bumps * radii + centre
        pieces.append(TriangleSurface(vertices, ball.triangles, normalize(ball.vertices / radii)))
    return roughen(join_surfaces(pieces), draw)


def _build_cone(draw: np.random.Generator) -> TriangleSurface:
    """Build a spruce: skirts one above the other, with uneven hems."""
    tiers, around = 6, 6
    hems = np.linspace(0.02, 0.85, tiers)
    heights = np.stack([hems, hems + 0.12], axis=1).ravel()
    radii = 0.9 * CROWN_RADIUS_M * (1.0 - heights) ** 0.85 * np.tile([1.0, 0.6], tiers)
    turn = 2.0 * np.pi * np.arange(around) / around
    ring = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(around)])
    rings = radii[:, None, None] * draw.uniform(0.75, 1.2, (2 * tiers, around, 1)) * ring
    uneven = draw.uniform(-0.02, 0.02, (2 * tiers, around))
    rings[..., 2] = WOODS_HEIGHT_M * (heights[:, None] + uneven)
    return loft_rings(rings)


def _is_inside_rough_outline(rows: Float64Array) -> NDArray[np.bool_]:
    """Test which points of a grid (n, m, 2) lie inside a rounded outline with bays."""
    u, v = (np.linspace(-1, 1, count) for count in rows.shape[:2])
    x, y = rows[..., 0], rows[..., 1]
    bays = np.sin(x / 17 + np.sin(y / 41)) + np.sin(y / 23 + np.sin(x / 37))
    return u[:, None] ** 4 + v**4 < 0.8 + 0.22 * bays
