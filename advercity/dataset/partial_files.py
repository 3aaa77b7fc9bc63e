"""Staging beside a scenario, and in it the journals of frames done since the last manifest.

`OUTPUT/.staging/<spec id>` lies outside the scenario because readers of OPV2V take every folder
in a scenario for a viewpoint. Each process that writes frames has a journal of its own.

What writing safely takes: one writer at a time, whole files by renaming, failures by name.
"""

import errno
import hashlib
import os
import time
from collections.abc import Generator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from advercity_dsl import Model
from pydantic import TypeAdapter, ValidationError

from advercity.dataset.scenario_folders import find_journals, find_staging_folder
from advercity.errors import RunError


class FileRecord(Model):
    """A file as it was written; `frame` is None for files that belong to the whole scenario."""

    size: int
    sha256: str
    frame: int | None = None

    @staticmethod
    def from_content(content: bytes, *, frame: int | None = None) -> "FileRecord":
        """Record of a file with this content."""
        return FileRecord(
            size=len(content), sha256=hashlib.sha256(content).hexdigest(), frame=frame
        )


_RECORDS = TypeAdapter(dict[str, FileRecord])


def append_to_journal(scenario: Path, process: int, records: Mapping[str, FileRecord]) -> None:
    """Note that these files, by path, are in place.

    It is one write: if the process is killed the line is whole, or torn and the last.

    Args:
        scenario: Whose files they are.
        process: Whose journal it is, by number.
        records: Of the files.
    """
    line = _RECORDS.dump_json(dict(records), exclude_none=True) + b"\n"
    path = find_staging_folder(scenario) / f"journal_{process}.jsonl"
    with path.open("ab", buffering=0) as stream:
        if stream.write(line) != len(line):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))


def read_journals(scenario: Path) -> dict[str, FileRecord]:
    """Records of all whole lines of all processes, by path; empty if nothing is noted."""
    records: dict[str, FileRecord] = {}
    for path in find_journals(scenario):
        with suppress(FileNotFoundError, ValidationError):  # finished meanwhile; torn at its end
            for line in path.read_bytes().splitlines():
                records |= _RECORDS.validate_json(line)
    return records


def remove_journals(scenario: Path) -> None:
    """Forget what has been noted."""
    for path in find_journals(scenario):
        path.unlink()


LOCK_TIMEOUT_S = 5.0
"""For one who was killed to let go of what it held."""


@contextmanager
def report_disk_errors(path: Path) -> Generator[None]:
    """Turn failures of the disk into a RunError that says where; `path` if the system does not."""
    try:
        yield
    except OSError as error:
        raise RunError(
            f"{error.filename or path}: {error.strerror}; what is done stays: make room or choose"
            " another --output, and run again"
        ) from error


def lock_file(path: Path, what: str = "this scenario") -> IO[bytes]:
    """Hold `path` until the stream is closed or the process ends; RunError if somebody else does.

    A run that was killed may take a moment to let go. Whoever held it may have deleted it since it
    was opened here, hence the second look.
    """
    import fcntl  # POSIX only; reading a dataset, which imports this module, works without

    patient_until_s = time.monotonic() + LOCK_TIMEOUT_S
    while True:
        path.parent.mkdir(parents=True, exist_ok=True)
        stream = path.open("ab")
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            stream.close()
            if time.monotonic() < patient_until_s:
                time.sleep(0.05)
                continue
            raise RunError(
                f"{path.parent}: another run is writing {what}; wait for it or choose"
                " another --output"
            ) from error
        if path.exists() and os.path.samestat(os.fstat(stream.fileno()), path.stat()):
            return stream
        stream.close()


def write_file(path: Path, content: bytes) -> None:
    """Write a file, making its folder."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)


def move_file(source: Path, target: Path) -> None:
    """Put a file in its place at once, making its folder."""
    target.parent.mkdir(parents=True, exist_ok=True)
    source.replace(target)
