"""Builds single trees: trunks that fork, and crowns of leaf sprays around the ends of branches.

A spray is a small folded sheet that represents a twig with its leaves, so that rays and labels see
gaps where the image does, without cut-out textures. Normals are those of the crown with a tilt of
each spray: light then falls on the crown as a whole, and sprays glitter on it.
"""

from dataclasses import dataclass
from enum import IntEnum
from functools import cache

import numpy as np
from advercity_dsl.road import Species

from advercity.geometry.arrays import Float64Array
from advercity.geometry.directions import spread_directions
from advercity.geometry.mesh import TriangleSurface, join_surfaces, normalize, shade_smooth
from advercity.geometry.primitives import ellipsoid, tube
from advercity.randomness import create_generator


class Detail(IntEnum):
    """How finely a tree is built: for close views, across a street, and beyond."""

    NEAR = 0
    MIDDLE = 1
    FAR = 2


@dataclass(frozen=True)
class _Crown:
    """A species: its trunk, and ellipsoids (x, y, z, radius, half height) that leaves fill."""

    trunk_m: float
    trunk_radius_m: float
    blobs: tuple[tuple[float, float, float, float, float], ...]
    droop: float = 0.0


_CROWNS = {
    Species.OAK: _Crown(
        2.6,
        0.26,
        (
            (0.0, 0.0, 5.6, 2.3, 1.9),
            (1.5, 0.6, 4.6, 1.6, 1.2),
            (-1.3, 1.0, 4.8, 1.6, 1.2),
            (-0.2, -1.5, 4.6, 1.5, 1.2),
        ),
    ),
    Species.POPLAR: _Crown(
        1.8,
        0.2,
        ((0.0, 0.0, 7.4, 0.95, 2.6), (0.15, 0.1, 4.6, 1.15, 2.3), (0.0, 0.0, 2.9, 0.8, 1.0)),
    ),
    Species.BIRCH: _Crown(
        1.7,
        0.12,
        ((0.0, 0.0, 4.1, 0.9, 1.1), (0.2, -0.1, 3.1, 1.2, 1.1), (-0.3, 0.3, 2.4, 0.9, 0.7)),
        0.5,
    ),
    Species.MAPLE: _Crown(
        1.9,
        0.18,
        (
            (0.0, 0.0, 4.5, 1.6, 1.4),
            (0.9, 0.1, 3.7, 1.5, 1.2),
            (-0.9, 0.7, 3.8, 1.5, 1.2),
            (0.0, -1.0, 3.5, 1.4, 1.1),
        ),
    ),
}
SPRUCE_HEIGHT_M = 10.8
_CLUSTERS = {Detail.NEAR: 44, Detail.MIDDLE: 26, Detail.FAR: 14}
"""Ends of branches of a tree."""
_SPRAYS = {Detail.NEAR: 20, Detail.MIDDLE: 12, Detail.FAR: 6}
"""Sprays of each."""
_SPRAY_LENGTH_M = {Detail.NEAR: 0.4, Detail.MIDDLE: 0.62, Detail.FAR: 1.0}
_WHORLS = {Detail.NEAR: (20, 10), Detail.MIDDLE: (13, 8), Detail.FAR: (8, 6)}
"""Whorls of a spruce, and branches of each."""

TreeParts = tuple[tuple[TriangleSurface, str], ...]


@cache
def build_tree(species: Species, detail: Detail) -> tuple[TreeParts, float]:
    """Build the shaded parts of a tree at the origin with their materials, and its height."""
    # The key holds the species' type by name: `Species` may not be renamed.
    draw = create_generator("tree", species, int(detail))
    if species is Species.SPRUCE:
        return _build_spruce(detail, draw), SPRUCE_HEIGHT_M
    crown = _CROWNS[species]
    ends = _spread_ends(crown, _CLUSTERS[detail], draw)
    leaves = [_build_sprays(crown, ends, detail, draw)]
    leaves += [_build_core(blob, draw) for blob in crown.blobs]
    wood = _build_wood(crown, ends if detail < Detail.FAR else ends[:0])
    parts = (wood, "bark"), (join_surfaces(leaves), "leaves")
    return parts, max(z + rise for *_, z, _, rise in crown.blobs)


def _spread_ends(crown: _Crown, count: int, draw: np.random.Generator) -> Float64Array:
    """Spread the ends of branches (n, 3) through the outer part of the crown."""
    volumes = np.array([radius**2 * rise for *_, radius, rise in crown.blobs])
    counts = np.maximum(1, np.round(count * volumes / volumes.sum()).astype(int))
    ends: list[Float64Array] = []
    for (x, y, z, radius, rise), number in zip(crown.blobs, counts, strict=True):
        # Evenly, so that crowns of few branches are as wide as those of many.
        direction = normalize(spread_directions(number) + draw.normal(scale=0.12, size=(number, 3)))
        depth = draw.uniform(0.7, 0.88, (number, 1)) * (radius, radius, rise)
        ends.append(direction * depth + (x, y, z))
    return np.concatenate(ends)


