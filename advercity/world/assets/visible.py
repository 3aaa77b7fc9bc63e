"""The part of a model that can be seen from outside, every triangle facing who sees it."""

import numpy as np
import trimesh
from numpy.typing import NDArray
from trimesh.ray.ray_pyembree import RayMeshIntersector

Floats = NDArray[np.float64]

DIRECTIONS = 64
WITHIN = np.array([(1, 1, 1), (4, 1, 1), (1, 4, 1), (1, 1, 4)]) / np.array([[3], [6], [6], [6]])
"""Barycentric places on a triangle from where the sky is looked for."""
CLEAR_M = 2e-3


def seen(
    vertices: Floats, triangles: NDArray[np.int64], lowest: float
) -> tuple[NDArray[np.bool_], ...]:
    """Whether each triangle can be seen from in front, and from behind.

    A side can be seen if from some place on it a ray gets away, over its own horizon.

    Args:
        vertices: (n, 3) metres, z up.
        triangles: (m, 3).
        lowest: Sine of the steepest look upwards.
    """
    world = RayMeshIntersector(trimesh.Trimesh(vertices, triangles, process=False))
    corners = vertices[triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    sides = []
    for sign in (1.0, -1.0):
        free = np.zeros(len(triangles), dtype=bool)
        for place in WITHIN:
            start = np.einsum("k,nkd->nd", place, corners) + sign * CLEAR_M * normal
            for direction in _directions(lowest):
                ask = np.flatnonzero(~free & (sign * (normal @ direction) > 0.05))
                if len(ask):
                    ahead = np.broadcast_to(direction, (len(ask), 3))
                    free[ask] = ~world.intersects_any(start[ask], ahead)
        sides.append(free)
    return tuple(sides)


def _directions(lowest: float) -> Floats:
    """Directions (k, 3), evenly spread over the sky down to the sine of an elevation."""
    index = np.arange(DIRECTIONS) + 0.5
    azimuth = np.pi * (1.0 + np.sqrt(5.0)) * index
    height = 1.0 - (1.0 - lowest) * index / DIRECTIONS
    level = np.sqrt(1.0 - height**2)
    return np.column_stack([level * np.cos(azimuth), level * np.sin(azimuth), height])
