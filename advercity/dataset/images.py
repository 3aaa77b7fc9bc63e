"""Pictures as files."""

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
from cv2.typing import MatLike
from numpy.typing import NDArray

from advercity.semantics import PALETTE

_COLOURS = np.zeros((256, 1, 3), dtype=np.uint8)
_COLOURS[: len(PALETTE), 0] = PALETTE


def png(image: NDArray[np.uint8]) -> bytes:
    """An RGB picture (h, w, 3), without loss.

    OpenCV's own settings (run lengths of differences to the left) take half the time of any
    compression level that is asked for, and less space.
    """
    return _encoded(cv2.cvtColor(image, cv2.COLOR_RGB2BGR), ".png", [])


def grey_png(image: NDArray[np.uint8]) -> bytes:
    """A picture (h, w) of one channel, without loss."""
    return _encoded(image, ".png", [])


def mask_png(mask: NDArray[np.uint8]) -> bytes:
    """A mask (h, w) as three equal channels."""
    return _encoded(cv2.cvtColor(mask, cv2.COLOR_GRAY2BGR), ".png", [])


def jpeg(image: NDArray[np.uint8], *, quality: int = 85) -> bytes:
    """An RGB picture (h, w, 3) for looking at."""
    bgr = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    return _encoded(bgr, ".jpg", [cv2.IMWRITE_JPEG_QUALITY, quality])


def painted(semantic: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """RGB picture (h, w, 3) of tags (h, w) in CARLA's colours."""
    return np.asarray(cv2.applyColorMap(semantic, _COLOURS), dtype=np.uint8)


def whole_metres(depth: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Depths (h, w) in metres, inf for the sky, as 8-bit values."""
    return np.rint(np.minimum(depth, 255.0)).astype(np.uint8)


def side_by_side(jobs: Mapping[str, Callable[[], bytes]]) -> dict[str, bytes]:
    """What every job gives, by its name; OpenCV and NumPy let threads run together."""
    with ThreadPoolExecutor() as pool:
        running = {name: pool.submit(job) for name, job in jobs.items()}
    return {name: future.result() for name, future in running.items()}


def _encoded(image: MatLike, kind: str, settings: list[int]) -> bytes:
    encoded, content = cv2.imencode(kind, image, settings)
    assert encoded, "an 8-bit picture always encodes"
    return content.tobytes()
