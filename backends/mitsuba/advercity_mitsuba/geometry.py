"""Meshes in Mitsuba: each body is one mesh, which frames have as instances.

Mitsuba finds which triangle of which instance a ray hits; normals, coordinates and materials are in
tables here. So a kernel is the same for all scenes, and compiled once.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from advercity.geometry.arrays import Float32Array
from advercity.geometry.mesh import Mesh
from advercity_mitsuba.surfaces import SurfaceTable
from advercity_mitsuba.variant import dr, mi

SEMANTIC_SHIFT = 16
"""A triangle's word: row of its surface, and from this bit on its semantic class."""


@dataclass(frozen=True, eq=False)
class RegisteredBody:
    """Meshes in common motion: a group for instances, and the row of their first triangle."""

    group: Any
    first_triangle: int


@dataclass(frozen=True, eq=False)
class DeviceTables:
    """Vertices, triangles and surfaces of all bodies on the device.

    Attributes:
        vertices: 8 floats each: normal, horizontal image coordinate; position, vertical one.
        corners: 4 integers a triangle: rows of its vertices, and its word.
        surfaces: `surfaces.COLUMNS` floats a row.
    """

    vertices: Any
    corners: Any
    surfaces: Any


class GeometryStore:
    """All bodies of a scene so far."""

    def __init__(self, surfaces: SurfaceTable) -> None:
        self._surfaces = surfaces
        self._vertices: list[Float32Array] = []
        self._corners: list[NDArray[np.uint32]] = []
        self._vertex_count = self._triangle_count = 0
        self._tables: DeviceTables | None = None

    def add(self, meshes: Sequence[Mesh], *, is_static: bool = False) -> RegisteredBody:
        """Register meshes as one body."""
        parts = [_split_flat_faces(mesh) for mesh in meshes]
        starts = np.cumsum([0, *(len(vertices) for vertices, _ in parts)])
        vertices = np.concatenate([vertices for vertices, _ in parts])
        shifted = [faces + start for (_, faces), start in zip(parts, starts, strict=False)]
        faces = np.concatenate(shifted).astype(np.uint32)
        words = [
            self._surfaces.get_row(mesh, is_static=is_static) | int(mesh.semantic) << SEMANTIC_SHIFT
            for mesh in meshes
        ]
        word = np.repeat(np.array(words, np.uint32), [len(mesh.triangles) for mesh in meshes])
        first = self._triangle_count
        self._vertices.append(vertices)
        self._corners.append(np.column_stack([faces + np.uint32(self._vertex_count), word]))
        self._vertex_count += len(vertices)
        self._triangle_count += len(faces)
        self._tables = None
        return RegisteredBody(_build_group(vertices[:, 4:7], faces), first)

    @property
    def tables(self) -> DeviceTables:
        """The tables on the device, copied there again after a body was added."""
        if self._tables is None:
            # One array each from now on: the next body adds to few.
            self._vertices = [np.concatenate(self._vertices)]
            self._corners = [np.concatenate(self._corners)]
            self._tables = DeviceTables(
                mi.Float(self._vertices[0].ravel()),
                mi.UInt32(self._corners[0].ravel()),
                mi.Float(self._surfaces.values.ravel()),
            )
            dr.make_opaque(self._tables.vertices, self._tables.corners, self._tables.surfaces)
        return self._tables


def _build_group(positions: Float32Array, faces: NDArray[np.uint32]) -> Any:
    mesh = mi.Mesh("body", len(positions), len(faces))
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = mi.Float(positions.ravel())
    parameters["faces"] = mi.UInt32(faces.ravel())
    parameters.update()
    return mi.load_dict({"type": "shapegroup", "mesh": mesh}, optimize=False)


def _split_flat_faces(mesh: Mesh) -> tuple[Float32Array, NDArray[np.integer[Any]]]:
    """Get vertices (n, 8) as `DeviceTables` has them, and faces (m, 3).

    Faces without normals of their vertices get three vertices of their own.
    """
    uv = np.zeros((len(mesh.vertices), 2), np.float32) if mesh.uv is None else mesh.uv
    positions, faces, normals = mesh.vertices, mesh.triangles, mesh.normals
    if normals is None:
        corners = positions[faces]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-20)
        normals, uv = np.repeat(normal, 3, axis=0), uv[faces].reshape(-1, 2)
        positions, faces = corners.reshape(-1, 3), np.arange(faces.size).reshape(-1, 3)
    return np.column_stack([normals, uv[:, 0], positions, uv[:, 1]]).astype(np.float32), faces
