"""Unpacks Debian's package of furniture models, and reads models, authors and licences from it.

Models are in collections, `.sh3f` archives, each with a catalogue and one licence.
"""

import io
import lzma
import re
import shutil
import tarfile
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from advercity_dsl.catalogue import BodyModel, FreeLicence

from advercity.assets.downloads import AssetPackage, fetch_package
from advercity.assets.package_folders import open_new_package
from advercity.errors import InputError, RunError, describe_cause

LICENCE_FILE = "copyright"
_AR_MAGIC, _AR_HEADER = b"!<arch>\n", 60
FREE_LICENCES: dict[str, FreeLicence] = {
    "CC0": "CC0-1.0",
    "CC-BY-3.0": "CC-BY-3.0",
    "CC-BY-3.0-USA": "CC-BY-3.0-US",
}
"""Accepted licences by their names in the package's copyright file."""
CATALOGUE_FILE = "PluginFurnitureCatalog.properties"


FURNITURE = AssetPackage(
    name="sweethome3d-furniture",
    version="1.8-1",
    sha256="3ccb90c63f9525e887a767b9cd5c8b6933b8b6b2973a615a5359ee68a2118668",
    size_bytes=119_782_356,
    collections=(
        *("BlendSwap-CC-0.sh3f", "BlendSwap-CC-BY.sh3f", "KatorLegaz.sh3f", "Reallusion.sh3f"),
        "Scopia.sh3f",
    ),
)


def install_package(package: AssetPackage, folder: Path, source: Path | None = None) -> None:
    """Fetch a package and unpack its collections and `copyright` into `folder`, atomically.

    Args:
        package: The package.
        folder: Where to unpack it.
        source: The package file, or a folder with it; None downloads it.

    Raises:
        InputError: `source` does not exist, or is another file, or `folder` holds other files.
        RunError: It cannot be downloaded, or is no Debian package of models.
    """
    with open_new_package(package, folder) as unpacked:
        unpack_package(package, fetch_package(package, unpacked.parent, source), unpacked)


def copy_package(package: AssetPackage, source: Path, folder: Path) -> None:
    """Copy an unpacked package to `folder`, atomically; other files beside it are not copied.

    Raises:
        InputError: `folder` holds other files, or a file cannot be read or written.
    """
    with open_new_package(package, folder) as unpacked:
        for path in (source / name for name in (*package.collections, LICENCE_FILE)):
            try:
                content = path.read_bytes()
            except OSError as error:
                raise InputError(f"{path}: cannot be read: {describe_cause(error)}") from error
            (unpacked / path.name).write_bytes(content)


def unpack_package(package: AssetPackage, file: Path, folder: Path) -> None:
    """Unpack the collections of a Debian package, and their licences, into a folder.

    Raises:
        RunError: It is not a Debian package, or lacks one of them.
    """
    wanted = {*package.collections, LICENCE_FILE}
    try:
        with tarfile.open(fileobj=_open_data_archive(file.read_bytes())) as archive:
            for member in archive:
                stream = archive.extractfile(member) if member.isfile() else None
                name = Path(member.name).name
                if stream is not None and name in wanted:
                    with (folder / name).open("wb") as copy:
                        shutil.copyfileobj(stream, copy)
    except (tarfile.TarError, lzma.LZMAError, EOFError, ValueError) as error:
        raise RunError(f"{file.name}: not a Debian package: {error}") from error
    lost = sorted(wanted - {path.name for path in folder.iterdir()})
    if lost:
        raise RunError(f"{file.name}: has no {lost[0]}")


def _open_data_archive(content: bytes) -> io.BytesIO:
    """Open the compressed `data.tar` of a Debian package."""
    for name, member in _iterate_ar_members(content):
        if name.startswith("data.tar"):
            return io.BytesIO(member)
    raise ValueError("it has no data.tar")


def _iterate_ar_members(content: bytes) -> Iterator[tuple[str, bytes]]:
    """Iterate over names and contents of the members of an `ar` archive (deb(5), ar(5))."""
    if not content.startswith(_AR_MAGIC):
        raise ValueError("it is no ar archive")
    at = len(_AR_MAGIC)
    while at + _AR_HEADER <= len(content):
        header = content[at : at + _AR_HEADER]
        size = int(header[48:58])
        at += _AR_HEADER
        yield header[:16].decode("ascii", "replace").strip().rstrip("/"), content[at : at + size]
        at += size + size % 2  # members begin at even offsets


@dataclass(frozen=True)
class SourceModel:
    """A model of the package, not converted.

    Attributes:
        obj: Wavefront text.
        files: Possibly referenced materials and textures, by name.
        author: Author according to the catalogue of the collection.
        licence: Licence of the collection.
    """

    obj: bytes
    files: dict[str, bytes]
    author: str
    licence: FreeLicence


def load_source_model(package: Path, model: str) -> SourceModel:
    """Load the model `collection/model` from the unpacked package.

    Raises:
        RunError: It does not exist, or its collection has no accepted licence.
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
    raise RunError(f"the asset package has no model '{model}'")


def check_licence(model: BodyModel, source: SourceModel) -> None:
    """Raise RunError if a declaration has another author or licence than the package."""
    if (model.author, model.licence) != (source.author, source.licence):
        raise RunError(
            f"model '{model.pack}' is by {source.author} under {source.licence}; the catalogue"
            f" declares {model.author} under {model.licence}"
        )


def _find_author(catalogue: str, path: str) -> str:
    """Find the author of the model at a path in the catalogue of its collection."""
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
        raise RunError(
            f"the asset package's collection {collection} is under {named}, not a free one"
        )
    return FREE_LICENCES[named]
