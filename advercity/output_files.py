"""Files and links at places chosen by the user: plans, sheets, videos, tables, splits.

Such a file replaces only files written by the program and unchanged since. These are known by
checksums of content and place, recorded in the user's data folder: not in the files, since a mark
in them would outlive a user's changes, and tables have no place for one.
"""

import hashlib
import os
from collections.abc import Generator, Iterable, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from advercity.atomic_files import (
    name_in_errors,
    open_partial_folder,
    open_without_links,
    resolve_links,
    sync_files,
)
from advercity.data_folder import find_data_folder
from advercity.documents import read_bytes
from advercity.errors import InputError

MANIFEST_FILE = "manifest.json"
PROTOCOL_FILE = "data_protocol.yaml"  # OPV2V's name of it
STAGING_FOLDER = ".staging"
RECORD_FILE = "written_files"
"""File in the data folder: a line with a SHA-256 for every content and where it was written."""
MAX_RECORD_BYTES = 100_000_000


@contextmanager
def open_output(path: Path) -> Generator[Path]:
    """Yield a path of the same name in a temporary folder; at the end the file becomes `path`.

    Raises:
        InputError: `path` exists and may not be replaced; before anything else is done.
        OSError: The file cannot be written.
    """
    check_output(path)
    with open_output_folder(path.parent) as partial, name_in_errors(path):
        yield partial / path.name


@contextmanager
def open_output_folder(folder: Path) -> Generator[Path]:
    """Yield a temporary folder; at the end its files are moved into `folder`, all or none.

    Raises:
        InputError: One of them exists there, with other content, and may not be replaced; or the
            folder is in a scenario.
        OSError: The files cannot be written; it names a file or the folder.
    """
    check_is_outside_scenarios(folder)
    with name_in_errors(folder), open_partial_folder(folder) as partial:
        yield partial
        digests = {path: _compute_digest(path) for path in sorted(partial.iterdir())}
        for path, digest in digests.items():
            check_output(folder / path.name, digest)
        # A file with the same content may be the user's own: it stays, and is not recorded.
        new = {
            path: folder / path.name
            for path, digest in digests.items()
            if not _has_content(folder / path.name, digest)
        }
        sync_files(new)
        _record_digests(_compute_mark(place, digests[path]) for path, place in new.items())
        for path, place in new.items():
            path.replace(place)


def write_output(path: Path, content: bytes) -> None:
    """Write a file, with the errors of `open_output_folder`."""
    with open_output_folder(path.parent) as partial, name_in_errors(path):
        (partial / path.name).write_bytes(content)


def check_output(path: Path, digest: str | None = None) -> None:
    """Raise an InputError if a path exists and may not be replaced, or is in a scenario.

    Args:
        path: File to be written.
        digest: SHA-256 of its new content; a file with this content is no loss.
    """
    check_is_outside_scenarios(path.parent)
    if path.is_dir():
        raise InputError(f"{path}: is a folder; name another file")
    if not is_replaceable(path, digest):
        raise InputError(
            f"{path}: exists, and there is no record that advercity wrote it as it is;"
            " rename or delete it, or write elsewhere"
        )


def check_is_outside_scenarios(folder: Path) -> None:
    """Check that a folder to be written into is not in a scenario, nor among unfinished files.

    Loaders of OPV2V would take a folder there for an agent, or files for frames. Files next to the
    scenarios of a dataset do no harm.

    Raises:
        InputError: It is.
    """
    for path in (folder.absolute(), resolve_links(folder)):
        for parent in (path, *path.parents):
            if is_scenario(parent):
                place, dataset = "in a scenario", parent.parent
            elif parent.name == STAGING_FOLDER and is_dataset_or_scenario(parent.parent):
                place, dataset = "among the unfinished files", parent.parent
            else:
                continue
            raise InputError(
                f"{folder}: is {place} of a dataset; write into that dataset, {dataset}, or into"
                " another folder"
            )


def is_scenario(folder: Path) -> bool:
    """Return whether a folder is a scenario; other programs also name manifests like this."""
    return all((folder / name).is_file() for name in (MANIFEST_FILE, PROTOCOL_FILE))


def is_dataset_or_scenario(folder: Path) -> bool:
    """Return whether a folder is a scenario, or has one in it."""
    found = (folder, *(path.parent for path in folder.glob(f"*/{MANIFEST_FILE}")))
    return any(map(is_scenario, found))


def is_replaceable(path: Path, digest: str | None = None) -> bool:
    """Return whether a path is free, or has a file of the program or with this SHA-256."""
    if path.is_symlink() or not path.is_file():
        return not os.path.lexists(path)
    with suppress(OSError):
        found = _compute_digest(path)
        return found == digest or _compute_mark(path, found) in _load_digests()
    return False


def check_link(path: Path, target: str | None = None) -> None:
    """Raise an InputError if a path is neither free nor a link of the program.

    Args:
        path: Link to be made or removed.
        target: Its target; an equal link is no loss.
    """
    if path.is_symlink():
        found = str(path.readlink())
        if found == target or _compute_link_mark(path, found) in _load_digests():
            return
    elif not os.path.lexists(path):
        return
    raise InputError(
        f"{path}: exists, and there is no record that advercity made this link;"
        " rename or delete it, or write elsewhere"
    )


def make_links(links: Mapping[Path, str]) -> None:
    """Make links, in place of others if `check_link` permits.

    Raises:
        OSError: A link cannot be made.
    """
    # An existing link to the target may be the user's own: it stays, and is not recorded.
    new = {
        path: target
        for path, target in links.items()
        if not (path.is_symlink() and str(path.readlink()) == target)
    }
    _record_digests(_compute_link_mark(path, target) for path, target in new.items())
    for path, target in new.items():
        if path.is_symlink():
            path.unlink()
        path.symlink_to(target)


def _compute_link_mark(path: Path, target: str) -> str:
    return _compute_mark(path, hashlib.sha256(b"link to " + os.fsencode(target)).hexdigest())


def _has_content(path: Path, digest: str) -> bool:
    return not path.is_symlink() and path.is_file() and _compute_digest(path) == digest


def _compute_mark(path: Path, digest: str) -> str:
    """Compute the checksum of content at a place: the same may be elsewhere, and not be ours."""
    place = os.fsencode(resolve_links(path.parent) / path.name)
    return hashlib.sha256(f"{digest} at ".encode() + place).hexdigest()


def _compute_digest(path: Path) -> str:
    with open(path, "rb", opener=open_without_links) as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _load_digests() -> set[str]:
    with suppress(OSError, InputError):
        raw = read_bytes(find_data_folder() / RECORD_FILE, max_bytes=MAX_RECORD_BYTES)
        return set(raw.decode(errors="replace").split())
    return set()


def _record_digests(digests: Iterable[str]) -> None:
    """Add checksums to the record; without a writable data folder, files are not replaceable."""
    new = sorted(set(digests) - _load_digests())
    with suppress(OSError, InputError):
        path = find_data_folder() / RECORD_FILE
        path.parent.mkdir(parents=True, exist_ok=True)
        # In one call: lines of several processes must not mix.
        with open(path, "ab", buffering=0, opener=open_without_links) as stream:
            stream.write("".join(f"{digest}\n" for digest in new).encode())
