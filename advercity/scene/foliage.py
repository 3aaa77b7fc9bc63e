"""Builds leaves: triangles from stalk to tip with a belly, along twigs or strewn over a surface.

A leaf is one triangle without cut-outs, so rays, labels and images see the same gaps. A leaf
larger than real ones represents some leaves of a twig.
"""

from dataclasses import replace

import numpy as np

from advercity.geometry.arrays import Float64Array
from advercity.geometry.mesh import MeshPart, TriangleSurface, normalize, xyz
from advercity.semantics import Semantic

WIDTH_RATIO, BELLY_RATIO = 0.55, 0.45
"""Width of a leaf over its length, and the widest place along it: half a leaf, as if folded."""
COVERAGE = 0.55
"""Area of the leaves on a surface over its own."""
HEDGE_LEAF_M = 0.18
UNEVENNESS = 0.4
"""Deviation of the normals of crowns, as of their branches, over their length."""


def build_leaves(
    roots: Float64Array,
    along: Float64Array,
    outward: Float64Array,
    length_m: float,
    draw: np.random.Generator,
) -> TriangleSurface:
    """Build a leaf at each of some points (n, 3), about along a direction and facing another.

    Normals are between leaf and crown: light falls on the crown as a whole, and leaves glitter.
    """
    facing = normalize(outward + draw.normal(scale=0.45, size=roots.shape) + xyz(z=0.3))
    along = normalize(along - facing * np.sum(along * facing, axis=1, keepdims=True))
    length = length_m * draw.uniform(0.65, 1.35, (len(roots), 1))
    aside = np.cross(facing, along) * (WIDTH_RATIO * length)
    belly = roots + along * (BELLY_RATIO * length) + aside
    corners = np.stack([roots, belly, roots + along * length], axis=1)
    triangles = np.arange(3 * len(roots)).reshape(-1, 3)[:, ::-1]
    normals = np.repeat(normalize(normalize(outward) + facing), 3, axis=0)
    return TriangleSurface(corners.reshape(-1, 3), triangles, normals)


def roughen(surface: TriangleSurface, draw: np.random.Generator) -> TriangleSurface:
    """Turn the normals of a crown at random: light falls on it as on many branches."""
    assert surface.normals is not None
    turned = surface.normals + draw.normal(scale=UNEVENNESS, size=surface.normals.shape)
    return replace(surface, normals=normalize(turned))


def build_foliage(
    surface: TriangleSurface,
    length_m: float,
    draw: np.random.Generator,
    coverage: float = COVERAGE,
) -> list[MeshPart]:
    """Build the dense inside of a shrub or a wood, and leaves on it."""
    leaves = strew_leaves(surface, length_m, draw, coverage)
    return [
        MeshPart(surface, "inner_leaves", Semantic.VEGETATION),
        MeshPart(leaves, "leaves", Semantic.VEGETATION),
    ]


def strew_leaves(
    surface: TriangleSurface, length_m: float, draw: np.random.Generator, coverage: float
) -> TriangleSurface:
    """Build leaves of a length on a surface, of a total area relative to its own."""
    a, b, c = (surface.vertices[surface.triangles[:, corner]] for corner in range(3))
    across = np.cross(b - a, c - a)
    area = np.linalg.norm(across, axis=1) / 2.0
    count = round(coverage * area.sum() / (0.5 * WIDTH_RATIO * length_m**2))
    face = draw.choice(len(area), count, p=area / area.sum())
    u, v = draw.uniform(size=(2, count, 1))
    u, v = np.where(u + v > 1.0, 1.0 - u, u), np.where(u + v > 1.0, 1.0 - v, v)
    outward = normalize(across[face])
    roots = (1.0 - u - v) * a[face] + u * b[face] + v * c[face]
    roots += outward * length_m * draw.uniform(0.0, 0.4, (count, 1))
    return build_leaves(roots, draw.normal(size=roots.shape), outward, length_m, draw)
