"""Inlays of roadways, such as repairs and covers, laid onto their asphalt."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from shapely.geometry.base import BaseGeometry

from advercity.geometry.draping import DrapeBase
from advercity.geometry.mesh import Mesh, move_surface, xyz
from advercity.semantics import Semantic

INLAY_LIFT = xyz(z=0.0045)
"""Height of inlays over the asphalt: enough for a depth buffer, and as much below paint."""
LEVEL_COSINE = 0.5
"""Asphalt whose normals are steeper bears no inlays."""


@dataclass(frozen=True, eq=False)
class RoadInlay:
    """A piece of a road's surface of another material.

    Attributes:
        material: Its material.
        outline: Its convex outline in the plan, metres.
        z_m: About its height, to tell a bridge from the road below.
    """

    material: str
    outline: BaseGeometry
    z_m: float


def build_inlay_meshes(inlays: Iterable[RoadInlay], road_meshes: Sequence[Mesh]) -> list[Mesh]:
    """Build a mesh of each material among inlays, on the asphalt among the meshes of a road."""
    by_material: dict[str, list[RoadInlay]] = {}
    for inlay in inlays:
        by_material.setdefault(inlay.material, []).append(inlay)
    if not by_material:
        return []
    asphalt = [mesh for mesh in road_meshes if mesh.semantic is Semantic.ROAD]
    corners = np.concatenate([mesh.vertices[mesh.triangles] for mesh in asphalt]).astype(np.float64)
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    base = DrapeBase(corners[across[:, 2] > LEVEL_COSINE * np.linalg.norm(across, axis=1)])
    meshes: list[Mesh] = []
    for material, items in by_material.items():
        surface = base.drape([item.outline for item in items], [item.z_m for item in items])
        if len(surface.triangles):
            lifted = move_surface(surface, INLAY_LIFT)
            meshes.append(lifted.to_mesh(f"inlay_{material}", material, Semantic.ROAD))
    return meshes
