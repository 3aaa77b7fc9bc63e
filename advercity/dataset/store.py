"""A dataset that lies anywhere: in a folder that machines share, or in an S3-like store.

A file in it is whole or absent, whoever dies while writing it.
"""

import uuid
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

import fsspec

from advercity.errors import InputError, RunError

INCOMING = ".staging/incoming"


class Store:
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
        self._renames = "file" in names

    def read(self, path: str) -> bytes | None:
        """A file's content; None if it is not there.

        Raises:
            RunError: The store does not answer.
        """
        with self._failures_told(f"{path} cannot be read"):
            try:
                return self._files.cat_file(self._at(path))
            except FileNotFoundError:
                return None

    def write(self, path: str, content: bytes) -> None:
        """Put a file in its place at once.

        Raises:
            RunError: The store does not take it.
        """
        with self._failures_told(f"{path} cannot be written"):
            if self._renames:
                self._write_and_rename(path, content)
            else:
                self._files.pipe_file(self._at(path), content)

    def create(self, path: str, content: bytes) -> bool:
        """Put a file in its place unless there is one; whether there was none.

        Raises:
            RunError: The store does not take it.
        """
        with self._failures_told(f"{path} cannot be written"):
            try:
                if self._renames:
                    self._files.makedirs(self._at(path).rpartition("/")[0], exist_ok=True)
                    with Path(self._at(path)).open("xb") as stream:
                        stream.write(content)
                else:
                    self._files.pipe_file(self._at(path), content, mode="create")
            except FileExistsError:
                if not self._files.isfile(self._at(path)):
                    raise
                return False
            return True

    def paths(self, folder: str) -> list[str]:
        """Paths of all files below a folder, sorted; none if it is not there.

        Raises:
            RunError: The store does not answer, or has no such bucket.
        """
        with self._failures_told(f"{folder or 'it'} cannot be listed"):
            self._files.invalidate_cache()
            found = self._files.find(self._at(folder).rstrip("/"))
        return sorted(path.removeprefix(f"{self._root}/") for path in found)

    def remove(self, folder: str) -> None:
        """Remove a file, or a folder with all that is in it; or nothing if it is not there.

        Raises:
            RunError: The store does not let go of it.
        """
        with self._failures_told(f"{folder} cannot be removed"):
            if self._files.exists(self._at(folder)):
                self._files.rm(self._at(folder), recursive=True)

    def upload(self, folder: Path, path: str, target: str) -> None:
        """Put `folder/path` at `target/path`."""
        self.write(f"{target}/{path}", (folder / path).read_bytes())

    @contextmanager
    def _failures_told(self, what: str) -> Generator[None]:
        """Drivers raise what they like."""
        try:
            yield
        except Exception as error:
            raise RunError(f"{self._url}: {what}: {error}") from error

    def _write_and_rename(self, path: str, content: bytes) -> None:
        incoming, target = self._at(f"{INCOMING}/{uuid.uuid4().hex}"), self._at(path)
        for place in (incoming, target):
            self._files.makedirs(place.rpartition("/")[0], exist_ok=True)
        self._files.pipe_file(incoming, content)
        Path(incoming).replace(target)

    def _at(self, path: str) -> str:
        return f"{self._root}/{path}"
