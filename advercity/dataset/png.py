"""Pictures as PNG files, without loss (W3C, Portable Network Graphics, third edition).

Pixels are written as differences to their left neighbours. Photographs are noisy, so looking for
repeats in them is in vain, and their differences only get codes as long as they are rare; labels
repeat themselves, and are written as runs. Neither depends on what a processor is able to, as
faster ways of looking for repeats do, so the bytes are the same everywhere.
"""

import struct

import numpy as np
from numpy.typing import NDArray
from zlib_ng import zlib_ng

SIGNATURE = b"\x89PNG\r\n\x1a\n"
GREY, RGB = 0, 2
LEFT = 1
"""The filter that takes differences to the left."""
BUFFER = 9
"""Memory that the coder may take, at most 9: the more, the fewer tables of codes."""


def photograph_png(image: NDArray[np.uint8]) -> bytes:
    """A picture (h, w, 3) RGB of a camera."""
    return _png(image, zlib_ng.Z_HUFFMAN_ONLY)


def label_png(image: NDArray[np.uint8]) -> bytes:
    """A picture (h, w, 3) RGB or (h, w) grey of areas that are each of one value."""
    return _png(image, zlib_ng.Z_RLE)


def _png(image: NDArray[np.uint8], strategy: int) -> bytes:
    height, width = image.shape[:2]
    channels = image.shape[2] if image.ndim == 3 else 1
    kind = RGB if channels == 3 else GREY
    header = struct.pack(">IIBBBBB", width, height, 8, kind, 0, 0, 0)
    coder = zlib_ng.compressobj(1, zlib_ng.DEFLATED, zlib_ng.MAX_WBITS, BUFFER, strategy)
    rows = _filtered(image.reshape(height, width * channels), channels)
    pixels = coder.compress(rows.data) + coder.flush()
    chunks = _chunk(b"IHDR", header), _chunk(b"IDAT", pixels), _chunk(b"IEND", b"")
    return b"".join([SIGNATURE, *(part for chunk in chunks for part in chunk)])


def _filtered(rows: NDArray[np.uint8], channels: int) -> NDArray[np.uint8]:
    """Rows (h, 1 + n) of the filter's number and differences modulo 256."""
    filtered = np.empty((rows.shape[0], 1 + rows.shape[1]), np.uint8)
    filtered[:, 0] = LEFT
    filtered[:, 1 : 1 + channels] = rows[:, :channels]
    np.subtract(rows[:, channels:], rows[:, :-channels], out=filtered[:, 1 + channels :])
    return filtered


def _chunk(name: bytes, content: bytes) -> tuple[bytes, bytes, bytes, bytes]:
    check = zlib_ng.crc32(content, zlib_ng.crc32(name))
    return struct.pack(">I", len(content)), name, content, struct.pack(">I", check)
