"""Mirror images of meshes at the x axis: y is negated, faces stay outward, writing is readable."""

from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from advercity.geometry.mesh import Mesh
from advercity.geometry.polyline import Points

MIRROR_Y = np.array([1.0, -1.0, 1.0], dtype=np.float32)
_PointT = TypeVar("_PointT", tuple[float, float], tuple[float, float, float])


def mirror_point(point: _PointT) -> _PointT:
    """Mirror a single point at the x axis; a zero stays positive, which is other bytes in JSON."""
    x, y, *above = point
    return (x, 0.0 - y, *above)  # type: ignore[return-value]


def mirror_points(points: Points) -> Points:
    """Mirror points or directions (..., 2) or (..., 3) at the x axis."""
    return points * MIRROR_Y[: points.shape[-1]].astype(np.float64)


def mirror_mesh(mesh: Mesh) -> Mesh:
    """Mirror a mesh at the x axis.

    Images on it run to the right still, as their coordinates are mirrored too. Lines of writing are
    where their mirror images would be, and read from left to right.
    """
    vertices = mesh.vertices.copy()
    turned = np.zeros(len(vertices), dtype=np.bool_)
    for first, last in mesh.writing:
        assert mesh.normals is not None, "writing is flat, and has normals"
        vertices[first:last] = _reverse_line(vertices[first:last], mesh.normals[first])
        turned[first:last] = True
    kept = turned[mesh.triangles[:, 0]]
    return replace(
        mesh,
        vertices=vertices * MIRROR_Y,
        triangles=np.where(kept[:, None], mesh.triangles, mesh.triangles[:, ::-1]),
        normals=None if mesh.normals is None else mesh.normals * MIRROR_Y,
        uv=None if mesh.uv is None else mesh.uv * np.array([-1.0, 1.0], dtype=np.float32),
    )


def _reverse_line(
    vertices: NDArray[np.float32], facing: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Mirror a line of writing (n, 3) on a wall in itself, from its right end to its left."""
    along = np.array([-facing[1], facing[0], 0.0]) / np.hypot(facing[0], facing[1])
    at = vertices @ along
    moved = np.outer(at.min() + at.max() - 2 * at, along)
    return (vertices + moved).astype(np.float32)
