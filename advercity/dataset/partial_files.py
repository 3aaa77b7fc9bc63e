"""Safe writing: unfinished files in a staging folder, journals of frames, one writer at a time.

A frame's files are written to `OUTPUT/.staging/<spec id>` and renamed into the scenario when all of
them are complete. Each process has its own journal; with the manifest they survive a killed run.
"""

import errno
import hashlib
import logging
import os
import re
import stat
import time
from collections.abc import Generator, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Annotated

from advercity_dsl import Model
from advercity_dsl.base import Digest
from pydantic import AfterValidator, Field, TypeAdapter, ValidationError

from advercity.atomic_files import move_file, open_without_links, sync_files, write_file
from advercity.dataset.scenario_folders import (
    check_folders_are_no_links,
    find_journals,
    find_staging_folder,
)
from advercity.documents import MAX_JSON_BYTES, parse_json, read_bytes
from advercity.errors import InputError, RunError, describe_cause, escape_control_characters

_logger = logging.getLogger(__name__)

PARTIAL_SUFFIX = ".advercity-partial"
"""End of the names of unfinished files, absent from all foreign names."""
KEPT_SUFFIX = ".kept"
"""End of the new names of foreign files in the way of a run's own."""
_ERRORS_OF_FULL_DISKS = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
NO_FILE_ERRORS = (FileNotFoundError, IsADirectoryError, NotADirectoryError)
MAX_LISTED_FILES = 3
"""Most files named by a message."""
LOCK_TIMEOUT_S = 5.0
"""How long a killed run may take to release its lock."""
KILLED_WORKERS_S = 1.0
"""How long the workers of a killed run may take to end."""


class FileRecord(Model):
    """Size and checksum of a written file.

    Attributes:
        size: Size in bytes.
        sha256: Checksum of the content.
        frame: Number of the frame; None for files of the whole scenario.
    """

    size: int
    sha256: Digest
    frame: int | None = Field(default=None, ge=0)

    @staticmethod
    def from_content(content: bytes, *, frame: int | None = None) -> "FileRecord":
        """Record a file with this content."""
        return FileRecord(
            size=len(content), sha256=hashlib.sha256(content).hexdigest(), frame=frame
        )

    def has_size_of(self, path: Path) -> bool:
        """Return whether a path is a regular file of this size; OSError if it cannot be read."""
        found = path.stat()  # to open a pipe would wait for its writer, and devices have no end
        return stat.S_ISREG(found.st_mode) and found.st_size == self.size

    def has_content(self, content: bytes) -> bool:
        """Return whether this is the recorded content."""
        return hashlib.sha256(content).hexdigest() == self.sha256

    def matches(self, path: Path) -> bool:
        """Return whether the file at a path has this content; OSError if it cannot be read."""
        if not self.has_size_of(path):  # needs no reading
            return False
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest() == self.sha256


def _check_path(path: str) -> str:
    if not re.fullmatch(r"([^./\\\0][^/\\\0]*/)?[^./\\\0][^/\\\0]*", path):
        raise ValueError(f"{path!r:.60} is no path within the scenario")
    return path


FilePath = Annotated[str, AfterValidator(_check_path)]
"""Path of a file in the scenario, or in a folder of it."""
_Records = dict[FilePath, FileRecord]
_RECORDS = TypeAdapter(_Records)
_UNMOVED_RECORDS = TypeAdapter(tuple[_Records])
"""A list of one: brackets mark records of files possibly not yet in place."""


def append_to_journal(
    scenario: Path, process: int, records: Mapping[str, FileRecord], *, moved: bool
) -> Path:
    """Append records of files, moved or to be moved, to a process's journal; return its path."""
    content = _RECORDS.dump_json(dict(records), exclude_none=True)
    line = (content if moved else b"[%b]" % content) + b"\n"
    path = find_staging_folder(scenario) / f"journal_{process}.jsonl"
    # One write without a buffer: if the process is killed the line is whole, or torn and the last.
    with open(path, "ab", buffering=0, opener=open_without_links) as stream:
        if stream.write(line) != len(line):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
    return path


def read_journals(scenario: Path, *, moved: bool = True) -> dict[str, FileRecord]:
    """Read the records of all whole lines of all journals, by path; empty without journals.

    Args:
        scenario: Folder of the scenario.
        moved: Only files already in place; else also files possibly still to be moved.

    Raises:
        RunError: A journal cannot be read.
    """
    records: dict[str, FileRecord] = {}
    for path in find_journals(scenario):
        # The run has finished, or the last line is torn.
        with suppress(FileNotFoundError, InputError, ValidationError):
            for line in _read_journal(path).splitlines():
                entry = parse_json(line, path)
                if not isinstance(entry, list):
                    records |= _RECORDS.validate_python(entry)
                elif not moved:
                    (unmoved,) = _UNMOVED_RECORDS.validate_python(entry)
                    records |= unmoved
    return records


