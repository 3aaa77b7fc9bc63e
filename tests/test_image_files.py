import resource
import struct
import tracemalloc
import zlib

import cv2
import numpy as np
import pytest

from advercity.image_files import decode_image


def build_png(width: int, height: int, rows: int) -> bytes:
    """Build a grey PNG whose header has a size, and whose data are some rows of it."""

    def chunk(name: bytes, content: bytes) -> bytes:
        check = zlib.crc32(name + content)
        return struct.pack(">I", len(content)) + name + content + struct.pack(">I", check)

    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    data = zlib.compress(bytes((width + 1) * rows))
    parts = (chunk(b"IHDR", header), chunk(b"IDAT", data), chunk(b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_images_are_decoded_as_opencv_does(suffix: str) -> None:
    image = np.arange(60 * 80 * 3, dtype=np.uint16).reshape(60, 80, 3).astype(np.uint8)
    content = cv2.imencode(suffix, image)[1].tobytes()
    expected = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR_RGB)
    np.testing.assert_array_equal(decode_image(content, cv2.IMREAD_COLOR_RGB), expected)


def test_the_largest_camera_of_a_rig_is_read() -> None:
    assert decode_image(build_png(8192, 8192, 8192), cv2.IMREAD_GRAYSCALE).shape == (8192, 8192)


@pytest.mark.parametrize(("width", "height"), [(8192, 8193), (30_000, 30_000), (10**9, 1)])
def test_a_larger_image_takes_no_memory(width: int, height: int) -> None:
    content = build_png(8, 8, 8).replace(
        struct.pack(">II", 8, 8), struct.pack(">II", width, height)
    )
    tracemalloc.start()
    with pytest.raises(ValueError, match=r"no image|more than 8192 x 8192"):
        decode_image(content, cv2.IMREAD_COLOR_RGB)
    assert tracemalloc.get_traced_memory()[1] < 20_000_000
    tracemalloc.stop()


@pytest.mark.parametrize("name", [b"IDAT", b"tEXt", b"IEND"])
def test_a_chunk_longer_than_its_file_takes_no_memory(name: bytes) -> None:
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    small = build_png(8, 8, 8)
    chunk = struct.pack(">I4s", 0x7FFF_FF00, name) + bytes(30)
    with pytest.raises(ValueError, match="no image"):
        decode_image(small[:33] + chunk + small[33:], cv2.IMREAD_COLOR_RGB)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000  # kB


def test_pixels_that_cannot_be_in_so_few_bytes_are_refused() -> None:
    with pytest.raises(ValueError, match=r"8192 x 8192 pixels cannot be in [0-9]+ bytes"):
        decode_image(build_png(8192, 8192, 8), cv2.IMREAD_GRAYSCALE)


@pytest.mark.parametrize("content", [b"", b"text", b"\x89PNG\r\n\x1a\n", build_png(8, 8, 8)[:40]])
def test_what_is_no_image_is_refused(content: bytes) -> None:
    with pytest.raises(ValueError, match="no image"):
        decode_image(content, cv2.IMREAD_COLOR_RGB)
