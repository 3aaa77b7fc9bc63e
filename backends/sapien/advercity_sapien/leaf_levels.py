"""Levels of detail of leaves: far away few large ones are drawn for many small ones.

A random part of the leaves is kept, and enlarged so that their area stays the same (stochastic
simplification of aggregate detail, Cook et al. 2007).
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from advercity.geometry.mesh import Mesh
from advercity.materials import MATERIALS, Texture
from advercity_sapien.culling import ANY_PIXEL, PixelRange

LEAF_MATERIALS = frozenset(
    name for name, material in MATERIALS.items() if material.texture is Texture.LEAVES
)
"""Materials of meshes that consist of single leaves."""
REDUCTION, LEVELS = 4, 3
"""Leaves of a level for one of the next, and how many levels there are."""
PIXELS_PER_LEAF = 2.0
"""Size of leaves in pixels below which the next level is drawn."""
LEAST_LEAVES = 200
"""Meshes of fewer leaves have one level."""


def build_levels(mesh: Mesh) -> Iterator[tuple[Mesh, PixelRange]]:
    """Build the levels of a mesh, and the sizes of a pixel in metres for which each is drawn."""
    if mesh.material not in LEAF_MATERIALS or len(mesh.triangles) < LEAST_LEAVES:
        yield mesh, ANY_PIXEL
        return
    corners = mesh.vertices[mesh.triangles]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size_m = float(np.sqrt(np.linalg.norm(across, axis=1).mean() / 2.0))
    finest = 0.0
    for level in range(LEVELS):
        enlarged = float(np.sqrt(REDUCTION)) ** level
        coarsest = enlarged * size_m / PIXELS_PER_LEAF if level < LEVELS - 1 else np.inf
        yield thin_out(mesh, REDUCTION**level), (finest, coarsest)
        finest = coarsest


def thin_out(mesh: Mesh, keep_one_of: int) -> Mesh:
    """Keep one leaf of some, as large as all of them."""
    if keep_one_of == 1:
        return mesh
    kept = mesh.triangles[::keep_one_of]
    corners = mesh.vertices[kept]
    middle = corners.mean(axis=1, keepdims=True)
    enlarged = middle + (corners - middle) * np.sqrt(keep_one_of, dtype=np.float32)
    return replace(
        mesh,
        vertices=enlarged.reshape(-1, 3),
        triangles=np.arange(kept.size, dtype=np.int32).reshape(-1, 3),
        normals=None if mesh.normals is None else mesh.normals[kept].reshape(-1, 3),
    )
