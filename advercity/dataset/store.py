"""A dataset in a store, such as a network folder or S3, and a run's lease on it.

A file in a store is complete or absent, even if the writing machine stops.

Stores have no locks that end with their owner, and machines have different clocks. So the owner of
a lease keeps rewriting the lease file; another run watches the file for a while, and takes the
dataset over if the file does not change.
"""

import os
import platform
import time
import uuid
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from threading import Event, Thread
from typing import Self

import fsspec

from advercity.atomic_files import move_file, write_file
from advercity.dataset.partial_files import PARTIAL_SUFFIX
from advercity.errors import InputError, RunError

INCOMING_FOLDER = ".staging/incoming"


class DatasetStore:
    """A folder by path or URL, through fsspec.

    Args:
        url: `/mnt/shared/dataset`, `s3://bucket/dataset`, ...

    Raises:
        InputError: No installed driver opens the URL.
    """

    def __init__(self, url: str) -> None:
        try:
            self._files, root = fsspec.url_to_fs(url)
        except (ValueError, ImportError) as error:
            raise InputError(f"`output` {url}: cannot be reached: {error}") from error
        self._url, self._root = url, root.rstrip("/")
        protocols = self._files.protocol
        names = (protocols,) if isinstance(protocols, str) else protocols
        # A rename replaces a file at once. Object stores have none, but their uploads are atomic.
        self._can_rename = "file" in names

    def read(self, path: str) -> bytes | None:
        """Read a file; None if it does not exist.

        Raises:
            RunError: The store does not answer.
        """
        with self._report_errors(f"{path} cannot be read"):
            try:
                return self._files.cat_file(self._absolute_path(path))
            except FileNotFoundError:
                return None

    def write(self, path: str, content: bytes) -> None:
        """Write a file; it is complete or absent at any moment.

        Raises:
            RunError: The store refuses it.
        """
        with self._report_errors(f"{path} cannot be written"):
            if self._can_rename:
                self._check_no_links(path)
                name = f"{INCOMING_FOLDER}/{uuid.uuid4().hex}{PARTIAL_SUFFIX}"
                incoming = Path(self._absolute_path(name))
                write_file(incoming, content)
                move_file(incoming, Path(self._absolute_path(path)))
            else:
                self._files.pipe_file(self._absolute_path(path), content)

    def create(self, path: str, content: bytes) -> bool:
        """Create a file; False if it exists already.

        Raises:
            RunError: The store refuses it.
        """
        with self._report_errors(f"{path} cannot be written"):
            try:
                if self._can_rename:
                    self._check_no_links(path)
                    target = Path(self._absolute_path(path))
                    target.parent.mkdir(parents=True, exist_ok=True)
                    with target.open("xb") as stream:
                        stream.write(content)
                else:
                    self._files.pipe_file(self._absolute_path(path), content, mode="create")
            except FileExistsError:
                if not self._files.isfile(self._absolute_path(path)):
                    raise
                return False
            return True

    def list_files(self, folder: str) -> list[str]:
        """List the paths of all files below a folder, sorted; empty if the folder does not exist.

        Raises:
            RunError: The store does not answer, or has no such bucket.
        """
        with self._report_errors(f"{folder or 'it'} cannot be listed"):
            self._files.invalidate_cache()  # fsspec would not show files of other machines
            found = self._files.find(self._absolute_path(folder).rstrip("/"))
        return sorted(path.removeprefix(f"{self._root}/") for path in found)

    def remove(self, folder: str) -> None:
        """Delete a file or a folder; do nothing if it does not exist.

        Raises:
            RunError: The store refuses it.
        """
        with self._report_errors(f"{folder} cannot be removed"):
            self._check_no_links(folder)
            if self._files.exists(self._absolute_path(folder)):
                self._files.rm(self._absolute_path(folder), recursive=True)

    def remove_partial_files(self) -> None:
        """Delete unfinished files of stopped processes.

        Raises:
            RunError: The store refuses it.
        """
        if self._can_rename:
            for path in self.list_files(INCOMING_FOLDER):
                if path.endswith(PARTIAL_SUFFIX):
                    self.remove(path)

    @contextmanager
    def _report_errors(self, what: str) -> Generator[None]:
        try:
            yield
        except Exception as error:  # drivers of stores share no base class of errors
            raise RunError(f"{self._url}: {what}: {error}") from error

    def _check_no_links(self, path: str) -> None:
        """Refuse to write or delete through a link to a folder; the root may be one."""
        if self._can_rename:
            inside = {*PurePosixPath(path).parents, *PurePosixPath(INCOMING_FOLDER, "x").parents}
            for folder in inside - {PurePosixPath()}:
                if Path(self._root, folder).is_symlink():
                    raise RunError(f"{folder} is a link; datasets are written in real folders only")

    def _absolute_path(self, path: str) -> str:
        return f"{self._root}/{path}"


