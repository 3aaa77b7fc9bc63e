"""A dataset that lies anywhere: in a folder that machines share, or in an S3-like store.

A file in it is whole or absent, whoever dies while writing it.

Keeps two runs from making one dataset in a store at a time.

Stores have no locks that end with their holder, and machines have clocks of their own. So whoever
holds a dataset keeps rewriting a file in it; who finds such a file watches it for a while, and
takes over if it stays as it is.
"""

import os
import platform
import time
import uuid
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from threading import Event, Thread
from types import TracebackType
from typing import Self

import fsspec

from advercity.errors import InputError, RunError

INCOMING_FOLDER = ".staging/incoming"


class DatasetStore:
    """A folder, by path or URL, as fsspec reaches it.

    Args:
        url: `/mnt/shared/dataset`, `s3://bucket/dataset`, ...

    Raises:
        InputError: Nothing here can reach it.
    """

    def __init__(self, url: str) -> None:
        try:
            self._files, root = fsspec.url_to_fs(url)
        except (ValueError, ImportError) as error:
            raise InputError(f"--output {url}: cannot be reached: {error}") from error
        self._url, self._root = url, root.rstrip("/")
        protocols = self._files.protocol
        names = (protocols,) if isinstance(protocols, str) else protocols
        self._can_rename = "file" in names

    def read(self, path: str) -> bytes | None:
        """A file's content; None if it is not there.

        Raises:
            RunError: The store does not answer.
        """
        with self._report_errors(f"{path} cannot be read"):
            try:
                return self._files.cat_file(self._absolute_path(path))
            except FileNotFoundError:
                return None

    def write(self, path: str, content: bytes) -> None:
        """Put a file in its place at once.

        Raises:
            RunError: The store does not take it.
        """
        with self._report_errors(f"{path} cannot be written"):
            if self._can_rename:
                self._write_and_rename(path, content)
            else:
                self._files.pipe_file(self._absolute_path(path), content)

    def create(self, path: str, content: bytes) -> bool:
        """Put a file in its place unless there is one; whether there was none.

        Raises:
            RunError: The store does not take it.
        """
        with self._report_errors(f"{path} cannot be written"):
            try:
                if self._can_rename:
                    self._files.makedirs(
                        self._absolute_path(path).rpartition("/")[0], exist_ok=True
                    )
                    with Path(self._absolute_path(path)).open("xb") as stream:
                        stream.write(content)
                else:
                    self._files.pipe_file(self._absolute_path(path), content, mode="create")
            except FileExistsError:
                if not self._files.isfile(self._absolute_path(path)):
                    raise
                return False
            return True

    def list_files(self, folder: str) -> list[str]:
        """Paths of all files below a folder, sorted; none if it is not there.

        Raises:
            RunError: The store does not answer, or has no such bucket.
        """
        with self._report_errors(f"{folder or 'it'} cannot be listed"):
            self._files.invalidate_cache()
            found = self._files.find(self._absolute_path(folder).rstrip("/"))
        return sorted(path.removeprefix(f"{self._root}/") for path in found)

    def remove(self, folder: str) -> None:
        """Remove a file, or a folder with all that is in it; or nothing if it is not there.

        Raises:
            RunError: The store does not let go of it.
        """
        with self._report_errors(f"{folder} cannot be removed"):
            if self._files.exists(self._absolute_path(folder)):
                self._files.rm(self._absolute_path(folder), recursive=True)

    def upload(self, folder: Path, path: str, target: str) -> None:
        """Put `folder/path` at `target/path`."""
        self.write(f"{target}/{path}", (folder / path).read_bytes())

    @contextmanager
    def _report_errors(self, what: str) -> Generator[None]:
        """Drivers raise what they like."""
        try:
            yield
        except Exception as error:
            raise RunError(f"{self._url}: {what}: {error}") from error

    def _write_and_rename(self, path: str, content: bytes) -> None:
        incoming, target = (
            self._absolute_path(f"{INCOMING_FOLDER}/{uuid.uuid4().hex}"),
            self._absolute_path(path),
        )
        for place in (incoming, target):
            self._files.makedirs(place.rpartition("/")[0], exist_ok=True)
        self._files.pipe_file(incoming, content)
        Path(incoming).replace(target)

    def _absolute_path(self, path: str) -> str:
        return f"{self._root}/{path}"


LEASE_FILE = ".staging/lease"
LEASE_TIMEOUT_S = 20.0
"""How long a lease that nobody renews is respected."""


class DatasetLease:
    """A dataset that is ours until the end; a context manager.

    Args:
        store: The dataset.
        patience_s: For one who has died to show no sign of life; it is renewed four times as often.
    """

    def __init__(self, store: DatasetStore, patience_s: float = LEASE_TIMEOUT_S) -> None:
        self._store, self._timeout_s = store, patience_s
        self._holder = f"{platform.node()} process {os.getpid()} {uuid.uuid4().hex}"
        self._renewals = 0
        self._over = Event()
        self._lost = False
        self._renewal_thread = Thread(target=self._renew_until_end, daemon=True)

    def __enter__(self) -> Self:
        """Take it; RunError if somebody else has it."""
        if not self._store.create(LEASE_FILE, self._format()):
            self._take_over()
        self._renewal_thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._over.set()
        self._renewal_thread.join()
        if not self._lost:
            self._store.remove(LEASE_FILE)

    def check(self) -> None:
        """RunError if the dataset may be somebody else's: run or store stood still for too long."""
        if self._lost:
            raise RunError(
                "the lease on the output ran out, and another run may have taken it over; run again"
                " when that is done"
            )

    def _take_over(self) -> None:
        """Take over from one who shows no sign of life."""
        found = self._store.read(LEASE_FILE)
        until_s = time.monotonic() + self._timeout_s
        while time.monotonic() < until_s:
            time.sleep(self._timeout_s / 20)
            if self._store.read(LEASE_FILE) != found:
                who = (found or b"somebody").decode().partition("\n")[0].rpartition(" ")[0]
                raise RunError(
                    f"another run is making this dataset ({who or 'somebody'}); wait for it or"
                    " choose another --output"
                )
        self._store.write(LEASE_FILE, self._format())
        time.sleep(self._timeout_s / 20)
        if not self._is_held_here():
            raise RunError("another run took the output at the same moment; wait for it")

    def _renew_until_end(self) -> None:
        """Renew it until the end; a store that is silent for too long has lost it for us."""
        renewed_s = time.monotonic()
        while not self._over.wait(self._timeout_s / 4):
            try:
                if not self._is_held_here():
                    break
                self._renewals += 1
                self._store.write(LEASE_FILE, self._format())
                renewed_s = time.monotonic()
            except RunError:
                if time.monotonic() - renewed_s > self._timeout_s:
                    break
        else:
            return
        self._lost = True

    def _is_held_here(self) -> bool:
        return (self._store.read(LEASE_FILE) or b"").startswith(self._holder.encode())

    def _format(self) -> bytes:
        return f"{self._holder}\n{self._renewals}\n".encode()
