"""Models as binary glTF files: ours, with one mesh for each material, and other people's."""

import io

import numpy as np
import trimesh

from advercity.errors import RunError
from advercity.world.assets.wavefront import Part


def to_glb(parts: list[Part]) -> bytes:
    """The parts as a GLB; same parts, same bytes.

    Meshes bear the names of their materials, and `@` and the number of the wheel that they are of.
    """
    scene = trimesh.Scene()
    for part in parts:
        mesh = trimesh.Trimesh(part.vertices, part.triangles, process=False)
        name = f"{part.material}@{part.wheel}" if part.wheel else part.material
        scene.add_geometry(mesh, geom_name=name, node_name=name)
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
        named, wheel = _named(str(material))
        faces = np.asarray(mesh.faces, int)
        parts.append(Part(named, np.asarray(vertices, float), faces, wheel=wheel))
    if not parts:
        raise RunError(f"{name}: holds no triangles")
    return parts


def _named(name: str) -> tuple[str, int]:
    """Material and number of the wheel that the name of a mesh says."""
    material, _, number = name.rpartition("@")
    return (material, int(number)) if material and number.isdecimal() else (name, 0)
