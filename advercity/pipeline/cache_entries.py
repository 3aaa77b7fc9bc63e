"""Entries of the cache: written atomically, checked on use, and limited in total size.

Next to each entry is a file with its SHA-256 and its name, for `sha256sum -c` in the folder of the
cache. The modification time of that file is the last use of the entry.
"""

import hashlib
import logging
import os
import re
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from advercity.atomic_files import (
    open_partial_path,
    remove_abandoned_partials,
    write_atomically,
)
from advercity.diagnostics import DiagnosticsError
from advercity.documents import read_bytes
from advercity.errors import RunError, describe_cause
from advercity.pipeline.cache import find_cache_folder
from advercity.run_options import format_byte_size, parse_byte_size

_logger = logging.getLogger(__name__)
T = TypeVar("T")

DEFAULT_SIZE = "10 GB"
IN_USE_S = 3600.0
"""Entries used within this time are not removed to make room: a run may need them."""
ENTRY_FILES = {
    "networks": "*/road.net.xml",
    "traces": "*.npz",
    "refusals": "*.txt",
    "worlds": "*.npz",
    "bodies": "*.npz",
    "maps": "*.npz",
}
"""Patterns of the files of entries, by kind."""
_KEY = re.compile(r"[0-9a-f]{64}")
_CHECKSUM = re.compile(r"([0-9a-f]{64})  (.+)\n")
_MAX_CHECKSUM_BYTES = 1000


@dataclass(frozen=True)
class CacheEntry:
    """An entry of the cache.

    Attributes:
        path: Its file.
        kind: Name of its folder.
        size_bytes: Size of the file.
        used_s: Last use, in seconds since the epoch.
    """

    path: Path
    kind: str
    size_bytes: int
    used_s: float


@dataclass(frozen=True)
class RemovedEntries:
    """Number and size of removed entries."""

    count: int
    size_bytes: int

    def __str__(self) -> str:
        noun = "entry" if self.count == 1 else "entries"
        return f"{self.count} {noun} removed, {format_byte_size(self.size_bytes)}"


def load_entry(name: str, load: Callable[[Path], T]) -> T | None:
    """Load an entry; None if it is missing, or damaged, with a warning.

    Args:
        name: Path within the cache: kind, key, suffix.
        load: Loads it; RunError if it cannot.
    """
    path = find_cache_folder() / name
    if not _get_checksum_file(path).is_file() or not path.exists():
        return None
    try:
        _check_entry(path)
        content = load(path)
    except RunError as error:
        _logger.warning("%s; it is made again", error)
        return None
    with suppress(OSError):  # a shared cache of another user
        os.utime(_get_checksum_file(path))
    return content


def load_or_build_entry(name: str, build: Callable[[Path], None], load: Callable[[Path], T]) -> T:
    """Load an entry; if it is missing or damaged, let `build` write it first.

    Raises:
        InputError: The size limit cannot be parsed.
        RunError: The cache cannot be written.
    """
    found = load_entry(name, load)
    if found is not None:
        return found
    path, limit_bytes = find_cache_folder() / name, find_size_limit()
    for file in (path, _get_checksum_file(path)):
        if file.is_dir():
            raise RunError(f"{file}: is a folder where the cache has a file; move it elsewhere")
    try:
        with open_partial_path(path) as partial:
            build(partial)
            checksum = _format_checksum(partial, path)
        write_atomically(_get_checksum_file(path), checksum.encode())
        removed = prune_cache(limit_bytes)
    except OSError as error:
        message = f"{error.filename or path}: cannot be written: {describe_cause(error)}"
        raise RunError(f"{message}; set ADVERCITY_CACHE to a folder you may write to") from error
    if removed.count:
        _logger.warning("cache: %s, to keep within ADVERCITY_CACHE_SIZE", removed)
    return load(path)


def find_size_limit() -> int:
    """Find the size of the cache in bytes: `$ADVERCITY_CACHE_SIZE`, such as `50 GB`."""
    variable = "ADVERCITY_CACHE_SIZE"
    return parse_byte_size(variable, os.environ.get(variable) or DEFAULT_SIZE)


def list_entries() -> list[CacheEntry]:
    """List all entries, least recently used first."""
    return sorted(_iterate_entries(), key=lambda entry: (entry.used_s, entry.path))


def describe_cache() -> list[dict[str, str | int]]:
    """Describe the entries of every kind: number, size, last use."""
    entries = list_entries()
    rows: list[dict[str, str | int]] = []
    for kind in ENTRY_FILES:
        own = [entry for entry in entries if entry.kind == kind]
        used = max((entry.used_s for entry in own), default=None)
        date = "" if used is None else time.strftime("%Y-%m-%d %H:%M", time.localtime(used))
        size = format_byte_size(sum(entry.size_bytes for entry in own))
        rows.append({"kind": kind, "entries": len(own), "size": size, "last used": date})
    return rows


def prune_cache(limit_bytes: int) -> RemovedEntries:
    """Remove leftovers, and the entries used longest ago until the rest is within the limit.

    Entries in linked folders stay and do not count: they belong to the folder's owner.
    """
    _sweep()
    entries, now_s = [entry for entry in list_entries() if not _find_link(entry)], time.time()
    excess_bytes = sum(entry.size_bytes for entry in entries) - limit_bytes
    chosen: list[CacheEntry] = []
    for entry in entries:
        # A last use in the future means the clock was set back: its age is unknown.
        if excess_bytes > 0 and abs(now_s - entry.used_s) > IN_USE_S:
            chosen.append(entry)
            excess_bytes -= entry.size_bytes
    return _remove(chosen)