def _read_journal(path: Path) -> bytes:
    try:
        return read_bytes(path, max_bytes=MAX_JSON_BYTES)
    except FileNotFoundError:
        raise
    except OSError as error:
        raise RunError(f"{path}: cannot be read: {describe_cause(error)}") from error


def remove_journals(scenario: Path) -> None:
    """Delete all journals of a scenario."""
    for path in find_journals(scenario):
        path.unlink()


def remove_unfinished_files(scenario: Path, paths: Sequence[str]) -> None:
    """Delete files of frames left by an interrupted run, and say so."""
    for path in paths:
        (scenario / path).unlink()
    if paths:
        count = format_file_count(len(paths))
        _logger.warning("%s: %s of incomplete frames removed", scenario, count)


def set_aside(scenario: Path, paths: Iterable[str]) -> None:
    """Rename the files at these paths, if any, since no manifest has them as they are; say so."""
    files = [path for path in sorted(paths) if _is_file(scenario / path)]
    kept = [_rename_to_keep(scenario, path) for path in files]
    if kept:
        names = ", ".join(map(escape_control_characters, kept[:MAX_LISTED_FILES]))
        more = f" and {len(kept) - MAX_LISTED_FILES} more" if len(kept) > MAX_LISTED_FILES else ""
        count = format_file_count(len(kept))
        _logger.warning(
            "%s: %s not as the manifest has them, kept as %s%s", scenario, count, names, more
        )


def _is_file(path: Path) -> bool:
    """Return whether a path is a file of any kind, or a link to anything."""
    return os.path.lexists(path) and (path.is_symlink() or not path.is_dir())


def _rename_to_keep(scenario: Path, path: str) -> str:
    number = 0
    while True:
        kept = f"{path}{KEPT_SUFFIX}{number or ''}"
        try:
            # Reserves the name: renaming would replace a file created after a mere look.
            (scenario / kept).touch(exist_ok=False)
        except FileExistsError:
            number += 1
        else:
            (scenario / path).replace(scenario / kept)
            return kept


def list_matching_files(
    scenario: Path, paths: Iterable[str], records: Mapping[str, FileRecord]
) -> list[str]:
    """List the paths whose files have the content of their records.

    Raises:
        RunError: A file cannot be read.
    """

    def matches(path: str) -> bool:
        try:
            return records[path].matches(scenario / path)
        except NO_FILE_ERRORS:
            return False
        except OSError as error:
            raise RunError(f"{scenario / path}: cannot be read: {describe_cause(error)}") from error

    recorded = [path for path in paths if path in records]
    # Reading and SHA-256 both release the interpreter lock.
    with ThreadPoolExecutor() as pool:
        same = pool.map(matches, recorded)
        return [path for path, is_same in zip(recorded, same, strict=True) if is_same]


def format_file_count(count: int) -> str:
    """Format a number of files: `1 file`, `3 files`."""
    return f"{count} file{'' if count == 1 else 's'}"


def find_partial_file(scenario: Path, path: str) -> Path:
    """Find the temporary path of a file with the final path `path` in the scenario."""
    return find_staging_folder(scenario) / "incoming" / f"{path}{PARTIAL_SUFFIX}"


def remove_partial_files(scenario: Path) -> None:
    """Delete the unfinished files and the claims of a scenario; foreign files stay."""
    staging = find_staging_folder(scenario)
    incoming, claims = staging / "incoming", staging / "claims"
    for path in incoming.rglob(f"*{PARTIAL_SUFFIX}"):
        if not path.is_dir():
            path.unlink()
    for folder in (*sorted(incoming.rglob("*/"), reverse=True), *claims.glob("*/")):
        with suppress(OSError):  # not empty, or a link
            folder.rmdir()
    for folder in (incoming, claims):
        with suppress(OSError):
            folder.rmdir()


def remove_idle_staging_folder(scenario: Path) -> None:
    """Delete the staging folder of a scenario, but keep journals still in use.

    Foreign files stay in it, and a warning says so.
    """
    staging, journals = find_staging_folder(scenario), find_journals(scenario)
    if journals:  # of a killed run
        remove_partial_files(scenario)
    else:
        remove_staging_folder(scenario)
    left = {path for path in staging.rglob("*") if not path.is_dir()}
    foreign = left.difference(journals, {staging / "lock"})
    if foreign:
        _logger.warning(
            "%s: %s kept, not written by this version; delete the folder if nothing in it is yours",
            staging,
            format_file_count(len(foreign)),
        )


def remove_empty_staging_folder(scenario: Path) -> None:
    """Delete a killed run's staging folder, which loaders of OPV2V take for a scenario."""
    staging = find_staging_folder(scenario)
    is_idle = all(path.is_dir() or path.name == "lock" for path in staging.rglob("*"))
    if staging.parent.is_dir() and is_idle:
        with lock_scenario(scenario):
            """The end of this block deletes the folder."""


