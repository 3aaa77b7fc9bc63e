"""Reads models from Wavefront OBJ and binary glTF files, and writes converted ones as glTF.

The OBJ reader is our own because trimesh splits quads along other diagonals than the models were
converted with, and does not keep the order of triangles, so all converted models would change.
"""

import hashlib
import io
import re
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from advercity.errors import RunError
from advercity.geometry.arrays import Float64Array, Uint8Array
from advercity.image_files import decode_image

if TYPE_CHECKING:
    import trimesh


@dataclass(frozen=True, eq=False)
class ModelPart:
    """Triangles of one material.

    Attributes:
        material: Name in the file; in converted models a key of MATERIALS.
        vertices: (n, 3).
        triangles: (m, 3) into `vertices`.
        wheel: Number of the part's wheel, from 1; 0 if it does not turn.
        image: (h, w, 3) RGB of its texture, or None.
        uv: (m, 3, 2) of the corners of triangles on the image, to the right and up, 1 for its size.
    """

    material: str
    vertices: Float64Array
    triangles: NDArray[np.int64]
    wheel: int = 0
    image: Uint8Array | None = None
    uv: Float64Array | None = None

    @property
    def colours(self) -> Float64Array | None:
        """Colours (m, 3), sRGB in [0, 1], of the image at the centre of each triangle, or None."""
        if self.image is None or self.uv is None:
            return None
        middle = self.uv.mean(axis=1) % 1.0
        height, width = self.image.shape[:2]
        row = np.clip(((1.0 - middle[:, 1]) * height).astype(int), 0, height - 1)
        column = np.clip((middle[:, 0] * width).astype(int), 0, width - 1)
        return self.image[row, column] / 255.0


def read_obj(obj: bytes, files: Mapping[str, bytes]) -> list[ModelPart]:
    """Read the parts of a model; `files` are its materials and textures by name."""
    vertices: list[list[float]] = []
    texcoords: list[list[float]] = []
    faces: dict[str, list[tuple[tuple[int, int], ...]]] = {}
    material = ""
    for line in obj.decode("latin-1").splitlines():
        head, _, rest = line.partition(" ")
        if head == "v":
            vertices.append([float(word) for word in rest.split()[:3]])
        elif head == "vt":
            texcoords.append([float(word) for word in rest.split()[:2]])
        elif head == "usemtl":
            material = rest.strip()
        elif head == "f":
            corners = [_parse_corner(word, len(vertices), len(texcoords)) for word in rest.split()]
            triangles = ((corners[0], *pair) for pair in pairwise(corners[1:]))
            faces.setdefault(material, []).extend(triangles)
    points, uv = np.array(vertices), np.array(texcoords or [[0.0, 0.0]])
    textures = _load_textures(files)
    parts: list[ModelPart] = []
    for name, rows in faces.items():
        corner = np.array(rows)
        image = textures.get(name)
        placed = None if image is None else uv[corner[..., 1]]
        triangles = np.ascontiguousarray(corner[..., 0])
        parts.append(ModelPart(name, points, triangles, image=image, uv=placed))
    return parts


def _parse_corner(word: str, vertices: int, texcoords: int) -> tuple[int, int]:
    """Parse a corner `vertex/texcoord/normal` into indices from 0; a missing texcoord is 0."""
    numbers = [int(number) if number else 0 for number in word.split("/")]
    vertex, texcoord = numbers[0], numbers[1] if len(numbers) > 1 else 0
    # Positive indices count from 1, negative ones back from the latest element.
    return (
        vertex - 1 if vertex > 0 else vertices + vertex,
        max(0, texcoord - 1 if texcoord >= 0 else texcoords + texcoord),
    )


def _load_textures(files: Mapping[str, bytes]) -> dict[str, Uint8Array]:
    """Load the diffuse textures (h, w, 3), RGB, of materials with one."""
    textures: dict[str, Uint8Array] = {}
    for name, content in files.items():
        if not name.endswith(".mtl"):
            continue
        material = ""
        for line in content.decode("latin-1").splitlines():
            words = re.split(r"\s+", line.strip(), maxsplit=1)
            if words[0] == "newmtl" and len(words) > 1:
                material = words[1]
            elif words[0] == "map_Kd" and len(words) > 1 and words[1] in files:
                with suppress(ValueError):
                    image = decode_image(files[words[1]], cv2.IMREAD_COLOR_RGB)
                    textures[material] = image.astype(np.uint8)
    return textures


def to_glb(parts: list[ModelPart]) -> bytes:
    """Export parts as a GLB; the same parts give the same bytes.

    Meshes are named after their materials; meshes of wheels add `@` and the wheel's number.
    """
    # trimesh takes a while to load, and procedural bodies do without it.
    import trimesh

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
    """Read the parts of a GLB, each named after its material, or after its mesh without one.

    Raises:
        RunError: It is not a GLB, or has no triangles.
    """
    import trimesh

    try:
        scene = trimesh.load_scene(io.BytesIO(content), file_type="glb")
    except Exception as error:  # trimesh's parser raises errors of any type for broken files
        raise RunError(f"{name}: is not a GLB file that can be read: {error}") from error
    parts: list[ModelPart] = []
    for node in sorted(scene.graph.nodes_geometry):
        world_from_mesh, geometry = scene.graph[node]
        mesh = scene.geometry[geometry]
        if not isinstance(mesh, trimesh.Trimesh) or not len(mesh.faces):
            continue
        material = getattr(getattr(mesh.visual, "material", None), "name", None) or geometry
        vertices = trimesh.transform_points(mesh.vertices, world_from_mesh)
        name_of_part, wheel = _parse_mesh_name(str(material))
        faces = np.asarray(mesh.faces, int)
        image, uv = _read_image(mesh)
        parts.append(ModelPart(name_of_part, np.asarray(vertices, float), faces, wheel, image, uv))
    if not parts:
        raise RunError(f"{name}: holds no triangles")
    return parts


def _read_image(mesh: "trimesh.Trimesh") -> tuple[Uint8Array | None, Float64Array | None]:
    """Read the colour image (h, w, 3), RGB, of a mesh, and its coordinates (m, 3, 2), if any."""
    image = getattr(getattr(mesh.visual, "material", None), "baseColorTexture", None)
    uv = getattr(mesh.visual, "uv", None)
    if image is None or uv is None:
        return None, None
    return np.asarray(image.convert("RGB"), np.uint8), np.asarray(uv, float)[mesh.faces]


def compute_parts_digest(parts: Iterable[ModelPart]) -> str:
    """Compute the SHA-256 of converted parts, independent of the GLB writer's version."""
    digest = hashlib.sha256()
    for part in parts:
        shape = f"{part.material} {part.wheel} {len(part.vertices)} {len(part.triangles)}\n"
        digest.update(shape.encode())
        digest.update(np.ascontiguousarray(part.vertices, "<f4").tobytes())
        digest.update(np.ascontiguousarray(part.triangles, "<i4").tobytes())
    return digest.hexdigest()


def _parse_mesh_name(name: str) -> tuple[str, int]:
    """Parse the name of a mesh into its material and the number of its wheel."""
    material, _, number = name.rpartition("@")
    return (material, int(number)) if material and number.isdecimal() else (name, 0)
