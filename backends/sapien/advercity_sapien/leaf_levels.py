"""Levels of detail of leaves: far away few large ones are drawn for many small ones.

A random part of the leaves is kept, and enlarged to keep their total area (stochastic
simplification of aggregate detail, Cook et al. 2007).
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from advercity.geometry.mesh import Mesh
from advercity.materials import MATERIALS, Texture
from advercity_sapien.culling import ANY_PIXEL, PixelRange

LEAF_MATERIALS = frozenset(
    name for name, material in MATERIALS.items() if material.texture is Texture.LEAVES
)
"""Materials of meshes of single leaves."""
UPRIGHT_MATERIALS = frozenset(
    {"grass_blades", "grass_blades_dull", "crop_stalks", "crop_ears", "straw", "seedlings"}
)
"""Materials of blades from two corners at the root to a tip, which grow wider but never longer."""
WIDENING = 0.6
"""A blade standing for others is wider by this power of their number. Equal area would need 1, but
blades hide each other, and one so wide would be no blade."""
REDUCTION, LEVELS = 4, 3
"""Leaves of a level for one of the next, and how many levels there are."""
PIXELS_PER_LEAF = 2.0
"""Size of leaves in pixels below which the next level is drawn."""
LEAST_LEAVES = 200
"""Meshes of fewer leaves have one level."""


def list_levels(mesh: Mesh) -> Iterator[tuple[int, PixelRange]]:
    """List the levels of a mesh: the kept part of its leaves, for `thin_out`, and pixel sizes.

    Each level is drawn in its range of pixel sizes in metres.
    """
    if mesh.material not in LEAF_MATERIALS or len(mesh.triangles) < LEAST_LEAVES:
        yield 1, ANY_PIXEL
        return
    corners = mesh.vertices[mesh.triangles]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size_m = float(np.sqrt(np.linalg.norm(across, axis=1).mean() / 2.0))
    finest = 0.0
    for level in range(LEVELS):
        enlarged = float(np.sqrt(REDUCTION)) ** level
        coarsest = enlarged * size_m / PIXELS_PER_LEAF if level < LEVELS - 1 else np.inf
        yield REDUCTION**level, (finest, coarsest)
        finest = coarsest


def thin_out(mesh: Mesh, keep_one_of: int) -> Mesh:
    """Keep one leaf of some, as large as all of them, or one upright blade, wider than it was."""
    if keep_one_of == 1:
        return mesh
    kept = mesh.triangles[::keep_one_of]
    corners = mesh.vertices[kept]
    if mesh.material in UPRIGHT_MATERIALS:
        enlarged = _widen(corners, keep_one_of**WIDENING)
    else:
        middle = corners.mean(axis=1, keepdims=True)
        enlarged = middle + (corners - middle) * np.sqrt(keep_one_of, dtype=np.float32)
    return replace(
        mesh,
        vertices=enlarged.reshape(-1, 3),
        triangles=np.arange(kept.size, dtype=np.int32).reshape(-1, 3),
        normals=None if mesh.normals is None else mesh.normals[kept].reshape(-1, 3),
    )


def _widen(blades: NDArray[np.float32], factor: float) -> NDArray[np.float32]:
    """Widen the foot of blades (n, 3, 3)."""
    wide = blades.copy()
    foot = blades[:, :2].mean(axis=1, keepdims=True)
    wide[:, :2] = foot + (blades[:, :2] - foot) * np.float32(factor)
    return wide
