"""Folders of unpacked packages: whole or absent, and removed only if unchanged."""

import hashlib
import logging
import os
import re
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path

from advercity.assets.downloads import AssetPackage
from advercity.atomic_files import check_is_no_link, open_partial_folder, open_without_links
from advercity.errors import InputError, report_write_errors

_logger = logging.getLogger(__name__)

DIGEST_FILE = "package.sha256"
"""File with the SHA-256 of the unpacked package, and a line for each unpacked file."""
_FILE_LINE = re.compile(rb"([0-9a-f]{64})  ([^/\0]+)")


def is_unpacked(package: AssetPackage, folder: Path) -> bool:
    """Return whether a folder has a package, in this version."""
    path = folder / DIGEST_FILE
    return path.is_file() and path.read_bytes().split(b"\n")[0] == package.sha256.encode()


def is_damaged(folder: Path) -> bool:
    """Return whether the digest of a folder's package is unreadable, in any version."""
    path = folder / DIGEST_FILE
    return path.is_file() and not re.match(rb"[0-9a-f]{64}(\n|$)", path.read_bytes())


@contextmanager
def open_new_package(package: AssetPackage, folder: Path) -> Generator[Path]:
    """Yield an empty folder; at the end it replaces the package unpacked before.

    Raises:
        InputError: `folder` is a link, or holds other or changed files; before anything is done.
    """
    _check_is_replaceable(folder)  # before a download of 100 MB
    with report_write_errors(), open_partial_folder(folder.parent) as partial:
        unpacked = partial / "unpacked"
        unpacked.mkdir()
        yield unpacked
        lines = [f"{_compute_digest(path)}  {path.name}" for path in sorted(unpacked.iterdir())]
        (unpacked / DIGEST_FILE).write_text("\n".join([package.sha256, *lines, ""]))
        _check_is_replaceable(folder)
        remove_package(folder)
        unpacked.replace(folder)


def remove_package(folder: Path) -> None:
    """Delete the unchanged files of a package, and warn about changed ones.

    The folder is deleted, too, if it is empty then.

    Raises:
        InputError: The folder is a link, or does not list its unpacked files.
    """
    check_is_no_link(folder)
    record = folder / DIGEST_FILE
    if not record.is_file():
        return
    recorded = _read_digests(folder)
    if not recorded:
        raise InputError(
            f"{record}: lists no unpacked files, as in earlier versions; delete the folder if"
            " none of its files is yours"
        )
    with report_write_errors():
        for name in _list_unchanged_files(folder):
            (folder / name).unlink()
        changed = sorted(name for name in recorded if os.path.lexists(folder / name))
        # The record last: until then an interrupted removal is known to be one of a package.
        record.unlink()
        with suppress(OSError):  # files of others are in it
            folder.rmdir()
    if changed:
        _logger.warning("%s: changed since it was unpacked, kept: %s", folder, ", ".join(changed))


def _check_is_replaceable(folder: Path) -> None:
    check_is_no_link(folder)
    with suppress(FileNotFoundError, NotADirectoryError):
        if {path.name for path in folder.iterdir()} <= {
            *_list_unchanged_files(folder),
            DIGEST_FILE,
        }:
            return
    if os.path.lexists(folder):
        raise InputError(
            f"{folder}: holds files that are not of an asset package, or were changed since; move"
            " them, or set ADVERCITY_DATA to another folder"
        )


def _list_unchanged_files(folder: Path) -> list[str]:
    unchanged: list[str] = []
    for name, digest in _read_digests(folder).items():
        with suppress(OSError):  # gone, or a link or folder
            if _compute_digest(folder / name) == digest:
                unchanged.append(name)
    return unchanged


def _read_digests(folder: Path) -> dict[str, str]:
    """Read the SHA-256 of every unpacked file by name; empty if there is no such record."""
    with suppress(OSError):
        lines = (folder / DIGEST_FILE).read_bytes().split(b"\n")[1:]
        found = filter(None, map(_FILE_LINE.fullmatch, lines))
        return {os.fsdecode(match[2]): match[1].decode() for match in found}
    return {}


def _compute_digest(path: Path) -> str:
    with open(path, "rb", opener=open_without_links) as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
