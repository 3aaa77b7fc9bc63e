"""Opens a scenario for writing, and leaves it with a manifest that tells what is there.

Frames come from `FrameWriter`s, here and in other processes. Whoever opens the scenario next adds
the journals of those that were cut short to the manifest, and removes what none of them knows.
"""

import shutil
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Self

from advercity_dsl import Spec

from advercity.dataset.beside_frames import beside_frames
from advercity.dataset.formats import frame_name
from advercity.dataset.frame_writer import FrameWriter
from advercity.dataset.journal import FileRecord, read_journal, remove_journal, staging_of
from advercity.dataset.manifest import MANIFEST, Identity, Manifest
from advercity.dataset.reading import Reading
from advercity.dataset.staging import failures_named, lock, move, write
from advercity.errors import RunError


class DatasetWriter:
    """The one who has a scenario open; a context manager.

    Opening it finds what is already done; closing it, also after an error, writes the manifest.
    Every failure of the disk is a RunError that names the path.

    Args:
        root: Folder of the dataset; the scenario goes into `root/<spec id>`.
        spec: What is written.
        identity: What decides the bytes; data of another identity are not continued.
        length: Frames of the whole scenario.
        fresh: Start over, whatever is there.

    Raises:
        RunError: Another run is writing, the data there are of another identity, or the folder
            holds something that is not a dataset.
    """

    def __init__(
        self,
        root: Path,
        spec: Spec,
        identity: Identity,
        *,
        length: int,
        fresh: bool = False,
    ) -> None:
        self.scenario = root / spec.id
        self._staging = staging_of(self.scenario)
        self._incoming = self._staging / "incoming"
        self._spec = spec
        self._identity = identity
        self._length = length
        self._fresh = fresh
        self._frames = FrameWriter(self.scenario, spec, identity.format)
        self._files: dict[str, FileRecord] = {}
        self._done: set[int] = set()
        self._size_bytes = 0

    @property
    def done(self) -> frozenset[int]:
        """Frames that need not be written."""
        return frozenset(self._done)

    @property
    def size_bytes(self) -> int:
        """Of all files that were there or are written here; also while another thread writes."""
        return self._size_bytes + self._frames.size_bytes

    @property
    def lock(self) -> int:
        """File descriptor; whichever process has it open keeps others from the scenario."""
        return self._lock.fileno()

    def __enter__(self) -> Self:
        with failures_named(self.scenario):
            self._lock = lock(self._staging / "lock")
            try:
                self._open()
            except BaseException:
                self._lock.close()
                raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        try:
            if error is not None:
                with suppress(RunError):
                    self.finish()
        finally:
            self._lock.close()

    def claim(self, frame: int) -> bool:
        """Whether this process shall make a frame: the first that asks, and no other."""
        return self._frames.claim(frame)

    def write(self, frame: int, readings: Sequence[Reading]) -> None:
        """Add a frame: the readings of all viewpoints.

        Raises:
            RunError: The disk does not take it; the frame is absent then.
        """
        self._frames.write(frame, readings)
        self._done.add(frame)

    def finish(self) -> Manifest:
        """Bring the manifest up to date and clear up; after an error it happens by itself."""
        with failures_named(self.scenario):
            self._files |= read_journal(self.scenario)
            self._sweep()
            manifest = self._save()
            shutil.rmtree(self._staging)
            with suppress(OSError):  # another scenario is being written
                self._staging.parent.rmdir()
        return manifest

    def _open(self) -> None:
        if self._fresh:
            self._clear()
        self._files = self._recall()
        self._sweep()
        beside = beside_frames(self._spec, self._identity)
        self._files |= {path: FileRecord.of(content) for path, content in beside.items()}
        self._size_bytes = sum(record.size for record in self._files.values())
        self._save()
        for path, content in beside.items():
            self._replace(path, content)

    def _clear(self) -> None:
        self._check_it_is_ours()
        remove_journal(self.scenario)
        if self.scenario.exists():
            for path in self.scenario.iterdir():
                if path.is_dir():
                    shutil.rmtree(path)
                elif path.name != MANIFEST:
                    path.unlink()
            (self.scenario / MANIFEST).unlink(missing_ok=True)

    def _check_it_is_ours(self) -> None:
        """So that no mistyped output folder is emptied or mixed into a dataset."""
        foreign = self.scenario.exists() and any(self.scenario.iterdir())
        if foreign and not (self.scenario / MANIFEST).exists():
            raise RunError(
                f"{self.scenario}: holds files but no {MANIFEST}, so not a dataset;"
                " delete it, or choose another --output"
            )

    def _recall(self) -> dict[str, FileRecord]:
        """Records of the frames that are done and wholly there."""
        self._check_it_is_ours()
        if not (self.scenario / MANIFEST).exists():
            return {}
        manifest = Manifest.load(self.scenario)
        differences = manifest.identity.differences(self._identity)
        if differences:
            raise RunError(
                f"{self.scenario}: made from something else ({'; '.join(differences)});"
                " --fresh starts over, another --output leaves it alone"
            )
        damaged = {
            record.frame
            for path, record in manifest.files.items()
            if not self._is_there(path, record)
        }
        again = damaged | {None}
        return {
            path: record for path, record in manifest.files.items() if record.frame not in again
        }

    def _is_there(self, path: str, record: FileRecord) -> bool:
        try:
            return (self.scenario / path).stat().st_size == record.size
        except FileNotFoundError:
            return False

    def _sweep(self) -> None:
        """Remove what is left of frames that are not done, and of making them."""
        self._done = {file.frame for file in self._files.values() if file.frame is not None}
        absent = {frame_name(self._spec, k) for k in set(range(self._length)) - self._done}
        for path in self.scenario.glob("*/[0-9]*"):
            if path.name[:6] in absent and path.is_file():
                path.unlink()
        for folder in (self._incoming, self._staging / "claims"):
            if folder.exists():
                shutil.rmtree(folder)

    def _save(self) -> Manifest:
        manifest = Manifest.of(self._identity, self._spec, length=self._length, files=self._files)
        self._replace(MANIFEST, manifest.to_json().encode())
        remove_journal(self.scenario)
        return manifest

    def _replace(self, path: str, content: bytes) -> None:
        write(self._incoming / path, content)
        move(self._incoming / path, self.scenario / path)
