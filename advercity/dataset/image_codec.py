"""Converts images: PNG and JPEG files, semantic colours, depths as whole numbers.

PNG (W3C, Portable Network Graphics, third edition) is encoded here: OpenCV takes 2.4 to 2.8 times
as long at the same size. Pixels are written as differences to their left neighbours. Photographs
are noisy, so a search for repeats finds none, and only the differences get variable-length codes;
labels repeat, and are coded as runs. Unlike faster searches for repeats, neither depends on the
instructions of the processor, so the bytes are the same everywhere.
"""

import struct
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray
from zlib_ng import zlib_ng

from advercity.media import JPEG_QUALITY
from advercity.semantics import PALETTE

_COLOURS = np.zeros((256, 1, 3), dtype=np.uint8)
_COLOURS[: len(PALETTE), 0] = PALETTE

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
GREY, RGB = 0, 2
"""Colour types of PNG."""
SUB_FILTER = 1
"""PNG's number for differences to the left neighbour."""
DEFLATE_MEMORY_LEVEL = 9
"""zlib's maximum of memory: larger blocks, and so fewer code tables."""


def encode_jpeg(image: NDArray[np.uint8]) -> bytes:
    """Encode an RGB image (h, w, 3) with loss, for people to look at."""
    bgr = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    encoded, content = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    assert encoded, "an 8-bit image always encodes"
    return content.tobytes()


