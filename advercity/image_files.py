"""Images of unknown authors, of limited size."""

import struct
from io import BytesIO
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

MAX_SIDE_PX = 8192
"""Largest width and height of a camera in a rig."""
MAX_PIXELS_PER_BYTE = 8 * 1032
"""Pixels of one bit at the highest ratio of deflate, by its RFC 1951: 258 bytes by two bits."""
PNG_START = b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR"
"""First bytes of every PNG; its width and height follow."""


def decode_image(content: bytes, mode: int) -> NDArray[Any]:
    """Decode an image, whose size is read from its header before memory is taken for it.

    Args:
        content: Content of the file.
        mode: Flag of OpenCV, as `cv2.IMREAD_COLOR_RGB`.

    Raises:
        ValueError: It is no image, larger than `MAX_SIDE_PX` squared, or has too few bytes.
    """
    width, height = _read_size(content)
    if width * height > MAX_SIDE_PX**2:
        raise ValueError(f"{width} x {height} pixels, more than {MAX_SIDE_PX} x {MAX_SIDE_PX}")
    if width * height > MAX_PIXELS_PER_BYTE * len(content):
        raise ValueError(f"{width} x {height} pixels cannot be in {len(content)} bytes")
    image: Any = cv2.imdecode(np.frombuffer(content, np.uint8), mode)
    if image is None:
        raise ValueError("no image")
    return image


def _read_size(content: bytes) -> tuple[int, int]:
    """Read width and height from the header of an image."""
    if content.startswith(PNG_START) and len(content) > len(PNG_START) + 8:
        _check_chunks(content)
        width, height = struct.unpack_from(">II", content, len(PNG_START))
        return width, height
    # Imported here: images of datasets are PNG, and reading them loads no other library.
    from PIL import Image

    try:
        with Image.open(BytesIO(content)) as header:
            return header.size
    except Exception as error:  # Pillow's readers of damaged headers may raise anything
        raise ValueError("no image") from error


def _check_chunks(content: bytes) -> None:
    """Refuse a PNG with a chunk longer than the file, for which OpenCV would take memory."""
    at, name = PNG_START.index(b"IHDR") - 4, b""
    while name != b"IEND":
        if at + 12 > len(content):
            raise ValueError("no image")
        length, name = struct.unpack_from(">I4s", content, at)
        at += 12 + length
    if at > len(content):
        raise ValueError("no image")
