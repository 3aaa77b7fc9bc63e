"""Images and videos for people to look at; no sensor reads them."""

from collections.abc import Generator
from contextlib import ExitStack, contextmanager
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import cv2
import numpy as np
from numpy.typing import NDArray

from advercity.errors import InputError, RunError, describe_cause
from advercity.output_files import check_output, open_output, write_output

JPEG_SUFFIXES = (".jpg", ".jpeg")
JPEG_QUALITY = 85


def check_image_file(path: Path) -> None:
    """Raise an InputError if an image cannot be written: by its suffix, or an existing file."""
    _encode_image(np.zeros((32, 32, 3), np.uint8), path)
    check_output(path)


def write_image(image: NDArray[Any], path: Path) -> None:
    """Write an image (h, w, 3) in BGR as PNG or JPEG, by the file's suffix.

    Raises:
        InputError: The suffix is of no image format, or the file cannot be written or replaced.
    """
    content = _encode_image(image, path)
    try:
        write_output(path, content)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {describe_cause(error)}") from error


def _encode_image(image: NDArray[Any], path: Path) -> bytes:
    is_jpeg = path.suffix.lower() in JPEG_SUFFIXES
    options = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY] if is_jpeg else []
    try:
        encoded, content = cv2.imencode(path.suffix, image, options)
    except cv2.error:
        encoded, content = False, None
    if not encoded or content is None:
        raise InputError(f"{path}: this suffix is of no image format; end the name in .png")
    return content.tobytes()


LABEL_HEIGHT_PX = 20


def draw_label_bar(text: str, width_px: int) -> NDArray[np.uint8]:
    """Draw a dark bar (`LABEL_HEIGHT_PX`, `width_px`, 3), BGR, with light text."""
    bar = np.full((LABEL_HEIGHT_PX, width_px, 3), 32, np.uint8)
    origin = (6, LABEL_HEIGHT_PX - 6)
    cv2.putText(bar, text, origin, cv2.FONT_HERSHEY_SIMPLEX, 0.45, (235,) * 3, 1, cv2.LINE_AA)
    return bar


H264_CONSTANT_RATE_FACTOR = "20"
"""Quality of H.264, 0 (lossless) to 51; text on labels is clean from about 20 down."""


class VideoWriter:
    """Writes an MP4 video image by image; the file appears when the context ends without error."""

    def __init__(self, path: Path, tick_s: float) -> None:
        """Prepare a video with an image per tick of `tick_s` seconds.

        Raises:
            InputError: PyAV is missing, or the file may not be replaced (on entering the context).
            RunError: The file cannot be written.
        """
        self._path = path
        self._rate = Fraction(1 / tick_s).limit_denominator(1000)

    def __enter__(self) -> Self:
        try:
            import av
        except ImportError as error:
            raise InputError(
                "videos need PyAV, which is not installed; try: pip install 'advercity[video]'"
            ) from error
        self._av = av
        with self._run_errors(), ExitStack() as output:
            self._partial = output.enter_context(open_output(self._path))
            self._container = av.open(str(self._partial), "w")
            self._output = output.pop_all()
        options = {"crf": H264_CONSTANT_RATE_FACTOR}
        self._stream = self._container.add_stream("libx264", rate=self._rate, options=options)
        self._stream.pix_fmt = "yuv420p"
        self._is_empty = True
        return self

    def append(self, image: NDArray[np.uint8]) -> None:
        """Append an image (h, w, 3), RGB; an odd row or column is cut off, a single one doubled."""
        # H.264 with halved colour resolution takes even sizes only.
        rows, columns = (max(size // 2 * 2, 2) for size in image.shape[:2])
        even = np.pad(image, ((0, 1), (0, 1), (0, 0)), mode="edge")[:rows, :columns]
        if self._is_empty:
            self._stream.height, self._stream.width = even.shape[:2]
            self._is_empty = False
        frame = self._av.VideoFrame.from_ndarray(np.ascontiguousarray(even), format="rgb24")
        with self._run_errors():
            self._container.mux(self._stream.encode(frame))

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        with self._run_errors(), self._output:
            if error is None:
                self._container.mux(self._stream.encode())
            self._container.close()
            if error is not None:
                self._partial.unlink(missing_ok=True)

    @contextmanager
    def _run_errors(self) -> Generator[None]:
        try:
            yield
        except OSError as error:  # PyAV raises system errors as OSError
            raise RunError(f"{self._path}: cannot be written: {describe_cause(error)}") from error
