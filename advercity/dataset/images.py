"""Pictures as files."""

import cv2
import numpy as np
from numpy.typing import NDArray

from advercity.semantics import PALETTE

_COLOURS = np.zeros((256, 1, 3), dtype=np.uint8)
_COLOURS[: len(PALETTE), 0] = PALETTE


def png(image: NDArray[np.uint8]) -> bytes:
    """An RGB picture (h, w, 3), without loss.

    OpenCV's own settings (run lengths of differences to the left) take half the time of any
    compression level that is asked for, and less space.
    """
    return _encoded(image, ".png", [])


def jpeg(image: NDArray[np.uint8], *, quality: int = 85) -> bytes:
    """An RGB picture (h, w, 3) for looking at."""
    return _encoded(image, ".jpg", [cv2.IMWRITE_JPEG_QUALITY, quality])


def painted(semantic: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """RGB picture (h, w, 3) of tags (h, w) in CARLA's colours."""
    return np.asarray(cv2.applyColorMap(semantic, _COLOURS), dtype=np.uint8)


def _encoded(image: NDArray[np.uint8], kind: str, settings: list[int]) -> bytes:
    encoded, content = cv2.imencode(kind, cv2.cvtColor(image, cv2.COLOR_RGB2BGR), settings)
    assert encoded, "an 8-bit colour picture always encodes"
    return content.tobytes()
