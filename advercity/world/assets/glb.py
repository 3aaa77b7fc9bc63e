"""Models as binary glTF files: ours, with one mesh for each material, and other people's."""

import io

import numpy as np
import trimesh

from advercity.errors import RunError
from advercity.world.assets.wavefront import Part


def to_glb(parts: list[Part]) -> bytes:
    """The parts as a GLB whose meshes bear the names of their materials; same parts, same bytes."""
    scene = trimesh.Scene()
    for part in parts:
        mesh = trimesh.Trimesh(part.vertices, part.triangles, process=False)
        scene.add_geometry(mesh, geom_name=part.material, node_name=part.material)
    exported = scene.export(file_type="glb", include_normals=False)
    if not isinstance(exported, bytes):
        raise TypeError("trimesh exports GLB as bytes")
    return exported


def read_glb(content: bytes, name: str) -> list[Part]:
    """Parts of a GLB, each named after its material, or its mesh where it has none.

    Raises:
        RunError: It is no GLB, or holds no triangles.
    """
    try:  # the parser raises whatever a broken file breaks in it
        scene = trimesh.load_scene(io.BytesIO(content), file_type="glb")
    except Exception as error:
        raise RunError(f"{name}: is not a GLB file that can be read: {error}") from error
    parts: list[Part] = []
    for node in sorted(scene.graph.nodes_geometry):
        world_from_mesh, geometry = scene.graph[node]
        mesh = scene.geometry[geometry]
        if not isinstance(mesh, trimesh.Trimesh) or not len(mesh.faces):
            continue
        material = getattr(getattr(mesh.visual, "material", None), "name", None) or geometry
        vertices = trimesh.transform_points(mesh.vertices, world_from_mesh)
        parts.append(Part(str(material), np.asarray(vertices, float), np.asarray(mesh.faces, int)))
    if not parts:
        raise RunError(f"{name}: holds no triangles")
    return parts
