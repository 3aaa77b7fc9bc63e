"""Adds frames to a scenario that is open, so that a frame is whole or absent whatever happens.

A frame's files are written into staging and renamed into place when all of them are there; then
one write to the journal says so.
"""

from collections.abc import Sequence
from pathlib import Path

from advercity_dsl import Spec

from advercity.dataset.formats import format_called, frame_name
from advercity.dataset.journal import FileRecord, append_to_journal, staging_of
from advercity.dataset.reading import Reading
from advercity.dataset.staging import failures_named, move, write
from advercity.world.roads import built


class FrameWriter:
    """One of the processes that write frames of a scenario, which a `DatasetWriter` has open.

    Args:
        scenario: Its folder.
        spec: What is written.
        format: In which layout.
        process: Number of the process among those that write frames of the scenario.
    """

    def __init__(self, scenario: Path, spec: Spec, format: str, process: int = 0) -> None:
        self._scenario, self._spec, self._process = scenario, spec, process
        self._encode = format_called(format).encode
        self._lanes = built(spec.road).lanes
        self._staging = staging_of(scenario)
        self._size_bytes = 0

    @property
    def size_bytes(self) -> int:
        """Of the files that were written here; may be asked for while another thread writes."""
        return self._size_bytes

    def claim(self, frame: int) -> bool:
        """Whether this process shall make a frame: the first that asks, and no other."""
        with failures_named(self._scenario):
            try:
                (self._staging / "claims" / str(frame)).mkdir(parents=True)
            except FileExistsError:
                return False
        return True

    def write(self, frame: int, readings: Sequence[Reading]) -> None:
        """Add a frame: the readings of all viewpoints.

        Raises:
            RunError: The disk does not take it; the frame is absent then.
        """
        incoming = self._staging / "incoming" / str(self._process)
        files = self._encode(readings, self._lanes, name=frame_name(self._spec, frame))
        with failures_named(self._scenario):
            for path, content in files.items():
                write(incoming / path, content)
            for path in files:
                move(incoming / path, self._scenario / path)
            records = {path: FileRecord.of(content, frame=frame) for path, content in files.items()}
            append_to_journal(self._scenario, self._process, records)
        self._size_bytes += sum(record.size for record in records.values())
