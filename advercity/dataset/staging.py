"""What writing safely takes: one writer at a time, whole files by renaming, failures by name."""

import fcntl
import os
import time
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from advercity.errors import RunError

PATIENCE_S = 5.0
"""For one who was killed to let go of what it held."""


@contextmanager
def failures_named(path: Path) -> Generator[None]:
    """Turn failures of the disk into a RunError that says where; `path` if the system does not."""
    try:
        yield
    except OSError as error:
        raise RunError(
            f"{error.filename or path}: {error.strerror}; what is done stays: make room or choose"
            " another --output, and run again"
        ) from error


def lock(path: Path, what: str = "this scenario") -> IO[bytes]:
    """Hold `path` until the stream is closed or the process ends; RunError if somebody else does.

    A run that was killed may take a moment to let go. Whoever held it may have deleted it since it
    was opened here, hence the second look.
    """
    patient_until_s = time.monotonic() + PATIENCE_S
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


def write(path: Path, content: bytes) -> None:
    """Write a file, making its folder."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)


def move(source: Path, target: Path) -> None:
    """Put a file in its place at once, making its folder."""
    target.parent.mkdir(parents=True, exist_ok=True)
    source.replace(target)
