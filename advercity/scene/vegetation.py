"""Builds trees in their places."""

from itertools import product

import numpy as np
import shapely
from advercity_dsl.road import Species

from advercity.geometry.arrays import Float64Array
from advercity.geometry.mesh import MeshPart, repeat_surface
from advercity.randomness import create_generator
from advercity.scene.site import Rectangle, Site, StreetSide
from advercity.scene.trees import Detail, build_tree
from advercity.semantics import Semantic

MAX_TREES = 400
"""Greatest number of trees in one area; larger areas have them further apart."""
TREE_SPACING_M = 8.0
TRUNK_CLEARANCE_M, ROW_CLEARANCE_M = 3.0, 1.0
"""Distance of trunks from reserved areas, for scattered trees and for rows."""
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


def build_trees(
    points: Float64Array,
    height_m: float | None,
    site: Site,
    key: str,
    species: tuple[Species, ...] = (),
    *,
    clearance_m: float = TRUNK_CLEARANCE_M,
) -> list[MeshPart]:
    """Build trees of several species at points (n, 2), except on reserved ground."""
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
