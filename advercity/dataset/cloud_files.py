"""Point clouds as files: PCD with the full point table, and PLY as text.

PCD: readers of OPV2V take `x y z` as 4-byte floats and the intensity from the red channel of
`rgb`, eight bits of it. They skip the fields behind `rgb`, which hold the full precision and
all other facts of a point. `x y z` and `raw_x raw_y raw_z` are left-handed. Foreign clouds
may have other fields, and be text.

PLY: as the original wrote it with Open3D. Coordinates are doubles, the intensity is the red colour
in eight bits; other fields are absent.
"""

from __future__ import annotations

import math
import struct
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from advercity.dataset.carla_frame import mirror_columns
from advercity.documents import read_bytes
from advercity.errors import InputError, RunError, describe_cause
from advercity.run_options import CloudEncoding

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
MAX_CLOUD_BYTES = 10**9
"""Twenty times the cloud of the densest LiDAR of a spec."""
MAX_LZF_RATIO = 100
"""Upper bound of how many times LZF data grow: at most 264 bytes from 3."""
MAX_FIELD_VALUES = 4096
"""Largest number of values in one field of a point; descriptors of features have some hundreds."""
COLOUR_FIELDS = ("rgb", "rgba")
"""PCL's fields of four bytes, 0xAARRGGBB."""
XYZ = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4")])
_SIZES = struct.Struct("<II")
"""Sizes before compressed data: compressed, and as they are."""


