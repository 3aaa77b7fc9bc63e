"""Films of a scenario, as MP4 by PyAV."""

from collections.abc import Callable, Iterator, Sequence
from fractions import Fraction
from pathlib import Path

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
        for name, draw in _films(scenario, kinds):
            path = output / f"{folder.name}_{name}.mp4"
            _write(path, (draw(frame) for frame in scenario), tick_s=scenario.spec.timing.tick_s)
            written.append(path)
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


def _write(path: Path, images: Iterator[NDArray[np.uint8]], *, tick_s: float) -> None:
    try:
        import av
        from av.error import FFmpegError
    except ImportError as error:
        raise InputError(
            "films take PyAV, which is not installed; try: pip install 'advercity[video]'"
        ) from error
    partial = path.with_suffix(".partial.mp4")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with av.open(str(partial), "w") as container:
            rate = Fraction(1 / tick_s).limit_denominator(1000)
            stream = container.add_stream("libx264", rate=rate, options={"crf": QUALITY})
            stream.pix_fmt = "yuv420p"
            for number, image in enumerate(images):
                even = image[: image.shape[0] // 2 * 2, : image.shape[1] // 2 * 2]
                if number == 0:
                    stream.height, stream.width = even.shape[:2]
                frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(even), format="rgb24")
                container.mux(stream.encode(frame))
            container.mux(stream.encode())
        partial.replace(path)
    except (OSError, FFmpegError) as error:
        raise RunError(f"{path}: cannot be written: {error.strerror}") from error
    finally:
        partial.unlink(missing_ok=True)
