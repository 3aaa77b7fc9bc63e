"""Stores converted people: arrays in one `.npz` file, with a digest of their content."""

import hashlib
import io
import json
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from advercity.array_files import load_arrays
from advercity.assets.people.conversion import RiggedPerson
from advercity.assets.people.shells import Shell
from advercity.assets.skeleton import MeasuredBuild
from advercity.documents import MAX_MODEL_BYTES, parse_json
from advercity.errors import RunError
from advercity.geometry.arrays import Float64Array

_RECORD = "record"


def pack_people(people: Sequence[RiggedPerson]) -> bytes:
    """Pack people into the content of a file; the same people give the same arrays."""
    record: list[Any] = []
    shells = [shell for person in people for shell, _ in person.shells]
    for person in people:
        parts = [
            (material, len(shell.vertices), len(shell.triangles))
            for shell, material in person.shells
        ]
        build = person.build
        legs = build.height_m, build.measured_leg_m, build.measured_ankle_m
        record.append((parts, person.umbrella, legs))
    content = io.BytesIO()
    np.savez(
        content,
        record=np.frombuffer(json.dumps(record).encode(), dtype=np.uint8),
        postures=np.stack([person.posture for person in people]),
        vertices=np.concatenate([shell.vertices for shell in shells]).astype("<f4"),
        triangles=np.concatenate([shell.triangles for shell in shells]).astype("<i4"),
        weights=np.concatenate([shell.weights for shell in shells]).astype("<f4"),
    )
    return content.getvalue()


def read_people(path: Path) -> list[RiggedPerson]:
    """Read the people of a file.

    Raises:
        RunError: It cannot be read, or is another file.
    """
    arrays = load_arrays(path, max_bytes=MAX_MODEL_BYTES)
    try:
        return _unpack_people(parse_json(arrays[_RECORD].tobytes(), path), arrays)
    except (KeyError, ValueError, TypeError, IndexError) as error:
        raise RunError(f"{path}: holds no people: {error}") from error


def _unpack_people(record: Any, arrays: dict[str, NDArray[Any]]) -> list[RiggedPerson]:
    people: list[RiggedPerson] = []
    points = corners = 0
    for (parts, umbrella, legs), posture in zip(record, arrays["postures"], strict=True):
        shells: list[tuple[Shell, str]] = []
        for material, vertices, triangles in parts:
            rows = slice(points, points + vertices)
            shell = Shell(
                _to_double(arrays["vertices"][rows]),
                arrays["triangles"][corners : corners + triangles].astype(np.int64),
                _to_double(arrays["weights"][rows]),
            )
            shells.append((shell, material))
            points, corners = points + vertices, corners + triangles
        height, leg, ankle = legs
        build = MeasuredBuild(height, 1.0, leg, ankle)
        people.append(RiggedPerson(shells, posture, build, umbrella))
    return people


def _to_double(array: NDArray[Any]) -> Float64Array:
    return array.astype(np.float64)


@cache
def compute_people_digest(path: Path) -> str:
    """Compute the SHA-256 of the arrays of a file of people; a file of a name never changes."""
    digest = hashlib.sha256()
    for name, array in sorted(load_arrays(path, max_bytes=MAX_MODEL_BYTES).items()):
        digest.update(f"{name} {array.dtype.str} {array.shape}\n".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