def to_semantic_colours(semantic: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Convert tags (h, w) to an RGB image (h, w, 3) in CARLA's colours."""
    return np.asarray(cv2.applyColorMap(semantic, _COLOURS), dtype=np.uint8)


def from_semantic_colours(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Convert an RGB image (h, w, 3) in CARLA's colours to tags (h, w); other colours give 0."""
    return _build_tag_table()[_pack_colours(image)]


def to_instance_colours(instance: NDArray[np.int32]) -> NDArray[np.uint8]:
    """Convert ids (h, w) to an RGB image (h, w, 3) as COCO does: R + 256 G + 256² B."""
    return np.stack([instance & 255, instance >> 8 & 255, instance >> 16], axis=2).astype(np.uint8)


def from_instance_colours(image: NDArray[np.uint8]) -> NDArray[np.int32]:
    """Convert an RGB image (h, w, 3) of `to_instance_colours` to ids (h, w)."""
    red, green, blue = np.moveaxis(image.astype(np.int32), -1, 0)
    return red | green << 8 | blue << 16


def to_normal_colours(normal: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Convert unit vectors (h, w, 3) to an RGB image (h, w, 3): -1 is 0, and 1 is 255."""
    return np.rint((normal + np.float32(1.0)) * np.float32(127.5)).astype(np.uint8)


def from_normal_colours(image: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Convert an RGB image (h, w, 3) of `to_normal_colours` to vectors, to 0.004."""
    return (image / np.float32(127.5) - np.float32(1.0)).astype(np.float32)


FLOW_STEPS_PER_PX, FLOW_ZERO = 64.0, 1 << 15
"""Steps of a pixel, and the value of no motion, in the flow images of KITTI."""


def to_flow_colours(shift_px: NDArray[np.float32]) -> NDArray[np.uint16]:
    """Convert shifts (h, w, 2), NaN where unknown, to an RGB image (h, w, 3) as KITTI does.

    Red and green have the shift to the right and down in 64ths of a pixel, blue is 1 where it is
    known. Shifts of 512 pixels and more count as unknown.
    """
    steps = np.rint(shift_px * np.float32(FLOW_STEPS_PER_PX)) + FLOW_ZERO
    known = ((steps >= 0) & (steps < 2 * FLOW_ZERO)).all(axis=2, keepdims=True)
    colours = np.concatenate([np.where(known, steps, 0), known], axis=2)
    return colours.astype(np.uint16)


def from_flow_colours(image: NDArray[np.uint16]) -> NDArray[np.float32]:
    """Convert an RGB image (h, w, 3) of `to_flow_colours` to shifts (h, w, 2), to 1/128 pixel."""
    shift = (image[..., :2].astype(np.float32) - FLOW_ZERO) / np.float32(FLOW_STEPS_PER_PX)
    return np.where(image[..., 2:] > 0, shift, np.float32(np.nan))


def to_whole_metres(depth_cm: NDArray[np.uint16]) -> NDArray[np.uint8]:
    """Round depths (h, w) in centimetres to metres, at most 255."""
    return np.rint(np.minimum(depth_cm * np.float32(0.01), 255.0)).astype(np.uint8)


def to_three_channels(mask: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Convert a mask (h, w) to an image (h, w, 3) of equal channels."""
    return np.asarray(cv2.cvtColor(mask, cv2.COLOR_GRAY2BGR), dtype=np.uint8)


@cache
def _build_tag_table() -> NDArray[np.uint8]:
    """Build the table (2**24,) of tags by packed colour."""
    # 16 MiB once per process: an index is many times faster than comparing with 23 colours.
    tags = np.zeros(1 << 24, np.uint8)
    tags[_pack_colours(PALETTE)] = np.arange(len(PALETTE))
    return tags


def _pack_colours(colours: NDArray[np.uint8]) -> NDArray[np.uint32]:
    """Pack RGB colours (..., 3) into numbers (...)."""
    red, green, blue = np.moveaxis(colours.astype(np.uint32), -1, 0)
    return red << 16 | green << 8 | blue


def encode_photo_png(image: NDArray[np.uint8]) -> bytes:
    """Encode an RGB photograph (h, w, 3) without loss."""
    return _encode_png(image, zlib_ng.Z_HUFFMAN_ONLY)


def encode_label_png(image: NDArray[np.uint8]) -> bytes:
    """Encode an image of areas of one value each, RGB (h, w, 3) or grey (h, w), without loss."""
    return _encode_png(image, zlib_ng.Z_RLE)


def encode_deep_png(image: NDArray[np.uint16]) -> bytes:
    """Encode an image of 16-bit values, RGB (h, w, 3) or grey (h, w), without loss."""
    return _encode_png(image, zlib_ng.Z_RLE)


def _encode_png(image: NDArray[np.uint8] | NDArray[np.uint16], strategy: int) -> bytes:
    """Encode RGB (h, w, 3) or grey (h, w)."""
    height, width = image.shape[:2]
    values = image.shape[2] if image.ndim == 3 else 1
    kind, channels = RGB if values == 3 else GREY, values * image.itemsize
    header = struct.pack(">IIBBBBB", width, height, 8 * image.itemsize, kind, 0, 0, 0)
    coder = zlib_ng.compressobj(
        1, zlib_ng.DEFLATED, zlib_ng.MAX_WBITS, DEFLATE_MEMORY_LEVEL, strategy
    )
    # PNG has the high byte first.
    raw = np.ascontiguousarray(image.astype(f">u{image.itemsize}", copy=False)).view(np.uint8)
    rows = _filter_rows(raw.reshape(height, width * channels), channels)
    pixels = coder.compress(rows.data) + coder.flush()
    chunks = (
        _build_chunk(b"IHDR", header),
        _build_chunk(b"IDAT", pixels),
        _build_chunk(b"IEND", b""),
    )
    return b"".join([PNG_SIGNATURE, *(part for chunk in chunks for part in chunk)])


def _filter_rows(rows: NDArray[np.uint8], channels: int) -> NDArray[np.uint8]:
    """Compute rows (h, 1 + n) of the filter's number and differences modulo 256."""
    filtered = np.empty((rows.shape[0], 1 + rows.shape[1]), np.uint8)
    filtered[:, 0] = SUB_FILTER
    filtered[:, 1 : 1 + channels] = rows[:, :channels]
    np.subtract(rows[:, channels:], rows[:, :-channels], out=filtered[:, 1 + channels :])
    return filtered


def _build_chunk(name: bytes, content: bytes) -> tuple[bytes, bytes, bytes, bytes]:
    check = zlib_ng.crc32(content, zlib_ng.crc32(name))
    return struct.pack(">I", len(content)), name, content, struct.pack(">I", check)