def encode_pcd(
    cloud: PointCloud, *, raw: bool = False, encoding: CloudEncoding = "binary_compressed"
) -> bytes:
    """Encode a cloud as PCD; the same cloud gives the same bytes.

    Args:
        cloud: The points.
        raw: Whether to add where the moving sensor measured each of them.
        encoding: Encoding of the data. A cloud without points is always `binary`.
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
    return encode_pcd_table(table, encoding)


def encode_pcd_table(table: NDArray[np.void], encoding: CloudEncoding) -> bytes:
    """Encode a table (n,) of right-handed points as PCD; it is mirrored in place."""
    mirror_columns(table)
    if not len(table):
        encoding = "binary"
    header = format_pcd_header(len(table), table.dtype, encoding).encode("ascii")
    return b"".join([header, *([table.data] if encoding == "binary" else _compress(table))])


def _compress(table: NDArray[np.void]) -> tuple[bytes, bytes]:
    """Compress a table field by field; also returns the sizes before it."""
    # Imported here and below: readers of other data need not load it.
    from imagecodecs import lzf_encode

    fields = b"".join(table[name].tobytes() for name in table.dtype.names or ())
    compressed = bytes(lzf_encode(fields))
    return _SIZES.pack(len(compressed), len(fields)), compressed


def _decompress(body: bytes, count: int, kind: np.dtype[np.void]) -> NDArray[np.void]:
    """Undo `_compress`; ValueError if the data are cut off or damaged."""
    from imagecodecs import LzfError, lzf_decode

    if len(body) < _SIZES.size:
        raise ValueError("is cut off")
    packed_size, size = _SIZES.unpack_from(body)
    packed = body[_SIZES.size :]
    if packed_size != len(packed) or size != count * kind.itemsize:
        raise ValueError("is cut off, or its sizes do not match its points")
    if size > MAX_LZF_RATIO * packed_size:
        raise ValueError(f"{packed_size} bytes cannot hold {count} points of {kind.itemsize} bytes")
    try:
        fields = lzf_decode(packed, out=size)
    except LzfError as error:
        raise ValueError("its data are damaged") from error
    if len(fields) != size:
        raise ValueError("its data are damaged")
    table, start = np.empty(count, kind), 0
    for name in kind.names or ():
        table[name] = np.frombuffer(fields, kind[name], count, start)
        start += count * kind[name].itemsize
    return table


def _parse_binary(body: bytes, count: int, kind: np.dtype[np.void]) -> NDArray[np.void]:
    if len(body) != count * kind.itemsize:
        raise ValueError(f"is cut off: {len(body)} bytes for {count} points of {kind.itemsize}")
    return np.frombuffer(body, dtype=kind)


def _parse_text(body: bytes, count: int, kind: np.dtype[np.void]) -> NDArray[np.void]:
    """Parse lines of numbers as points; ValueError if there are not `count` of them."""
    widths = {name: math.prod(kind[name].shape) for name in kind.names or ()}
    wanted = count * sum(widths.values())
    # A number takes at least a digit and a separator.
    values = body.split() if 2 * wanted <= len(body) + 1 else []
    if len(values) != wanted:
        raise ValueError(
            f"its text is not {wanted} numbers, {count} points of {len(widths)} fields"
        )
    numbers = np.array(values, np.float64).reshape(count, -1)
    table, start = np.empty(count, kind), 0
    for name, width in widths.items():
        columns = numbers[:, start : start + width].reshape(count, *kind[name].shape)
        # PCL writes the bits of a colour as an integer, whatever the field's type.
        is_colour = name in COLOUR_FIELDS and kind[name] == np.float32
        table[name] = _to_colour_bits(columns).view(np.float32) if is_colour else columns
        start += width
    return table


def _to_colour_bits(values: NDArray[np.float64]) -> NDArray[np.uint32]:
    """Convert colours written as whole numbers, or as floats of the same bits, to these bits."""
    is_whole = values >= 1.0
    bits = np.where(is_whole, 0.0, values).astype(np.float32).view(np.uint32)
    return np.where(is_whole, values, bits).astype(np.uint32)


_PARSERS = {"ascii": _parse_text, "binary": _parse_binary, "binary_compressed": _decompress}


def format_pcd_header(count: int, point: np.dtype[np.void], encoding: CloudEncoding) -> str:
    """Format the header of a PCD file with a table of `count` points of this type."""
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
        f"DATA {encoding}",
    )
    return "\n".join(lines) + "\n"


def read_pcd(path: Path, point: np.dtype[np.void] = PCD_POINT) -> NDArray[np.void]:
    """Read a PCD as a table (n,) of its header's fields, left-handed.

    The size of its data is compared with the header before memory is taken for its points.

    Args:
        path: The file.
        point: Required fields.

    Raises:
        InputError: The file cannot be read, is no PCD, or has not all of the fields.
    """
    content = _read_cloud_file(path)
    header, _, rest = content.partition(b"DATA ")
    encoding, _, body = rest.partition(b"\n")
    try:
        count, kind = _parse_pcd_header(header.decode("ascii"))
        _check_fields(kind, point)
        parse = _PARSERS.get(encoding.decode("ascii").strip())
        if parse is None:
            raise ValueError(f"its data are {encoding[:20]!r}; known are {', '.join(_PARSERS)}")
        return parse(body, count, kind)
    except (LookupError, TypeError, ValueError) as error:
        raise InputError(f"{path}: not a point cloud: {error}") from error


def read_foreign_pcd(path: Path) -> NDArray[np.void]:
    """Read a foreign PCD as a table (n,), in the frame of the file.

    Its fields are the fields of the file and `intensity` from 0 to 1, which OPV2V stores in
    the red channel of `rgb`; without either it has none.

    Raises:
        InputError: The file cannot be read, is no PCD, or lacks `x`, `y` or `z` of 4-byte floats.
    """
    table = read_pcd(path, XYZ)
    names = table.dtype.names or ()
    colour = next((name for name in COLOUR_FIELDS if name in names), None)
    if "intensity" in names or colour is None:
        return table
    wider = np.empty(len(table), np.dtype([*table.dtype.descr, ("intensity", "<f4")]))
    for name in names:
        wider[name] = table[name]
    red = np.ascontiguousarray(table[colour]).view(np.uint32) >> 16 & 255
    wider["intensity"] = red / np.float32(255)
    return wider


def _read_cloud_file(path: Path) -> bytes:
    try:
        return read_bytes(path, max_bytes=MAX_CLOUD_BYTES)
    except PermissionError as error:
        raise RunError(f"{path}: cannot be read: {describe_cause(error)}") from error
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {describe_cause(error)}") from error


def _parse_pcd_header(header: str) -> tuple[int, np.dtype[np.void]]:
    """Parse point count and fields; LookupError, TypeError or ValueError if it is no header."""
    entries = {key: values for key, *values in map(str.split, header.splitlines()) if key != "#"}
    names = entries["FIELDS"]
    letters = {"F": "f", "I": "i", "U": "u"}
    widths = [int(width) for width in entries.get("COUNT", ["1"] * len(names))]
    if any(not 1 <= width <= MAX_FIELD_VALUES for width in widths):
        raise ValueError(f"COUNT is not from 1 to {MAX_FIELD_VALUES}")
    fields: list[Any] = []
    rows = zip(names, entries["TYPE"], entries["SIZE"], widths, strict=True)
    for index, (name, letter, size, width) in enumerate(rows):
        unique = f"_{index}" if name == "_" else name  # PCL's name of bytes that only fill up
        fields.append((unique, f"<{letters[letter]}{size}", *([width] if width > 1 else [])))
    count = int(entries["POINTS"][0])
    if count < 0:
        raise ValueError(f"POINTS is {count}")
    return count, np.dtype(fields)


def _check_fields(found: np.dtype[np.void], wanted: np.dtype[np.void]) -> None:
    """Check the types of a table's fields; ValueError if one differs or is missing."""
    types = {name: found[name] for name in found.names or ()}
    for name in wanted.names or ():
        if types.get(name) != wanted[name]:
            raise ValueError(f"it has no field '{name}' of type {wanted[name].str}")


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
    content = _read_cloud_file(path)
    try:
        header, _, body = content.partition(b"end_header\n")
        count = int(header.partition(b"element vertex ")[2].split(maxsplit=1)[0])
        columns = np.array(body.split(), dtype=np.float64).reshape(count, 6)
    except (IndexError, ValueError) as error:
        raise InputError(f"{path}: not a cloud of advercity, or cut off: {error}") from error
    table = np.empty(count, dtype=PLY_POINT)
    table["x"], table["y"], table["z"] = columns[:, :3].T
    table["intensity"] = columns[:, 3] / 255
    return table
