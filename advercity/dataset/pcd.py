"""Point clouds in the PCD format, binary, as readers of OPV2V take them.

They read `x y z` as 4-byte floats and the intensity from the red channel of `rgb`, eight bits
of it; the fields behind `rgb` hold the full precision and the labels, and are skipped by them.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from advercity.errors import InputError

POINT = np.dtype(
    [
        ("x", "<f4"),
        ("y", "<f4"),
        ("z", "<f4"),
        ("rgb", "<u4"),
        ("intensity", "<f4"),
        ("ring", "<u2"),
        ("object_id", "<i4"),
        ("tag", "<u1"),
        ("kind", "<u1"),
    ]
)
"""A point as it lies in the file, without padding."""


def encode(
    points: NDArray[np.floating],
    *,
    intensity: NDArray[np.floating],
    ring: NDArray[np.integer],
    object_id: NDArray[np.integer],
    tag: NDArray[np.integer],
    kind: NDArray[np.integer],
) -> bytes:
    """The file of a cloud.

    Args:
        points: (n, 3) metres.
        intensity: (n,) from 0 to 1.
        ring: (n,) LiDAR channel.
        object_id: (n,) actor that was hit, or 0.
        tag: (n,) of `Semantic`.
        kind: (n,) of `PointKind`.
    """
    table = np.empty(len(points), dtype=POINT)
    table["x"], table["y"], table["z"] = points.T
    table["rgb"] = np.rint(np.clip(intensity, 0, 1) * 255).astype(np.uint32) << 16
    table["intensity"] = intensity
    table["ring"] = ring
    table["object_id"] = object_id
    table["tag"] = tag
    table["kind"] = kind
    return _header(len(points)).encode("ascii") + table.tobytes()


def _header(count: int) -> str:
    types = [POINT[name] for name in POINT.names or ()]
    lines = (
        "# .PCD v0.7 - Point Cloud Data file format",
        "VERSION 0.7",
        f"FIELDS {' '.join(POINT.names or ())}",
        f"SIZE {' '.join(str(kind.itemsize) for kind in types)}",
        f"TYPE {' '.join(kind.kind.upper() for kind in types)}",
        f"COUNT {' '.join('1' for _ in types)}",
        f"WIDTH {count}",
        "HEIGHT 1",
        "VIEWPOINT 0 0 0 1 0 0 0",
        f"POINTS {count}",
        "DATA binary",
    )
    return "\n".join(lines) + "\n"


def read(path: Path) -> NDArray[np.void]:
    """The points of a binary cloud as a table of the fields that its header names.

    Raises:
        InputError: It cannot be read, or is something else.
    """
    try:
        header, _, body = path.read_bytes().partition(b"DATA binary\n")
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    try:
        count, kind = _declared(header.decode("ascii"))
    except (KeyError, ValueError) as error:
        raise InputError(f"{path}: not a binary point cloud: {error}") from error
    if len(body) != count * kind.itemsize:
        raise InputError(
            f"{path}: is cut off: {len(body)} bytes for {count} points of {kind.itemsize}"
        )
    return np.frombuffer(body, dtype=kind)


def _declared(header: str) -> tuple[int, np.dtype[np.void]]:
    """Number and layout of points; KeyError or ValueError if the header is none."""
    entries = {key: values for key, *values in map(str.split, header.splitlines())}
    letters = {"F": "f", "I": "i", "U": "u"}
    kinds = [
        f"<{letters[letter]}{size}"
        for letter, size in zip(entries["TYPE"], entries["SIZE"], strict=True)
    ]
    return int(entries["POINTS"][0]), np.dtype(list(zip(entries["FIELDS"], kinds, strict=True)))
