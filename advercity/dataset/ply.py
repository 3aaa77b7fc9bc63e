"""Point clouds in the PLY format, as text, as the original wrote them with Open3D.

Coordinates are doubles; the intensity is the red colour, in eight bits, and there is nothing else.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from advercity.errors import InputError

POINT = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4")])
"""A point as it is read."""
_HEADER = """ply
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


def encode(points: NDArray[np.floating], *, intensity: NDArray[np.floating]) -> bytes:
    """The file of a cloud: `points` (n, 3) in metres, `intensity` (n,) from 0 to 1."""
    red = np.rint(np.clip(intensity, 0, 1) * 255)
    table = np.column_stack([points, red])
    body = ("%.6f %.6f %.6f %d 0 0\n" * len(table)) % tuple(table.ravel().tolist())
    return (_HEADER.format(count=len(table)) + body).encode("ascii")


def read(path: Path) -> NDArray[np.void]:
    """The points of a file that `encode` made, as a table of `POINT`; InputError if it is not."""
    try:
        header, _, body = path.read_bytes().partition(b"end_header\n")
        count = int(header.partition(b"element vertex ")[2].split(maxsplit=1)[0])
        columns = np.array(body.split(), dtype=np.float64).reshape(count, 6)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    except (IndexError, ValueError) as error:
        raise InputError(f"{path}: not a cloud of advercity, or cut off: {error}") from error
    table = np.empty(count, dtype=POINT)
    table["x"], table["y"], table["z"] = columns[:, :3].T
    table["intensity"] = columns[:, 3] / 255
    return table
