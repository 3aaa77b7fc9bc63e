"""Meshes of the world as SAPIEN's render shapes, shared wherever they can be."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import sapien
from numpy.typing import NDArray

from advercity.rendering.lamps import signal_lens
from advercity.semantics import Semantic
from advercity.traffic.trace import Signal
from advercity.world.materials import MATERIALS
from advercity.world.scene import Mesh

PAINT = "paint"
"""Material of parts that take the actor's own."""
OPEN = frozenset({Semantic.VEGETATION})
"""Classes whose surfaces have two sides; SAPIEN draws only one."""
TURNED = np.array([-1.0, -1.0, 1.0], dtype=np.float32)
"""Of the normal on the other side: light from above shines through leaves."""
LENSES = {
    "lamp_white": 1,
    "lamp_red": 2,
    "signal_red": 3,
    "signal_yellow": 4,
    "signal_green": 5,
    "lamp_amber_left": 6,
    "lamp_amber_right": 7,
}
"""Kinds of lens in `lenses.glsl`; like textures they travel in the materials' emission."""
SNOWLESS = frozenset({"glass", "rubber", "skin", *LENSES})
"""What falling snow does not stay on; cloth, too, by its name."""
TILE_M = 80.0
LENS_RADIUS_M, LENS_CORNERS = 0.13, 16


class ShapeLibrary:
    """Makes shapes of meshes; copies of one mesh share its vertices on the device."""

    def __init__(self) -> None:
        self._materials: dict[str, sapien.render.RenderMaterial] = {}
        self._shapes: dict[tuple[int, str], sapien.render.RenderShape] = {}
        self._kept: list[Mesh] = []

    def of_mesh(self, mesh: Mesh, paint: str = "") -> sapien.render.RenderShape:
        """A new shape of a mesh, of the material `paint` if it is a painted part."""
        material = paint if mesh.material == PAINT else mesh.material
        key = id(mesh), material
        if key not in self._shapes:
            self._shapes[key] = self._build(mesh, material)
            self._kept.append(mesh)
        return self._shapes[key].clone()

    def _build(self, mesh: Mesh, material: str) -> sapien.render.RenderShapeTriangleMesh:
        vertices, triangles, normals = _shaded(mesh)
        if mesh.semantic in OPEN:
            triangles = np.concatenate([triangles, triangles[:, ::-1] + len(vertices)])
            vertices = np.concatenate([vertices, vertices])
            normals = np.concatenate([normals, normals * TURNED])
        return sapien.render.RenderShapeTriangleMesh(
            vertices=vertices,
            triangles=triangles.astype(np.uint32),
            normals=normals,
            uvs=np.zeros((len(vertices), 2), dtype=np.float32),
            material=self._material(material),
        )

    def _material(self, name: str) -> sapien.render.RenderMaterial:
        if name not in self._materials:
            known = MATERIALS[name]
            snowless = name in SNOWLESS or name.startswith("cloth_")
            self._materials[name] = sapien.render.RenderMaterial(
                emission=[float(LENSES.get(name, 0)), known.texture, snowless, 0.0],
                base_color=[*known.albedo, 1.0],
                roughness=known.roughness,
                metallic=known.metallic,
            )
        return self._materials[name]


def tiles(mesh: Mesh) -> Iterator[Mesh]:
    """A large mesh cut along a grid: rays pass small meshes by, which halves a traced picture."""
    middles = mesh.vertices[mesh.triangles].mean(axis=1)[:, :2]
    _, tile = np.unique(np.floor(middles / TILE_M), axis=0, return_inverse=True)
    for number in range(int(tile.max(initial=-1)) + 1):
        used, triangles = np.unique(mesh.triangles[tile.ravel() == number], return_inverse=True)
        yield replace(
            mesh,
            vertices=mesh.vertices[used],
            triangles=triangles.reshape(-1, 3).astype(np.int32),
            normals=None if mesh.normals is None else mesh.normals[used],
        )


def lenses() -> tuple[Mesh, ...]:
    """The three lenses of a signal as discs that look along x; the yellow one is the origin."""
    turn = np.arange(LENS_CORNERS) / LENS_CORNERS * 2.0 * np.pi
    disc = LENS_RADIUS_M * np.stack([np.zeros_like(turn), np.cos(turn), np.sin(turn)], axis=1)
    corners = np.arange(1, LENS_CORNERS - 1)
    fan = np.stack([np.zeros_like(corners), corners, corners + 1], axis=1).astype(np.int32)
    return tuple(
        Mesh(
            name=f"lens_{signal.name.lower()}",
            vertices=np.add(disc, signal_lens(signal), dtype=np.float32),
            triangles=fan,
            material=f"signal_{signal.name.lower()}",
            semantic=Semantic.TRAFFIC_LIGHT,
        )
        for signal in Signal
    )


def _shaded(
    mesh: Mesh,
) -> tuple[NDArray[np.float32], NDArray[np.integer], NDArray[np.float32]]:
    """Vertices, triangles and normals; flat faces get three vertices of their own."""
    if mesh.normals is not None:
        return mesh.vertices, mesh.triangles, mesh.normals
    corners = mesh.vertices[mesh.triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-20)
    count = len(mesh.triangles) * 3
    return (
        corners.reshape(count, 3).astype(np.float32),
        np.arange(count).reshape(-1, 3),
        np.repeat(normal, 3, axis=0).astype(np.float32),
    )
