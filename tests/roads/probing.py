"""Meshes of roads seen from above, and points on their lanes."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import shapely
from advercity_dsl import Spec
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from advercity.geometry.mesh import Mesh
from advercity.roads.lane_segments import LaneSegment
from advercity.roads.sumo_network import write_sumo_network
from advercity.scene.build import build_world

ABOVE_M = 60.0


Floats = NDArray[np.float64]


Shot = tuple[Floats, NDArray[np.int64]]


def looking_down(meshes: list[Mesh] | tuple[Mesh, ...]) -> Callable[[Floats], Shot]:
    corners = np.concatenate([mesh.vertices[mesh.triangles] for mesh in meshes])
    classes = np.concatenate([np.full(len(m.triangles), m.semantic.value) for m in meshes])
    scene = EmbreeScene()
    TriangleMesh(scene, corners)

    def below(points: Floats) -> Shot:
        starts = np.column_stack([points[:, :2], np.full(len(points), ABOVE_M)]).astype(np.float32)
        down = np.tile(np.array([0, 0, -1], dtype=np.float32), (len(points), 1))
        hits = scene.run(starts, down, output=True)
        assert (hits["primID"] >= 0).all(), "a hole"
        return ABOVE_M - hits["tfar"], classes[hits["primID"]]

    return below


def on_lane(lane: LaneSegment, step_m: float = 0.7) -> Floats:
    """Points (n, 3) along and across a lane, clear of its borders."""
    along = shapely.LineString((lane.left + lane.right)[:, :2] / 2).length
    share = np.linspace(0.02, 0.98, max(3, int(along / step_m)))
    left, right = (
        np.array(
            [
                shapely.get_coordinates(
                    shapely.LineString(line).interpolate(at, normalized=True), include_z=True
                )[0]
                for at in share
            ]
        )
        for line in (lane.left, lane.right)
    )
    return np.concatenate([left + across * (right - left) for across in (0.15, 0.5, 0.85)])


def road_meshes(spec: Spec, tmp_path: Path) -> tuple[Mesh, ...]:
    world = build_world(spec, write_sumo_network(spec.road, tmp_path))
    return tuple(
        mesh for mesh in world.static if not mesh.name.startswith(("furniture", "surroundings"))
    )