LEASE_FILE = ".staging/lease"
LEASE_TIMEOUT_S = 20.0
"""How long a lease is respected without renewal."""


class DatasetLease:
    """The exclusive right to write a dataset, for one run; a context manager.

    Args:
        store: The store of the dataset.
        timeout_s: How long a lease lasts without renewal; this one is renewed four times as often.

    Raises:
        RunError: Another run has the lease (when the context is entered).
    """

    def __init__(self, store: DatasetStore, timeout_s: float = LEASE_TIMEOUT_S) -> None:
        self._store, self._timeout_s = store, timeout_s
        # The random part distinguishes runs where machines share names and process numbers.
        self._owner = f"{platform.node()} process {os.getpid()} {uuid.uuid4().hex}"
        self._renewals = 0
        self._over = Event()
        self._lost = False
        self._renewal_thread = Thread(target=self._renew_until_end, daemon=True)

    def __enter__(self) -> Self:
        if not self._store.create(LEASE_FILE, self._format()):
            self._take_over()
        self._store.remove_partial_files()  # before this process writes again
        self._renewal_thread.start()
        return self

    def __exit__(self, kind: object, error: object, traceback: object) -> None:
        # After the last renewal, or it would write the file again.
        self._over.set()
        self._renewal_thread.join()
        if not self._lost:
            self._store.remove(LEASE_FILE)

    def check(self) -> None:
        """Raise a RunError if another run may own the dataset, because a renewal took too long."""
        if self._lost:
            raise RunError(
                "the lease on the output ran out, and another run may have taken it over; run"
                " again when the other run has ended"
            )

    def _take_over(self) -> None:
        """Replace a lease after its owner has stopped renewing it."""
        found = self._store.read(LEASE_FILE)
        until_s = time.monotonic() + self._timeout_s
        while time.monotonic() < until_s:
            time.sleep(self._timeout_s / 20)
            if self._store.read(LEASE_FILE) != found:
                owner = (found or b"").decode().partition("\n")[0].rpartition(" ")[0]
                raise RunError(
                    f"another run is making this dataset ({owner or 'unknown process'}); wait for"
                    " it or choose another `output`"
                )
        self._store.write(LEASE_FILE, self._format())
        # Two runs may have replaced it at once; the later of them owns it.
        time.sleep(self._timeout_s / 20)
        if not self._is_owned_here():
            raise RunError("another run took the output at the same moment; wait for it")

    def _renew_until_end(self) -> None:
        """Renew the lease until the end; it is lost if the store does not answer for too long."""
        renewed_s = time.monotonic()
        while not self._over.wait(self._timeout_s / 4):
            try:
                if not self._is_owned_here():
                    break
                self._renewals += 1  # changes the file: other runs look for nothing else
                self._store.write(LEASE_FILE, self._format())
                renewed_s = time.monotonic()
            except RunError:
                if time.monotonic() - renewed_s > self._timeout_s:
                    break
        else:
            return
        self._lost = True

    def _is_owned_here(self) -> bool:
        return (self._store.read(LEASE_FILE) or b"").startswith(self._owner.encode())

    def _format(self) -> bytes:
        return f"{self._owner}\n{self._renewals}\n".encode()
