"""Films of a scenario, as MP4 by PyAV."""

from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from advercity.dataset import film
from advercity.dataset.manifest import scenarios
from advercity.dataset.reader import FrameView, Scenario
from advercity.errors import InputError, RunError

KINDS = ("front", "mosaic", "semantic", "lidar")
QUALITY = "20"
"""Constant rate factor of H.264: lower is better."""

Draw = Callable[[FrameView], NDArray[np.uint8]]


def write_videos(dataset: Path, output: Path, kinds: Sequence[str] = KINDS) -> list[Path]:
    """Film every scenario of a dataset; the files.

    `front` is one file per viewpoint, the others one per scenario.

    Raises:
        InputError: No such kind, no such dataset, or PyAV is not installed.
        RunError: A file cannot be written.
    """
    unknown = sorted(set(kinds) - set(KINDS))
    if unknown:
        raise InputError(f"--kind {unknown[0]}: no such film; {', '.join(KINDS)}")
    written: list[Path] = []
    for folder in scenarios(dataset):
        scenario = Scenario(folder)
        if not len(scenario):
            raise InputError(f"{folder}: no frames here")
        films = dict(_films(scenario, kinds))
        paths = {name: output / f"{folder.name}_{name}.mp4" for name in films}
        with ExitStack() as stack:
            tick_s = scenario.spec.timing.tick_s
            reels = {name: stack.enter_context(_Reel(path, tick_s)) for name, path in paths.items()}
            for frame in scenario:
                for name, draw in films.items():
                    reels[name].add(draw(frame))
        written += paths.values()
    return written


def _films(scenario: Scenario, kinds: Sequence[str]) -> Iterator[tuple[str, Draw]]:
    whole: dict[str, Draw] = {
        "mosaic": film.mosaic,
        "semantic": film.semantic,
        "lidar": film.from_above,
    }
    for kind in kinds:
        if kind == "front":
            for agent in scenario.agents:
                yield f"{agent}_front", lambda frame, agent=agent: film.front(frame[agent])
        else:
            yield kind, whole[kind]


class _Reel:
    """A film that is being written; it is there when its context ends well."""

    def __init__(self, path: Path, tick_s: float) -> None:
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
