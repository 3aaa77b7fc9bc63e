"""Files that are complete or absent: written as partial files, synced, and renamed into place.

No function here writes through a link: a link in our folders must not harm other data.
"""

import hashlib
import math
import os
import platform
import re
import secrets
import shutil
import time
from collections.abc import Generator, Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path

import psutil

from advercity.errors import InputError


def _identify_machine() -> str:
    """Identify where a number of a process means the same process: machine and container."""
    with suppress(OSError):  # containers may share the name of their host
        return f"{platform.node()} {Path('/proc/self/ns/pid').readlink()}"
    return platform.node()


PARTIAL_MAX_AGE_S = 3600.0
"""Age from which a folder of partial files is abandoned, on any machine."""
_MACHINE = hashlib.sha256(_identify_machine().encode()).hexdigest()[:8]
_PARTIAL_PATTERN = re.compile(r"\.partial-([0-9a-f]{8})-(\d+)-([0-9a-f]{8})-[0-9a-f]{8}")


@contextmanager
def open_partial_folder(folder: Path) -> Generator[Path]:
    """Yield a temporary folder in `folder`, which is created if necessary.

    Leftovers of killed processes of this machine are removed; after an error, new empty folders,
    too.
    """
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    remove_abandoned_partials(folder, max_age_s=math.inf)
    partial = folder / format_partial_name(_MACHINE, os.getpid(), secrets.token_hex(4))
    partial.mkdir(parents=True, mode=0o700)
    try:
        yield partial
    except BaseException:
        shutil.rmtree(partial)
        with suppress(OSError):  # one of them has something else by now
            for path in missing:
                path.rmdir()
        raise
    shutil.rmtree(partial)


def format_partial_name(machine: str, process: int, random: str) -> str:
    """Format the name of a folder of partial files.

    It ends with a checksum of itself: no foreign folder has such a name by chance.
    """
    name = f".partial-{machine}-{process}-{random}"
    return f"{name}-{hashlib.sha256(name.encode()).hexdigest()[:8]}"


@contextmanager
def open_partial_path(path: Path) -> Generator[Path]:
    """Yield a path of the same name in a temporary folder; at the end the file becomes `path`.

    A replaced file leaves it its permissions. Errors of the system name a file.
    """
    with name_in_errors(path), open_partial_folder(path.parent) as folder:
        partial = folder / path.name
        yield partial
        with suppress(FileNotFoundError):
            shutil.copymode(path, partial)
        sync_files([partial])
        partial.replace(path)


@contextmanager
def name_in_errors(path: Path) -> Generator[None]:
    """Name a path in an OSError without one: the system names none if the disk is full."""
    try:
        yield
    except OSError as error:
        if error.filename is None:
            with suppress(AttributeError):  # PyAV's errors have a property
                error.filename = str(path)
        raise


def write_atomically(path: Path, content: bytes) -> None:
    """Write a file atomically: it is the old or the new one at any moment."""
    with open_partial_path(path) as partial:
        partial.write_bytes(content)


def remove_abandoned_partials(folder: Path, *, max_age_s: float = PARTIAL_MAX_AGE_S) -> int:
    """Delete folders of partial files in `folder` whose process has ended; return their number.

    Those of other machines count as abandoned from `max_age_s` on.
    """
    abandoned = [path for path in folder.glob(".partial-*") if _is_abandoned(path, max_age_s)]
    for path in abandoned:
        shutil.rmtree(path, ignore_errors=True)
    return len(abandoned)


def is_partial_folder(path: Path) -> bool:
    """Return whether a path is a folder of `open_partial_folder`, by its name."""
    return _match_partial_folder(path) is not None


def _match_partial_folder(path: Path) -> re.Match[str] | None:
    match = _PARTIAL_PATTERN.fullmatch(path.name)
    if match is None or path.is_symlink() or not path.is_dir():
        return None
    is_ours = path.name == format_partial_name(match[1], int(match[2]), match[3])
    return match if is_ours else None


def _is_abandoned(path: Path, max_age_s: float) -> bool:
    match = _match_partial_folder(path)
    if match is None:
        return False
    if match[1] == _MACHINE and not psutil.pid_exists(int(match[2])):
        return True
    with suppress(FileNotFoundError):
        return time.time() - path.stat().st_mtime > max_age_s
    return False


def write_file(path: Path, content: bytes) -> None:
    """Write a file, and create its folder if necessary; OSError if the path is a link.

    An existing file is replaced, not written into: it may have other names, as hard links of a
    backup, and keeps its content there.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.is_file() and not path.is_symlink():
        path.unlink()
    with open(path, "wb", opener=open_without_links) as stream:
        stream.write(content)


def open_without_links(path: str, flags: int) -> int:
    """Open a file as `open` does; OSError if its last component is a link.

    A pipe is opened at once, or is an OSError, too: `open` would wait for its other end.
    """
    more = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    return os.open(path, flags | more, 0o666)


def resolve_links(path: Path) -> Path:
    """Return the absolute path without links; a loop of links stays, to be reported at opening.

    `Path.resolve` raises a RuntimeError for a loop.
    """
    return Path(os.path.realpath(path))


def check_is_no_link(path: Path) -> None:
    """Raise an InputError if files in a folder would be deleted through a link."""
    if path.is_symlink():
        raise InputError(
            f"{path}: is a link to {path.readlink()}, whose files stay; delete the link itself"
        )


def move_file(source: Path, target: Path) -> None:
    """Rename a file, and create the target's folder if necessary."""
    target.parent.mkdir(parents=True, exist_ok=True)
    source.replace(target)


def sync_files(paths: Iterable[Path]) -> None:
    """Return when the content of files, or the names in folders, would survive a power cut."""
    # At once rather than one by one: the disk then writes them in one go.
    with ThreadPoolExecutor() as pool:
        list(pool.map(_sync_file, paths))


def _sync_file(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
