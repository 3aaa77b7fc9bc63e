"""Reads Wavefront models: triangles by material, and the colour of each where a texture has it.

Models as binary glTF files: ours, with one mesh for each material, and other people's.
"""

import io
import re
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
import trimesh
from numpy.typing import NDArray

from advercity.errors import RunError


@dataclass(frozen=True, eq=False)
class ModelPart:
    """Triangles of one material.

    Attributes:
        material: The model's own name of it, or ours.
        vertices: (n, 3).
        triangles: (m, 3) into `vertices`.
        colours: (m, 3) sRGB in [0, 1] that a texture has in the middle of each triangle, or None.
        wheel: Which wheel turns with it, counted from 1; 0 if it does not turn.
    """

    material: str
    vertices: NDArray[np.float64]
    triangles: NDArray[np.int64]
    colours: NDArray[np.float64] | None = None
    wheel: int = 0


def read_obj(obj: bytes, files: Mapping[str, bytes]) -> list[ModelPart]:
    """Parts of a model; `files` are the materials and textures that it refers to, by name."""
    vertices: list[list[float]] = []
    places: list[list[float]] = []
    faces: dict[str, list[tuple[int, int, int]]] = {}
    marks: dict[str, list[tuple[int, int, int]]] = {}
    material = ""
    for line in obj.decode("latin-1").splitlines():
        head, _, rest = line.partition(" ")
        if head == "v":
            vertices.append([float(word) for word in rest.split()[:3]])
        elif head == "vt":
            places.append([float(word) for word in rest.split()[:2]])
        elif head == "usemtl":
            material = rest.strip()
        elif head == "f":
            corners = [_parse_corner(word, len(vertices), len(places)) for word in rest.split()]
            for second, third in pairwise(corners[1:]):
                fan = (corners[0], second, third)
                faces.setdefault(material, []).append((fan[0][0], fan[1][0], fan[2][0]))
                marks.setdefault(material, []).append((fan[0][1], fan[1][1], fan[2][1]))
    points, uv = np.array(vertices), np.array(places or [[0.0, 0.0]])
    textures = _load_textures(files)
    return [
        ModelPart(
            name,
            points,
            np.array(triangles),
            _sample_texture(textures[name], uv, np.array(marks[name]))
            if name in textures
            else None,
        )
        for name, triangles in faces.items()
    ]


def _parse_corner(word: str, vertices: int, places: int) -> tuple[int, int]:
    """Indices from 0 of a corner's vertex and place on the texture, which is 0 if there is none."""
    numbers = [int(number) if number else 0 for number in word.split("/")]
    vertex, place = numbers[0], numbers[1] if len(numbers) > 1 else 0
    return (
        vertex - 1 if vertex > 0 else vertices + vertex,
        max(0, place - 1 if place >= 0 else places + place),
    )


def _load_textures(files: Mapping[str, bytes]) -> dict[str, NDArray[np.uint8]]:
    """Pictures (h, w, 3), BGR, of the materials that have one."""
    found: dict[str, NDArray[np.uint8]] = {}
    for name, content in files.items():
        if not name.endswith(".mtl"):
            continue
        material = ""
        for line in content.decode("latin-1").splitlines():
            words = re.split(r"\s+", line.strip(), maxsplit=1)
            if words[0] == "newmtl" and len(words) > 1:
                material = words[1]
            elif words[0] == "map_Kd" and len(words) > 1 and words[1] in files:
                raw = np.frombuffer(files[words[1]], np.uint8)
                picture = cv2.imdecode(raw, cv2.IMREAD_COLOR)
                if picture is not None:
                    found[material] = picture.astype(np.uint8)
    return found


def _sample_texture(
    picture: NDArray[np.uint8], uv: NDArray[np.float64], marks: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Colour (m, 3), RGB, of a picture in the middle of triangles (m, 3) of places on it."""
    middle = uv[marks].mean(axis=1) % 1.0
    height, width = picture.shape[:2]
    row = np.clip(((1.0 - middle[:, 1]) * height).astype(int), 0, height - 1)
    column = np.clip((middle[:, 0] * width).astype(int), 0, width - 1)
    return picture[row, column, ::-1] / 255.0


def to_glb(parts: list[ModelPart]) -> bytes:
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


def read_glb(content: bytes, name: str) -> list[ModelPart]:
    """Parts of a GLB, each named after its material, or its mesh where it has none.

    Raises:
        RunError: It is no GLB, or holds no triangles.
    """
    try:  # the parser raises whatever a broken file breaks in it
        scene = trimesh.load_scene(io.BytesIO(content), file_type="glb")
    except Exception as error:
        raise RunError(f"{name}: is not a GLB file that can be read: {error}") from error
    parts: list[ModelPart] = []
    for node in sorted(scene.graph.nodes_geometry):
        world_from_mesh, geometry = scene.graph[node]
        mesh = scene.geometry[geometry]
        if not isinstance(mesh, trimesh.Trimesh) or not len(mesh.faces):
            continue
        material = getattr(getattr(mesh.visual, "material", None), "name", None) or geometry
        vertices = trimesh.transform_points(mesh.vertices, world_from_mesh)
        named, wheel = _parse_mesh_name(str(material))
        faces = np.asarray(mesh.faces, int)
        parts.append(ModelPart(named, np.asarray(vertices, float), faces, wheel=wheel))
    if not parts:
        raise RunError(f"{name}: holds no triangles")
    return parts


def _parse_mesh_name(name: str) -> tuple[str, int]:
    """Material and number of the wheel that the name of a mesh says."""
    material, _, number = name.rpartition("@")
    return (material, int(number)) if material and number.isdecimal() else (name, 0)
