"""A film, written picture by picture as MP4 by PyAV."""

from collections.abc import Generator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from advercity.errors import InputError, RunError

QUALITY = "20"
"""Constant rate factor of H.264: lower is better."""


class Reel:
    """A film that is being written; it is there when its context ends well."""

    def __init__(self, path: Path, tick_s: float) -> None:
        """A film with a picture per tick.

        Raises:
            InputError: PyAV is not installed (when the context is entered).
            RunError: The file cannot be written.
        """
        self._path = path
        self._partial = path.with_suffix(".partial.mp4")
        self._rate = Fraction(1 / tick_s).limit_denominator(1000)

    def __enter__(self) -> Self:
        try:
            import av
        except ImportError as error:
            raise InputError(
                "films take PyAV, which is not installed; try: pip install 'advercity[video]'"
            ) from error
        self._av = av
        with self._failures_named():
            self._path.parent.mkdir(parents=True, exist_ok=True)
            self._container = av.open(str(self._partial), "w")
        options = {"crf": QUALITY}
        self._stream = self._container.add_stream("libx264", rate=self._rate, options=options)
        self._stream.pix_fmt = "yuv420p"
        self._is_empty = True
        return self

    def add(self, image: NDArray[np.uint8]) -> None:
        """Append a picture (h, w, 3); an odd row or column is left out."""
        even = image[: image.shape[0] // 2 * 2, : image.shape[1] // 2 * 2]
        if self._is_empty:
            self._stream.height, self._stream.width = even.shape[:2]
            self._is_empty = False
        frame = self._av.VideoFrame.from_ndarray(np.ascontiguousarray(even), format="rgb24")
        with self._failures_named():
            self._container.mux(self._stream.encode(frame))

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        try:
            with self._failures_named():
                if error is None:
                    self._container.mux(self._stream.encode())
                self._container.close()
                if error is None:
                    self._partial.replace(self._path)
        finally:
            self._partial.unlink(missing_ok=True)

    @contextmanager
    def _failures_named(self) -> Generator[None]:
        try:
            yield
        except OSError as error:  # PyAV's errors of the system are OSErrors, too
            raise RunError(f"{self._path}: cannot be written: {error.strerror}") from error
