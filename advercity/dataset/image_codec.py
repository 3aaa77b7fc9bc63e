"""Pictures to look at, and the values that are written as pictures.

Pictures as PNG files, without loss (W3C, Portable Network Graphics, third edition).

Pixels are written as differences to their left neighbours. Photographs are noisy, so looking for
repeats in them is in vain, and their differences only get codes as long as they are rare; labels
repeat themselves, and are written as runs. Neither depends on what a processor is able to, as
faster ways of looking for repeats do, so the bytes are the same everywhere.
"""

import struct
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray
from zlib_ng import zlib_ng

from advercity.semantics import PALETTE

_COLOURS = np.zeros((256, 1, 3), dtype=np.uint8)
_COLOURS[: len(PALETTE), 0] = PALETTE


def encode_jpeg(image: NDArray[np.uint8], *, quality: int = 85) -> bytes:
    """An RGB picture (h, w, 3) for looking at."""
    bgr = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    encoded, content = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, quality])
    assert encoded, "an 8-bit picture always encodes"
    return content.tobytes()


def to_semantic_colours(semantic: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """RGB picture (h, w, 3) of tags (h, w) in CARLA's colours."""
    return np.asarray(cv2.applyColorMap(semantic, _COLOURS), dtype=np.uint8)


def from_semantic_colours(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Tags (h, w) of a picture (h, w, 3) in CARLA's colours; what is no such colour is 0."""
    return _build_tag_table()[_pack_colours(picture)]


def quantise_depth(depth: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Depths (h, w) in metres, inf for the sky, as 8-bit values."""
    return np.rint(np.minimum(depth, 255.0)).astype(np.uint8)


def to_three_channels(mask: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """A mask (h, w) as a picture (h, w, 3) of equal channels."""
    return np.asarray(cv2.cvtColor(mask, cv2.COLOR_GRAY2BGR), dtype=np.uint8)


@cache
def _build_tag_table() -> NDArray[np.uint8]:
    """Tag by packed colour."""
    tags = np.zeros(1 << 24, np.uint8)
    tags[_pack_colours(PALETTE)] = np.arange(len(PALETTE))
    return tags


def _pack_colours(colours: NDArray[np.uint8]) -> NDArray[np.uint32]:
    """Colours (..., 3) as numbers (...)."""
    red, green, blue = np.moveaxis(colours.astype(np.uint32), -1, 0)
    return red << 16 | green << 8 | blue


PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
GREY, RGB = 0, 2
SUB_FILTER = 1
"""The filter that takes differences to the left."""
DEFLATE_MEMORY_LEVEL = 9
"""Memory that the coder may take, at most 9: the more, the fewer tables of codes."""


def encode_photo_png(image: NDArray[np.uint8]) -> bytes:
    """A picture (h, w, 3) RGB of a camera."""
    return _encode_png(image, zlib_ng.Z_HUFFMAN_ONLY)


def encode_label_png(image: NDArray[np.uint8]) -> bytes:
    """A picture (h, w, 3) RGB or (h, w) grey of areas that are each of one value."""
    return _encode_png(image, zlib_ng.Z_RLE)


def _encode_png(image: NDArray[np.uint8], strategy: int) -> bytes:
    height, width = image.shape[:2]
    channels = image.shape[2] if image.ndim == 3 else 1
    kind = RGB if channels == 3 else GREY
    header = struct.pack(">IIBBBBB", width, height, 8, kind, 0, 0, 0)
    coder = zlib_ng.compressobj(
        1, zlib_ng.DEFLATED, zlib_ng.MAX_WBITS, DEFLATE_MEMORY_LEVEL, strategy
    )
    rows = _filter_rows(image.reshape(height, width * channels), channels)
    pixels = coder.compress(rows.data) + coder.flush()
    chunks = (
        _build_chunk(b"IHDR", header),
        _build_chunk(b"IDAT", pixels),
        _build_chunk(b"IEND", b""),
    )
    return b"".join([PNG_SIGNATURE, *(part for chunk in chunks for part in chunk)])


def _filter_rows(rows: NDArray[np.uint8], channels: int) -> NDArray[np.uint8]:
    """Rows (h, 1 + n) of the filter's number and differences modulo 256."""
    filtered = np.empty((rows.shape[0], 1 + rows.shape[1]), np.uint8)
    filtered[:, 0] = SUB_FILTER
    filtered[:, 1 : 1 + channels] = rows[:, :channels]
    np.subtract(rows[:, channels:], rows[:, :-channels], out=filtered[:, 1 + channels :])
    return filtered


def _build_chunk(name: bytes, content: bytes) -> tuple[bytes, bytes, bytes, bytes]:
    check = zlib_ng.crc32(content, zlib_ng.crc32(name))
    return struct.pack(">I", len(content)), name, content, struct.pack(">I", check)