def remove_staging_folder(scenario: Path) -> None:
    """Delete the staging folder of a scenario, and the dataset's if no other scenario is in it."""
    staging = find_staging_folder(scenario)
    remove_partial_files(scenario)
    remove_journals(scenario)
    (staging / "lock").unlink(missing_ok=True)
    with suppress(OSError):  # not empty: another scenario is being written
        staging.rmdir()
        staging.parent.rmdir()


@contextmanager
def report_disk_errors(path: Path) -> Generator[None]:
    """Raise a RunError for an OSError; it names its file, or `path` if it has none."""
    try:
        yield
    except OSError as error:
        if error.errno == errno.EXDEV:  # of a renaming
            raise RunError(
                f"{Path(error.filename2 or path).parent}: is mounted from another file system than"
                " the dataset; mount or link the whole `output` instead: finished files"
                " are renamed into place"
            ) from error
        remedy = "make room" if error.errno in _ERRORS_OF_FULL_DISKS else "make it writable"
        kept = "; finished frames are kept" if _has_files(path) else ""
        raise RunError(
            f"{error.filename or path}: {describe_cause(error)}{kept}:"
            f" {remedy} or choose another `output`, and run again"
        ) from error


def _has_files(folder: Path) -> bool:
    """Return whether a folder shows anything but hidden files, such as locks."""
    with suppress(OSError):
        return any(not path.name.startswith(".") for path in folder.iterdir())
    return False


def refuse_other_run(dataset: Path, scenarios: Iterable[str]) -> None:
    """Raise a RunError if another run is writing one of these scenarios."""
    for name in scenarios:
        scenario = dataset / name
        if is_being_written(scenario, patience_s=KILLED_WORKERS_S):
            raise RunError(
                f"{scenario}: another run is writing this scenario; wait for it or choose another"
                " `output`"
            )


def is_being_written(scenario: Path, *, patience_s: float = 0.0) -> bool:
    """Return whether a run keeps a scenario open for longer than `patience_s`; changes no file."""
    until_s = time.monotonic() + patience_s
    while is_locked(find_staging_folder(scenario) / "lock"):
        if time.monotonic() >= until_s:
            return True
        time.sleep(0.05)
    return False


def is_locked(path: Path) -> bool:
    """Return whether a process holds the lock on a file; changes no file."""
    import fcntl

    # Runs make regular files only; anything else holds no lock.
    with suppress(*NO_FILE_ERRORS), open(path, "rb", opener=open_without_links) as stream:
        try:
            # First the shared lock: a run converting its lock to shared meets no exclusive one.
            fcntl.flock(stream, fcntl.LOCK_SH | fcntl.LOCK_NB)
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
    return False


def lock_file(path: Path, what: str = "this scenario", *, shared: bool = False) -> IO[bytes]:
    """Lock `path` until the returned stream is closed or the process ends.

    A shared lock excludes exclusive ones only; `share_lock` turns an exclusive one into it.

    Raises:
        RunError: Another process holds the lock, longer than a killed one would.
    """
    import fcntl  # POSIX only; reading a dataset, which imports this module, works without

    deadline_s = time.monotonic() + LOCK_TIMEOUT_S
    while True:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            stream = open(path, "ab", opener=open_without_links)  # noqa: SIM115 - returned
        except (FileExistsError, FileNotFoundError):
            # An ending process may delete the folder between the two.
            if time.monotonic() > deadline_s:
                raise
            continue
        try:
            fcntl.flock(stream, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
        except BlockingIOError as error:
            stream.close()
            if time.monotonic() < deadline_s:
                time.sleep(0.05)
                continue
            raise RunError(
                f"{path.parent}: another run is writing {what}; wait for it or choose"
                " another `output`"
            ) from error
        # The previous owner may have deleted the file after it was opened here; then this lock
        # is on a file invisible to other processes.
        if path.exists() and os.path.samestat(os.fstat(stream.fileno()), path.stat()):
            return stream
        stream.close()


@contextmanager
def lock_scenario(scenario: Path) -> Generator[None]:
    """Keep other runs out of a scenario until the end.

    Raises:
        RunError: Another run is writing the scenario, a folder is a link, or the disk refuses.
    """
    with report_disk_errors(scenario):
        check_folders_are_no_links(scenario, ())
        lock = lock_file(find_staging_folder(scenario) / "lock")
    try:
        yield
    finally:
        with lock, report_disk_errors(scenario):
            remove_idle_staging_folder(scenario)


def share_lock(stream: IO[bytes]) -> None:
    """Turn an exclusive lock into a shared one; it still keeps exclusive ones out.

    The kernel releases the lock and takes it again; OSError if another run came in between.
    """
    import fcntl

    fcntl.flock(stream, fcntl.LOCK_SH | fcntl.LOCK_NB)


def replace_file(scenario: Path, path: str, content: bytes) -> None:
    """Write a file of a scenario; at any moment it is either the old or the new one."""
    partial = find_partial_file(scenario, path)
    write_file(partial, content)
    sync_files([partial])
    move_file(partial, scenario / path)
