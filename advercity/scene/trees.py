"""Builds single trees: trunks that fork, and crowns of leaves around the ends of branches."""

from dataclasses import dataclass
from enum import IntEnum
from functools import cache

import numpy as np
from advercity_dsl.road import Species

from advercity.geometry.arrays import Float64Array
from advercity.geometry.directions import spread_directions
from advercity.geometry.mesh import TriangleSurface, join_surfaces, normalize, shade_smooth, xyz
from advercity.geometry.primitives import ellipsoid, tube
from advercity.randomness import create_generator
from advercity.scene.foliage import build_leaves


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
_CLUSTERS = {Detail.NEAR: 64, Detail.MIDDLE: 32, Detail.FAR: 18}
"""Ends of branches of a tree."""
_LEAVES = {Detail.NEAR: 50, Detail.MIDDLE: 24, Detail.FAR: 20}
"""Leaves of each."""
_LEAF_LENGTH_M = {Detail.NEAR: 0.25, Detail.MIDDLE: 0.44, Detail.FAR: 0.68}
_WHORLS = {Detail.NEAR: (18, 9), Detail.MIDDLE: (14, 8), Detail.FAR: (9, 6)}
"""Whorls of a spruce, and branches of each."""
_TWIGS = {Detail.NEAR: 6, Detail.MIDDLE: 4, Detail.FAR: 2}
"""Twigs on either side of such a branch."""

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
    cores = join_surfaces([_build_core(blob, draw) for blob in crown.blobs])
    leaves = _build_clusters(crown, ends, detail, draw)
    wood = _build_wood(crown, ends if detail < Detail.FAR else ends[:0])
    parts = (wood, "bark"), (leaves, "leaves"), (cores, "inner_leaves")
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


def _build_clusters(
    crown: _Crown, ends: Float64Array, detail: Detail, draw: np.random.Generator
) -> TriangleSurface:
    """Build leaves around the ends of branches."""
    count, length_m = _LEAVES[detail], _LEAF_LENGTH_M[detail]
    middle = np.mean([blob[:3] for blob in crown.blobs], axis=0)
    cluster_m = 0.3 * max(blob[3] for blob in crown.blobs) + 0.2 - 0.5 * length_m
    away = normalize(draw.normal(size=(len(ends) * count, 3)))
    # Leaves are where light comes: more at the outside of a cluster than within.
    offset = away * cluster_m * draw.uniform(0.0, 1.0, (len(away), 1)) ** 0.4
    root = np.repeat(ends, count, axis=0) + offset
    outward = normalize(normalize(root - middle + (0.0, 0.0, 0.4)) + 0.5 * away)
    return build_leaves(root, outward, length_m, draw, crown.droop)


def _build_core(
    blob: tuple[float, float, float, float, float], draw: np.random.Generator
) -> TriangleSurface:
    """Build the dense inside of a crown, through which no light comes."""
    x, y, z, radius, rise = blob
    core = ellipsoid((0, 0, 0), (radius, radius, rise), sides=6, bands=3)
    vertices = core.vertices * draw.uniform(0.22, 0.5, (len(core.vertices), 1))
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
    """Build a spruce: whorls of branches that hang, with twigs on either side and at the end."""
    whorls, branches = _WHORLS[detail]
    height = np.repeat(np.linspace(1.6, SPRUCE_HEIGHT_M - 0.5, whorls), branches)
    height += draw.uniform(-0.15, 0.15, len(height))
    turn = 2.0 * np.pi * (np.arange(len(height)) / branches + draw.uniform(0, 1, len(height)) * 0.4)
    reach = 2.3 * (1.0 - height / SPRUCE_HEIGHT_M) ** 0.85 * draw.uniform(0.8, 1.15, len(height))
    away = np.column_stack([np.cos(turn), np.sin(turn), np.full(len(turn), -0.32)])
    aside = np.column_stack([-np.sin(turn), np.cos(turn), np.full(len(turn), -0.25)])
    root = np.column_stack([np.zeros((len(height), 2)), height])
    needles = _build_twigs(root, away * (reach + 0.25)[:, None], aside, _TWIGS[detail], draw)
    stem = tube([(0, 0, 0), (0, 0, SPRUCE_HEIGHT_M - 0.3)], [0.22, 0.04], sides=7)
    tip = tube([(0, 0, SPRUCE_HEIGHT_M - 0.9), (0, 0, SPRUCE_HEIGHT_M)], [0.14, 0.01], sides=5)
    core = tube([(0, 0, 1.5), (0, 0, SPRUCE_HEIGHT_M - 0.6)], [0.7, 0.05], sides=7)
    return (
        (shade_smooth(stem), "bark"),
        (join_surfaces([needles, shade_smooth(tip)]), "needles"),
        (shade_smooth(core), "inner_leaves"),
    )


def _build_twigs(
    root: Float64Array,
    along: Float64Array,
    aside: Float64Array,
    count: int,
    draw: np.random.Generator,
) -> TriangleSurface:
    """Build twigs of branches (n, 3): a triangle each, shorter towards the end of the branch."""
    at = np.linspace(0.25, 0.9, count)[None, :, None]
    side = np.array([-1.0, 1.0])[None, None, :]
    at, side = np.broadcast_arrays(at, side)
    foot = root[:, None, None] + at[..., None] * along[:, None, None]
    length = np.linalg.norm(along, axis=1)[:, None, None] * (0.75 - 0.45 * at)
    length = length * draw.uniform(0.75, 1.25, (len(root), count, 2))
    onward = along / np.linalg.norm(along, axis=1, keepdims=True)
    reach = side[..., None] * aside[:, None, None] + 0.9 * onward[:, None, None]
    reach = normalize(reach + draw.normal(scale=0.12, size=reach.shape)) * length[..., None]
    half = along[:, None, None] * (0.42 / count)
    corners = np.stack([foot - half, foot + half, foot + reach], axis=-2).reshape(-1, 3)
    normals = np.repeat(onward + xyz(z=0.9), 2 * count, axis=0)
    normals = normalize(normals + draw.normal(scale=0.25, size=normals.shape))
    triangles = np.arange(len(corners)).reshape(-1, 3)
    return TriangleSurface(corners, triangles, np.repeat(normals, 3, axis=0))
