"""Pictures to look at, and the values that are written as pictures."""

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from advercity.semantics import PALETTE

_COLOURS = np.zeros((256, 1, 3), dtype=np.uint8)
_COLOURS[: len(PALETTE), 0] = PALETTE


def jpeg(image: NDArray[np.uint8], *, quality: int = 85) -> bytes:
    """An RGB picture (h, w, 3) for looking at."""
    bgr = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    encoded, content = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, quality])
    assert encoded, "an 8-bit picture always encodes"
    return content.tobytes()


def painted(semantic: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """RGB picture (h, w, 3) of tags (h, w) in CARLA's colours."""
    return np.asarray(cv2.applyColorMap(semantic, _COLOURS), dtype=np.uint8)


def unpainted(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Tags (h, w) of a picture (h, w, 3) in CARLA's colours; what is no such colour is 0."""
    return _tag_of_colour()[_packed(picture)]


def whole_metres(depth: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Depths (h, w) in metres, inf for the sky, as 8-bit values."""
    return np.rint(np.minimum(depth, 255.0)).astype(np.uint8)


def in_three_channels(mask: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """A mask (h, w) as a picture (h, w, 3) of equal channels."""
    return np.asarray(cv2.cvtColor(mask, cv2.COLOR_GRAY2BGR), dtype=np.uint8)


def side_by_side(jobs: Mapping[str, Callable[[], bytes]]) -> dict[str, bytes]:
    """What every job gives, by its name; OpenCV and NumPy let threads run together."""
    with ThreadPoolExecutor() as pool:
        running = {name: pool.submit(job) for name, job in jobs.items()}
    return {name: future.result() for name, future in running.items()}


@cache
def _tag_of_colour() -> NDArray[np.uint8]:
    """Tag by packed colour."""
    tags = np.zeros(1 << 24, np.uint8)
    tags[_packed(PALETTE)] = np.arange(len(PALETTE))
    return tags


def _packed(colours: NDArray[np.uint8]) -> NDArray[np.uint32]:
    """Colours (..., 3) as numbers (...)."""
    red, green, blue = np.moveaxis(colours.astype(np.uint32), -1, 0)
    return red << 16 | green << 8 | blue