def clear_cache() -> RemovedEntries:
    """Remove all entries and leftovers, except through links.

    Links to folders and files of other kinds stay, with a warning.
    """
    _sweep()
    found, folder = list_entries(), find_cache_folder()
    removed = _remove([entry for entry in found if not _find_link(entry)])
    links = {link for entry in found if (link := _find_link(entry))}
    for link in sorted(links):
        _logger.warning("%s: is a link to %s, whose entries stay", link, link.readlink())
    real = (folder / kind for kind in ENTRY_FILES if not (folder / kind).is_symlink())
    kept = [path for inside in real for path in inside.rglob("*") if path not in links]
    count = sum(1 for path in kept if path.is_symlink() or not path.is_dir())
    if count:
        _logger.warning(
            "%s: %s no entries of this version, kept; delete them if none is yours",
            folder,
            f"{count} file{' is' if count == 1 else 's are'}",
        )
    return removed


def ensure_entry(name: str, build: Callable[[Path], None], load: Callable[[Path], object]) -> str:
    """Return the SHA-256 of an entry without reading its content; make a missing entry.

    Raises:
        InputError: The size limit cannot be parsed.
        RunError: The cache cannot be written.
    """
    path = find_cache_folder() / name
    recorded = _read_recorded_checksum(path) if path.is_file() else None
    if recorded is not None:
        return recorded
    load_or_build_entry(name, build, load)
    return read_checksum(name)


def read_checksum(name: str) -> str:
    """Read the SHA-256 of a loaded entry.

    Raises:
        RunError: The entry was removed after it was loaded.
    """
    checksum = _read_recorded_checksum(find_cache_folder() / name)
    if checksum is None:
        raise RunError(f"{find_cache_folder() / name}: was removed while it was in use; run again")
    return checksum


def _iterate_entries() -> Iterator[CacheEntry]:
    for kind, pattern in ENTRY_FILES.items():
        for path in (find_cache_folder() / kind).glob(pattern):
            key = path.relative_to(find_cache_folder() / kind).parts[0].partition(".")[0]
            with suppress(FileNotFoundError):  # another process has removed it
                if _KEY.fullmatch(key) and _read_recorded_checksum(path) and path.is_file():
                    used_s = _get_checksum_file(path).stat().st_mtime
                    yield CacheEntry(path, kind, path.stat().st_size, used_s)


def _find_link(entry: CacheEntry) -> Path | None:
    """Find the linked folder above an entry, if any; the cache folder itself may be a link."""
    inside = find_cache_folder() / entry.kind
    return next((path for path in (inside, entry.path.parent) if path.is_symlink()), None)


def _remove(entries: list[CacheEntry]) -> RemovedEntries:
    removed: list[CacheEntry] = []
    for entry in entries:
        with suppress(OSError):  # of another user, or a folder in place of the checksum
            # The checksum first: an entry without one counts as absent.
            _get_checksum_file(entry.path).unlink(missing_ok=True)
            entry.path.unlink(missing_ok=True)
            removed.append(entry)
            if entry.path.parent.name != entry.kind:
                entry.path.parent.rmdir()
    return RemovedEntries(len(removed), sum(entry.size_bytes for entry in removed))


def _sweep() -> None:
    """Remove partial files of ended processes."""
    for kind in ENTRY_FILES:
        folder = find_cache_folder() / kind
        for inside in (folder, *(path for path in folder.glob("*") if _KEY.fullmatch(path.name))):
            remove_abandoned_partials(inside)


def _check_entry(path: Path) -> None:
    """Raise RunError if an entry was changed or renamed after it was written."""
    try:
        is_same = _read_checksum_file(path) == _format_checksum(path, path)
    except OSError as error:
        raise RunError(f"{path}: cannot be read: {describe_cause(error)}") from error
    if not is_same:
        raise RunError(f"{path}: is not as it was written")


def _format_checksum(file: Path, path: Path) -> str:
    """Format the checksum of a file for the entry at `path`."""
    if not file.is_file():
        raise OSError("is no regular file")
    name = path.relative_to(find_cache_folder()).as_posix()
    with file.open("rb") as stream:
        return f"{hashlib.file_digest(stream, 'sha256').hexdigest()}  {name}\n"


def _read_recorded_checksum(path: Path) -> str | None:
    """Read the checksum next to an entry; None if it is missing or has another name."""
    with suppress(OSError):
        match = _CHECKSUM.fullmatch(_read_checksum_file(path))
        if match and match[2] == path.relative_to(find_cache_folder()).as_posix():
            return match[1]
    return None


def _read_checksum_file(path: Path) -> str:
    """Read the checksum file next to an entry; empty if it cannot be one.

    Raises:
        OSError: It is missing or unreadable.
    """
    with suppress(DiagnosticsError):  # a device, which may never end, or larger than any checksum
        content = read_bytes(_get_checksum_file(path), max_bytes=_MAX_CHECKSUM_BYTES)
        return content.decode(errors="replace")
    return ""


def _get_checksum_file(path: Path) -> Path:
    return path.with_name(f"{path.name}.sha256")
