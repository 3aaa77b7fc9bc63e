"""Boxes of poles, signs and guard rails, which even rays of a radar may miss."""

from collections.abc import Sequence

import numpy as np

from advercity.geometry.arrays import Float64Array
from advercity.geometry.mesh import Mesh
from advercity.semantics import Semantic

THIN_THINGS = (
    Semantic.POLE,
    Semantic.TRAFFIC_SIGN,
    Semantic.TRAFFIC_LIGHT,
    Semantic.GUARD_RAIL,
)
GROUP_M = 1.0
"""Size of the squares of the ground whose triangles share a box."""


def find_reflector_boxes(meshes: Sequence[Mesh]) -> Float64Array:
    """Find boxes (n, 2, 3) around all thin things, each by its lowest and highest corner."""
    triangles = [mesh.vertices[mesh.triangles] for mesh in meshes if mesh.semantic in THIN_THINGS]
    if not triangles:
        return np.zeros((0, 2, 3))
    corners = np.concatenate(triangles).astype(float)
    squares = np.floor(corners.mean(axis=1)[:, :2] / GROUP_M).astype(np.int64)
    order = np.lexsort(squares.T)
    is_new = np.ones(len(order), np.bool_)
    is_new[1:] = (np.diff(squares[order], axis=0) != 0).any(axis=1)
    first = np.flatnonzero(is_new)
    low = np.minimum.reduceat(corners.min(axis=1)[order], first)
    high = np.maximum.reduceat(corners.max(axis=1)[order], first)
    return np.stack([low, high], axis=1)
