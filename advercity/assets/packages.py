"""Debian's package of furniture models, fetched with apt's own sources and without root.

The package's collections of models (`.sh3f` archives): what is in them, whose, on what terms.
"""

import hashlib
import io
import lzma
import re
import shutil
import subprocess
import tarfile
import tempfile
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from advercity_dsl.catalogue import BodyModel, FreeLicence

from advercity.errors import RunError

PACKAGE_NAME = "sweethome3d-furniture"
WANTED_FILES = re.compile(r"(?:.*/)?(?:[\w-]+\.sh3f|copyright)$")
"""The collections of models, and who holds which rights in them."""
DIGEST_FILE = "package.sha256"
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
        package = _download_package(work)
        unpack_package(package, unpacked)
        (unpacked / DIGEST_FILE).write_text(hashlib.sha256(package.read_bytes()).hexdigest())
        if folder.exists():
            shutil.rmtree(folder)
        unpacked.replace(folder)


def _download_package(work: Path) -> Path:
    apt = shutil.which("apt-get")
    if apt is None:
        raise RunError(f"there is no apt-get here to fetch Debian's {PACKAGE_NAME} with")
    done = subprocess.run(  # noqa: S603 - the system's own package manager
        [apt, "download", "-q", PACKAGE_NAME], cwd=work, capture_output=True, text=True, check=False
    )
    found = next(work.glob("*.deb"), None)
    if done.returncode != 0 or found is None:
        said = done.stderr.strip().splitlines() or ["it says nothing"]
        raise RunError(
            f"apt-get cannot download {PACKAGE_NAME}: {said[-1]}; is `apt-get update` done?"
        )
    return found


def unpack_package(package: Path, folder: Path) -> None:
    """Put what is wanted of a Debian package into a folder.

    Raises:
        RunError: It is no Debian package, or holds no models.
    """
    try:
        with tarfile.open(fileobj=_open_data_archive(package.read_bytes())) as archive:
            for member in archive:
                stream = archive.extractfile(member) if member.isfile() else None
                if stream is not None and WANTED_FILES.match(member.name):
                    with (folder / Path(member.name).name).open("wb") as copy:
                        shutil.copyfileobj(stream, copy)
    except (tarfile.TarError, lzma.LZMAError, EOFError, ValueError) as error:
        raise RunError(f"{package.name}: not a Debian package: {error}") from error
    if not any(folder.glob("*.sh3f")) or not (folder / "copyright").is_file():
        raise RunError(f"{package.name}: holds no collections of models with a copyright file")


def _open_data_archive(content: bytes) -> io.BytesIO:
    """The `data.tar` of a Debian package, still compressed."""
    for name, member in _iterate_ar_members(content):
        if name.startswith("data.tar"):
            return io.BytesIO(member)
    raise ValueError("it has no data.tar")


def _iterate_ar_members(content: bytes) -> Iterator[tuple[str, bytes]]:
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


FREE_LICENCES: dict[str, FreeLicence] = {
    "CC0": "CC0-1.0",
    "CC-BY-3.0": "CC-BY-3.0",
    "CC-BY-3.0-USA": "CC-BY-3.0-US",
}
"""Free ones, by their names in the package's copyright file."""
CATALOGUE_FILE = "PluginFurnitureCatalog.properties"


@dataclass(frozen=True)
class SourceModel:
    """A model as the package has it.

    Attributes:
        obj: Its Wavefront text.
        files: What the text may refer to, by name: materials and textures.
        author: As the collection's catalogue names them.
        licence: Of the collection.
    """

    obj: bytes
    files: dict[str, bytes]
    author: str
    licence: FreeLicence


def load_source_model(package: Path, model: str) -> SourceModel:
    """A model, `collection/model`, of the unpacked package.

    Raises:
        RunError: There is none, or its collection is not free.
    """
    for archive in sorted(package.glob("*.sh3f")):
        with zipfile.ZipFile(archive) as files:
            folder = f"{model}/"
            inside = [name for name in files.namelist() if name.startswith(folder)]
            wanted = next((name for name in inside if name.endswith(".obj")), None)
            if wanted is not None:
                return SourceModel(
                    obj=files.read(wanted),
                    files={
                        name.removeprefix(folder): files.read(name)
                        for name in inside
                        if name.lower().endswith((".mtl", ".jpg", ".jpeg", ".png"))
                    },
                    author=_find_author(files.read(CATALOGUE_FILE).decode("latin-1"), wanted),
                    licence=_find_licence(package / "copyright", archive.stem),
                )
    raise RunError(f"the asset pack has no model '{model}'")


def check_licence(model: BodyModel, source: SourceModel) -> None:
    """RunError if a declaration gives another author or licence than the package does."""
    said, true = (model.author, model.licence), (source.author, source.licence)
    if said != true:
        raise RunError(
            f"model '{model.pack}' is by {true[0]} under {true[1]}; the catalogue says"
            f" {said[0]} under {said[1]}"
        )


def _find_author(catalogue: str, path: str) -> str:
    """Who made the model at a path, from the collection's own list."""
    number = re.search(rf"^model#(\d+)\s*=\s*/?{re.escape(path)}\s*$", catalogue, re.MULTILINE)
    if number is None:
        return "unknown"
    creator = re.search(rf"^creator#{number[1]}\s*=\s*(.+?)\s*$", catalogue, re.MULTILINE)
    return creator[1] if creator else "unknown"


def _find_licence(copyright_file: Path, collection: str) -> FreeLicence:
    text = copyright_file.read_text(encoding="utf-8", errors="replace")
    stanza = re.search(
        rf"^Files: {re.escape(collection)}/\*\n(?:.+\n)*?License: (\S+)", text, re.MULTILINE
    )
    named = stanza[1] if stanza else "no licence"
    if named not in FREE_LICENCES:
        raise RunError(f"the asset pack's collection {collection} is under {named}, not a free one")
    return FREE_LICENCES[named]
