"""The pieces of an export, each of which is whole or absent.

A format chooses its pieces: the files of one frame if every frame has files of its own, one
scenario if a file holds many frames, or the common files of all scenarios. The smaller the
pieces, the less is lost when an export is cut short.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, Self

from advercity.dataset.agent_view import MAX_IMAGE_BYTES, report_read_errors
from advercity.dataset.partial_files import FileRecord
from advercity.dataset.reader import Dataset, FrameView, Scenario
from advercity.documents import read_bytes

NAME_PATTERN = re.compile(r"[^./\\\0\ud800-\udfff][^/\\\0\ud800-\udfff]*")
"""Names of files and folders in an export: not hidden, and UTF-8, as its manifest is."""
PATH_PATTERN = re.compile(rf"({NAME_PATTERN.pattern}/)*{NAME_PATTERN.pattern}")
"""Paths of files in an export: relative, without `..`."""
FrameListener = Callable[[str], None]
"""Called with the name of a scenario when a frame of it is done."""


class JsonList:
    """Writes a list of JSON objects row by row, so it need not fit into memory.

    Args:
        stream: Output; the list begins at once, and ends with the context.
    """

    def __init__(self, stream: BinaryIO) -> None:
        self._stream, self._separator = stream, b""

    def append(self, row: Mapping[str, Any]) -> None:
        """Write a row."""
        text = json.dumps(row, separators=(",", ":"), allow_nan=False)
        self._stream.write(self._separator + text.encode())
        self._separator = b",\n"

    def __enter__(self) -> Self:
        self._stream.write(b"[\n")
        return self

    def __exit__(self, *error: object) -> None:
        self._stream.write(b"\n]")


class PieceFiles:
    """Collects the files of a piece in a folder; they are moved when all are there.

    Args:
        folder: The folder.
        on_frame: Called for each frame from `track` when it is done.
    """

    def __init__(self, folder: Path, on_frame: FrameListener) -> None:
        self._folder, self._on_frame = folder, on_frame
        self.records: dict[str, FileRecord] = {}

    def write(self, path: str, content: bytes | str) -> None:
        """Write a file, by its path within the export."""
        raw = content.encode() if isinstance(content, str) else content
        self._reserve(path).write_bytes(raw)
        self.records[path] = FileRecord.from_content(raw)

    def copy(self, source: Path, path: str) -> None:
        """Copy a file of the dataset; InputError if it is missing or cannot be read."""
        self.write(path, read_image_file(source))

    @contextmanager
    def open(self, path: str) -> Generator[BinaryIO]:
        """Open a file for writing bit by bit; it need not fit into memory."""
        target = self._reserve(path)
        with target.open("xb") as stream:
            yield stream
        with target.open("rb") as stream:
            digest = hashlib.file_digest(stream, "sha256").hexdigest()
        self.records[path] = FileRecord(size=target.stat().st_size, sha256=digest)

    @contextmanager
    def open_list(self, path: str) -> Generator[JsonList]:
        """Open a JSON file with a list, which is written row by row."""
        with self.open(path) as stream, JsonList(stream) as rows:
            yield rows

    def track(self, frames: Iterable[FrameView]) -> Iterator[FrameView]:
        """Iterate over frames, and report each when it is done."""
        for frame in frames:
            yield frame
            self._on_frame(frame.scenario.path.name)

    def _reserve(self, path: str) -> Path:
        assert PATH_PATTERN.fullmatch(path), path
        target = self._folder / path
        target.parent.mkdir(parents=True, exist_ok=True)
        assert not target.exists(), f"{path} is written twice"
        return target


def read_image_file(path: Path) -> bytes:
    """Read an image of the dataset; InputError if it is missing or cannot be read."""
    with report_read_errors(path):
        return read_bytes(path, max_bytes=MAX_IMAGE_BYTES)


@dataclass(frozen=True)
class Piece:
    """A part of an export, written at once.

    Attributes:
        name: Name, unique in the export.
        inputs: Checksum of its inputs; a piece with the same name and other inputs is made again.
        scenario: Name of its scenario; None if it is of all.
        frames: Number of frames in it.
        write: Writes its files.
        frame: Number of the frame whose files it is made from; None if it may be of all frames.
    """

    name: str
    inputs: str
    scenario: str | None
    frames: int
    write: Callable[[PieceFiles], None]
    frame: int | None = None


def split_by_frame(
    dataset: Dataset,
    write_frame: Callable[[FrameView, int, PieceFiles], None],
    *,
    count_samples: Callable[[Scenario], int] = lambda scenario: 1,
) -> list[Piece]:
    """Make a piece of every frame.

    Args:
        dataset: The dataset.
        write_frame: Writes the files of a frame, given the number of its first sample.
        count_samples: Counts the samples of a frame, numbered through the whole dataset from 0.
    """
    pieces: list[Piece] = []
    number = 0
    for scenario in dataset.scenarios:
        samples = count_samples(scenario) if len(scenario) else 0
        for position in range(len(scenario)):
            pieces.append(_build_frame_piece(scenario, position, number, write_frame))
            number += samples
    return pieces


def _build_frame_piece(
    scenario: Scenario,
    position: int,
    number: int,
    write_frame: Callable[[FrameView, int, PieceFiles], None],
) -> Piece:
    def write(files: PieceFiles) -> None:
        # Made here: a frame keeps the documents it has read.
        for frame in files.track([scenario[position]]):
            write_frame(frame, number, files)

    index = scenario.frame_numbers[position]
    name = scenario.path.name
    return Piece(f"{name} frame {index}", f"sample {number}", name, 1, write, frame=index)


def split_by_scenario(
    dataset: Dataset, write_scenario: Callable[[Scenario, PieceFiles], None]
) -> list[Piece]:
    """Make a piece of every scenario, whose frames come from `PieceFiles.track(scenario)`."""
    return [
        Piece(
            scenario.path.name,
            _describe_frames(scenario),
            scenario.path.name,
            len(scenario),
            lambda files, scenario=scenario: write_scenario(scenario, files),
        )
        for scenario in dataset.scenarios
        if len(scenario)
    ]


def make_common_piece(dataset: Dataset, name: str, write: Callable[[PieceFiles], None]) -> Piece:
    """Make a piece of common data of all scenarios, such as a table of all frames."""
    inputs = "; ".join(
        f"{scenario.path.name}: {_describe_frames(scenario)}" for scenario in dataset.scenarios
    )
    return Piece(name, hashlib.sha256(inputs.encode()).hexdigest(), None, 0, write)


def _describe_frames(scenario: Scenario) -> str:
    """Describe the frames of a scenario: `frames 0 to 199`, `frames 0, 10, 20`."""
    numbers = scenario.frame_numbers
    if numbers and numbers == tuple(range(numbers[0], numbers[-1] + 1)):
        return f"frames {numbers[0]} to {numbers[-1]}"
    return f"frames {', '.join(map(str, numbers))}"
