"""Meshes of the world as SAPIEN's render shapes, shared wherever they can be."""

from collections.abc import Iterator

import numpy as np
import sapien
from numpy.typing import NDArray

from advercity.semantics import Semantic
from advercity.world.materials import MATERIALS
from advercity.world.scene import Body, Mesh

PAINT = "paint"
"""Material of parts that take the actor's own."""
OPEN = frozenset({Semantic.VEGETATION})
"""Classes whose surfaces are seen from both sides."""


class ShapeLibrary:
    """Makes shapes of meshes; copies of one body share their vertices on the device."""

    def __init__(self) -> None:
        self._materials: dict[str, sapien.render.RenderMaterial] = {}
        self._shapes: dict[tuple[int, str], sapien.render.RenderShape] = {}
        self._meshes: list[Mesh] = []

    def of_mesh(self, mesh: Mesh, paint: str = "") -> Iterator[sapien.render.RenderShape]:
        """New shapes of a mesh: one, or two back to back where it is open."""
        material = paint if mesh.material == PAINT else mesh.material
        key = id(mesh), material
        if key not in self._shapes:
            self._shapes[key] = self._build(mesh, material)
            self._meshes.append(mesh)
        yield self._shapes[key].clone()
        if mesh.semantic in OPEN:
            back = self._shapes[key].clone()
            back.set_front_face("clockwise")
            yield back

    def of_body(
        self, body: Body, paint: str
    ) -> Iterator[tuple[sapien.render.RenderShape, Semantic]]:
        """New shapes of a body's parts and what each is."""
        for part in body.parts:
            for shape in self.of_mesh(part, paint):
                yield shape, part.semantic

    def _build(self, mesh: Mesh, material: str) -> sapien.render.RenderShapeTriangleMesh:
        vertices, triangles, normals = _shaded(mesh)
        return sapien.render.RenderShapeTriangleMesh(
            vertices=vertices,
            triangles=triangles,
            normals=normals,
            uvs=np.zeros((len(vertices), 2), dtype=np.float32),
            material=self._material(material),
        )

    def _material(self, name: str) -> sapien.render.RenderMaterial:
        if name not in self._materials:
            known = MATERIALS[name]
            self._materials[name] = sapien.render.RenderMaterial(
                base_color=[*known.albedo, 1.0],
                roughness=known.roughness,
                metallic=known.metallic,
            )
        return self._materials[name]


def _shaded(
    mesh: Mesh,
) -> tuple[NDArray[np.float32], NDArray[np.uint32], NDArray[np.float32]]:
    """Vertices, triangles and normals; flat faces get three vertices of their own."""
    if mesh.normals is not None:
        return mesh.vertices, mesh.triangles.astype(np.uint32), mesh.normals
    corners = mesh.vertices[mesh.triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-20)
    count = len(mesh.triangles) * 3
    return (
        corners.reshape(count, 3).astype(np.float32),
        np.arange(count, dtype=np.uint32).reshape(-1, 3),
        np.repeat(normal, 3, axis=0).astype(np.float32),
    )
