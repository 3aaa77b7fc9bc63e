"""Point clouds as files: binary PCD with the full point table, and PLY as text.

PCD: readers of OPV2V take `x y z` as 4-byte floats and the intensity from the red channel of
`rgb`, eight bits of it. They skip the fields behind `rgb`, which hold the full precision and all
else that is known of a point. `x y z` and `raw_x raw_y raw_z` are left-handed.

PLY: as the original wrote it with Open3D. Coordinates are doubles, the intensity is the red colour
in eight bits, and there is nothing else.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from advercity.dataset.carla_frame import mirror_columns
from advercity.errors import InputError, describe_cause

if TYPE_CHECKING:
    from advercity.sensors.measurements import PointCloud

PCD_POINT = np.dtype(
    [
        ("x", "<f4"),
        ("y", "<f4"),
        ("z", "<f4"),
        ("rgb", "<u4"),
        ("intensity", "<f4"),
        ("range", "<f4"),
        ("time", "<f4"),
        ("object_id", "<i4"),
        ("ring", "<u2"),
        ("tag", "<u1"),
        ("kind", "<u1"),
    ]
)
"""A point as it is in the file, without padding."""
PCD_RAW_FIELDS = [("raw_x", "<f4"), ("raw_y", "<f4"), ("raw_z", "<f4")]
"""Fields of a LiDAR with motion distortion: the point where the moving sensor measured it."""


def encode_pcd(cloud: PointCloud, *, raw: bool = False) -> bytes:
    """Encode a cloud as binary PCD; the same cloud gives the same bytes.

    Args:
        cloud: The points.
        raw: Whether to add where the moving sensor measured each of them.
    """
    kind = np.dtype([*PCD_POINT.descr, *PCD_RAW_FIELDS]) if raw else PCD_POINT
    table = np.empty(len(cloud.points), dtype=kind)
    table["x"], table["y"], table["z"] = cloud.points.T
    # PCL packs 0x00RRGGBB into four bytes; loaders take the red ones for the intensity.
    table["rgb"] = np.rint(np.clip(cloud.intensity, 0, 1) * 255).astype(np.uint32) << 16
    table["intensity"] = cloud.intensity
    table["range"] = cloud.range_m
    table["time"] = cloud.time_s
    table["object_id"] = cloud.instance
    table["ring"] = cloud.ring
    table["tag"] = cloud.semantic
    table["kind"] = cloud.kind
    if raw:
        table["raw_x"], table["raw_y"], table["raw_z"] = cloud.raw.T
    mirror_columns(table)
    return b"".join([_format_pcd_header(len(table), kind).encode("ascii"), table.data])


def _format_pcd_header(count: int, point: np.dtype[np.void]) -> str:
    names = point.names or ()
    types = [point[name] for name in names]
    lines = (
        "# .PCD v0.7 - Point Cloud Data file format",
        "VERSION 0.7",
        f"FIELDS {' '.join(names)}",
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


def read_pcd(path: Path) -> NDArray[np.void]:
    """Read a binary PCD as a table (n,) of the fields that its header names, left-handed.

    Raises:
        InputError: The file cannot be read, or is no binary PCD.
    """
    try:
        header, _, body = path.read_bytes().partition(b"DATA binary\n")
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {describe_cause(error)}") from error
    try:
        count, kind = _parse_pcd_header(header.decode("ascii"))
    except (KeyError, ValueError) as error:
        raise InputError(f"{path}: not a binary point cloud: {error}") from error
    if len(body) != count * kind.itemsize:
        raise InputError(
            f"{path}: is cut off: {len(body)} bytes for {count} points of {kind.itemsize}"
        )
    return np.frombuffer(body, dtype=kind)


def _parse_pcd_header(header: str) -> tuple[int, np.dtype[np.void]]:
    """Parse the number of points and their fields; KeyError or ValueError if it is no header."""
    entries = {key: values for key, *values in map(str.split, header.splitlines())}
    letters = {"F": "f", "I": "i", "U": "u"}
    kinds = [
        f"<{letters[letter]}{size}"
        for letter, size in zip(entries["TYPE"], entries["SIZE"], strict=True)
    ]
    return int(entries["POINTS"][0]), np.dtype(list(zip(entries["FIELDS"], kinds, strict=True)))


PLY_POINT = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4")])
"""A point as `read_ply` returns it."""
_PLY_HEADER = """ply
format ascii 1.0
element vertex {count}
property double x
property double y
property double z
property uchar red
property uchar green
property uchar blue
end_header
"""


def encode_ply(points: NDArray[np.floating], *, intensity: NDArray[np.floating]) -> bytes:
    """Encode left-handed `points` (n, 3) in metres with `intensity` (n,) from 0 to 1 as PLY."""
    red = np.rint(np.clip(intensity, 0, 1) * 255)
    table = np.column_stack([points, red])
    # One format string for all rows takes two thirds of the time of a loop or of `np.savetxt`.
    body = ("%.6f %.6f %.6f %d 0 0\n" * len(table)) % tuple(table.ravel().tolist())
    return (_PLY_HEADER.format(count=len(table)) + body).encode("ascii")


def read_ply(path: Path) -> NDArray[np.void]:
    """Read a file of `encode_ply` as a table (n,) of `PLY_POINT`; InputError if it is none."""
    try:
        header, _, body = path.read_bytes().partition(b"end_header\n")
        count = int(header.partition(b"element vertex ")[2].split(maxsplit=1)[0])
        columns = np.array(body.split(), dtype=np.float64).reshape(count, 6)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {describe_cause(error)}") from error
    except (IndexError, ValueError) as error:
        raise InputError(f"{path}: not a cloud of advercity, or cut off: {error}") from error
    table = np.empty(count, dtype=PLY_POINT)
    table["x"], table["y"], table["z"] = columns[:, :3].T
    table["intensity"] = columns[:, 3] / 255
    return table
