"""Debian's package of furniture models, fetched with apt's own sources and without root."""

import hashlib
import io
import lzma
import re
import shutil
import subprocess
import tarfile
import tempfile
from collections.abc import Iterator
from pathlib import Path

from advercity.errors import RunError

PACKAGE = "sweethome3d-furniture"
WANTED = re.compile(r"(?:.*/)?(?:[\w-]+\.sh3f|copyright)$")
"""The collections of models, and who holds which rights in them."""
STAMP = "package.sha256"
"""File that tells which package it was."""
_AR_MAGIC, _AR_HEADER = b"!<arch>\n", 60


def fetch_package(folder: Path) -> None:
    """Fill `folder` with the package's collections and its `copyright`; whole or absent.

    Raises:
        RunError: There is no apt here, it finds no such package, or no network.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder.parent) as name:
        work = Path(name)
        unpacked = work / "unpacked"
        unpacked.mkdir()
        package = _downloaded(work)
        unpack(package, unpacked)
        (unpacked / STAMP).write_text(hashlib.sha256(package.read_bytes()).hexdigest())
        if folder.exists():
            shutil.rmtree(folder)
        unpacked.replace(folder)


def _downloaded(work: Path) -> Path:
    apt = shutil.which("apt-get")
    if apt is None:
        raise RunError(f"there is no apt-get here to fetch Debian's {PACKAGE} with")
    done = subprocess.run(  # noqa: S603 - the system's own package manager
        [apt, "download", "-q", PACKAGE], cwd=work, capture_output=True, text=True, check=False
    )
    found = next(work.glob("*.deb"), None)
    if done.returncode != 0 or found is None:
        said = done.stderr.strip().splitlines() or ["it says nothing"]
        raise RunError(f"apt-get cannot download {PACKAGE}: {said[-1]}; is `apt-get update` done?")
    return found


def unpack(package: Path, folder: Path) -> None:
    """Put what is wanted of a Debian package into a folder.

    Raises:
        RunError: It is no Debian package, or holds no models.
    """
    try:
        with tarfile.open(fileobj=_data(package.read_bytes())) as archive:
            for member in archive:
                stream = archive.extractfile(member) if member.isfile() else None
                if stream is not None and WANTED.match(member.name):
                    with (folder / Path(member.name).name).open("wb") as copy:
                        shutil.copyfileobj(stream, copy)
    except (tarfile.TarError, lzma.LZMAError, EOFError, ValueError) as error:
        raise RunError(f"{package.name}: not a Debian package: {error}") from error
    if not any(folder.glob("*.sh3f")) or not (folder / "copyright").is_file():
        raise RunError(f"{package.name}: holds no collections of models with a copyright file")


def _data(content: bytes) -> io.BytesIO:
    """The `data.tar` of a Debian package, still compressed."""
    for name, member in _members(content):
        if name.startswith("data.tar"):
            return io.BytesIO(member)
    raise ValueError("it has no data.tar")


def _members(content: bytes) -> Iterator[tuple[str, bytes]]:
    """Names and contents of the members of an `ar` archive."""
    if not content.startswith(_AR_MAGIC):
        raise ValueError("it is no ar archive")
    at = len(_AR_MAGIC)
    while at + _AR_HEADER <= len(content):
        header = content[at : at + _AR_HEADER]
        size = int(header[48:58])
        at += _AR_HEADER
        yield header[:16].decode("ascii", "replace").strip().rstrip("/"), content[at : at + size]
        at += size + size % 2
