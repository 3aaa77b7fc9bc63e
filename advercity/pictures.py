"""Writes pictures for people to look at."""

from pathlib import Path
from typing import Any

import cv2
from numpy.typing import NDArray

from advercity.errors import InputError

JPEG_SUFFIXES = (".jpg", ".jpeg")
JPEG_QUALITY = 85


def write_picture(image: NDArray[Any], path: Path) -> None:
    """Write an image (h, w, 3) in BGR as PNG or JPEG, as the file's name says.

    Raises:
        InputError: The name is of no picture, or it cannot be written there.
    """
    is_jpeg = path.suffix.lower() in JPEG_SUFFIXES
    options = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY] if is_jpeg else []
    try:
        encoded, content = cv2.imencode(path.suffix, image, options)
    except cv2.error:
        encoded, content = False, None
    if not encoded or content is None:
        raise InputError(f"{path}: no picture has such a name; end it in .png")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content.tobytes())
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from error
