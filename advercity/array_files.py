"""Reads `.npz` files from unknown or damaged sources: bounded, without pickles."""

import io
import math
import stat
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from advercity.errors import RunError, describe_cause

MAX_ARRAYS = 100
MAX_HEADER_LENGTH = 10_000


def load_arrays(path: Path, *, max_bytes: int) -> dict[str, NDArray[Any]]:
    """Load all arrays of an `.npz` file, by name.

    Args:
        path: The file.
        max_bytes: Most bytes after unpacking.

    Raises:
        RunError: It cannot be read, is no such file, is damaged, or is larger.
    """
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            raise ValueError("is no regular file")
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
            _check_members(members, max_bytes)
            return {
                member.filename.removesuffix(".npy"): _parse_array(archive.read(member))
                for member in members
            }
    except OSError as error:
        raise RunError(f"{path}: cannot be read: {describe_cause(error)}") from error
    except Exception as error:  # zipfile, zlib and NumPy raise anything where bytes are wrong
        raise RunError(f"{path}: not a file of arrays: {error or type(error).__name__}") from error


def _check_members(members: list[zipfile.ZipInfo], max_bytes: int) -> None:
    """Raise ValueError for contents `np.savez` never writes, and for too large archives."""
    if len(members) > MAX_ARRAYS:
        raise ValueError(f"more than {MAX_ARRAYS} arrays")
    # `zipfile` reads no more of a member than its directory says.
    if sum(member.file_size for member in members) > max_bytes:
        raise ValueError(f"unpacks to more than {max_bytes / 1e9:g} GB")
    if any(one.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) for one in members):
        raise ValueError("unusual compression")


def _parse_array(content: bytes) -> NDArray[Any]:
    """Parse the content of an `.npy` file; its header decides no allocation."""
    stream = io.BytesIO(content)
    if np.lib.format.read_magic(stream) != (1, 0):
        raise ValueError("unusual version of the array format")
    shape, is_fortran, dtype = np.lib.format.read_array_header_1_0(stream, MAX_HEADER_LENGTH)
    begin = stream.tell()
    if dtype.hasobject or not dtype.itemsize:
        raise ValueError(f"array of {dtype}")
    if math.prod(shape) * dtype.itemsize != len(content) - begin:
        raise ValueError("array of another size than its header says")
    flat = np.frombuffer(content, dtype, offset=begin)
    return flat.reshape(shape, order="F" if is_fortran else "C").copy()