def _build_sprays(
    crown: _Crown, ends: Float64Array, detail: Detail, draw: np.random.Generator
) -> TriangleSurface:
    """Build sprays around the ends of branches: each two triangles, folded along the twig."""
    count, length = _SPRAYS[detail], _SPRAY_LENGTH_M[detail]
    middle = np.mean([blob[:3] for blob in crown.blobs], axis=0)
    cluster_m = 0.36 * max(blob[3] for blob in crown.blobs) + 0.2 - 0.5 * length
    away = normalize(draw.normal(size=(len(ends) * count, 3)))
    # Leaves are where light comes: more at the outside of a cluster than within.
    away *= cluster_m * draw.uniform(0.0, 1.0, (len(away), 1)) ** 0.5
    root = np.repeat(ends, count, axis=0) + away
    outward = normalize(root - middle + (0.0, 0.0, 0.4))
    along = normalize(outward + draw.normal(scale=0.7, size=root.shape) - (0.0, 0.0, crown.droop))
    across = normalize(np.cross(along, draw.normal(size=root.shape)))
    size = length * draw.uniform(0.7, 1.3, (len(root), 1))
    tilt = draw.normal(scale=0.35, size=root.shape)
    return _build_rhombi(root, along * size, across * size * 0.36, outward + tilt)


def _build_rhombi(
    root: Float64Array, along: Float64Array, across: Float64Array, normals: Float64Array
) -> TriangleSurface:
    """Build pointed leaves (k,) of two triangles: from their root, as long and half as wide."""
    belly = root + 0.45 * along
    corners = np.stack([root, belly - across, root + along, belly + across], axis=1)
    first = 4 * np.arange(len(root))[:, None, None]
    triangles = first + np.array([(0, 1, 2), (0, 2, 3)])
    return TriangleSurface(
        corners.reshape(-1, 3), triangles.reshape(-1, 3), np.repeat(normalize(normals), 4, axis=0)
    )


def _build_core(
    blob: tuple[float, float, float, float, float], draw: np.random.Generator
) -> TriangleSurface:
    """Build the dense inside of a crown, through which no light comes."""
    x, y, z, radius, rise = blob
    core = ellipsoid((0, 0, 0), (radius, radius, rise), sides=7, bands=4)
    vertices = core.vertices * draw.uniform(0.38, 0.66, (len(core.vertices), 1))
    return TriangleSurface(vertices + np.array([x, y, z]), core.triangles, normalize(vertices))


def _build_wood(crown: _Crown, ends: Float64Array) -> TriangleSurface:
    """Build the trunk and a branch to every fourth end."""
    radius, fork = crown.trunk_radius_m, crown.trunk_m
    top = max(z + 0.4 * rise for *_, z, _, rise in crown.blobs)
    points = [(0, 0, 0), (0, 0, 0.35), (0.05, 0, fork), (0, 0.05, top)]
    stem = tube(points, [1.35 * radius, radius, 0.8 * radius, 0.2 * radius], sides=8)
    branches = [
        tube(
            [(0, 0, max(fork, 0.5 * end[2])), (0.45 * end[0], 0.45 * end[1], 0.72 * end[2]), end],
            [0.35 * radius, 0.25 * radius, 0.08 * radius],
            sides=4,
        )
        for end in ends[::4]
    ]
    return shade_smooth(join_surfaces([stem, *branches]))


def _build_spruce(detail: Detail, draw: np.random.Generator) -> TreeParts:
    """Build a spruce: whorls of branches that hang, each a spray on either side of its twig."""
    whorls, branches = _WHORLS[detail]
    height = np.repeat(np.linspace(1.3, SPRUCE_HEIGHT_M - 0.5, whorls), branches)
    height += draw.uniform(-0.15, 0.15, len(height))
    turn = 2.0 * np.pi * (np.arange(len(height)) / branches + draw.uniform(0, 1, len(height)) * 0.4)
    reach = 2.3 * (1.0 - height / SPRUCE_HEIGHT_M) ** 0.85 * draw.uniform(0.8, 1.15, len(height))
    away = np.column_stack([np.cos(turn), np.sin(turn), np.full(len(turn), -0.32)])
    along = away * (reach + 0.25)[:, None]
    aside = np.column_stack([-np.sin(turn), np.cos(turn), np.full(len(turn), -0.25)])
    root = np.column_stack([np.zeros((len(height), 2)), height])
    normals = away + np.array([0.0, 0.0, 0.9]) + draw.normal(scale=0.2, size=root.shape)
    width = (0.3 * reach + 0.12)[:, None]
    sprays = _build_rhombi(root, along, aside * width, normals)
    # A second layer below, turned, closes the gaps between branches.
    lower = _build_rhombi(
        root - (0.0, 0.0, 0.25), along * 0.8 + aside * width * 0.8, aside * width, normals
    )
    stem = tube([(0, 0, 0), (0, 0, SPRUCE_HEIGHT_M - 0.3)], [0.22, 0.04], sides=7)
    tip = tube([(0, 0, SPRUCE_HEIGHT_M - 0.9), (0, 0, SPRUCE_HEIGHT_M)], [0.14, 0.01], sides=5)
    core = tube([(0, 0, 1.5), (0, 0, SPRUCE_HEIGHT_M - 0.6)], [1.2, 0.08], sides=7)
    needles = join_surfaces([sprays, lower, shade_smooth(tip), shade_smooth(core)])
    return (shade_smooth(stem), "bark"), (needles, "needles")
