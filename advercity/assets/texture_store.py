"""Stores photographs of surfaces: one `.zip` with the used files for each package."""

import hashlib
import io
import logging
import os
import tarfile
import tempfile
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from advercity.assets.downloads import AssetPackage, fetch_package
from advercity.assets.maps.surface import encode_photographs
from advercity.atomic_files import check_is_no_link, write_atomically
from advercity.data_folder import find_data_folder
from advercity.errors import RunError, report_write_errors
from advercity.geometry.arrays import Uint8Array
from advercity.material_maps import MaterialMaps
from advercity.materials import MATERIALS
from advercity.texture_packs import TextureFile, TexturePack

_logger = logging.getLogger(__name__)

NPM_FOLDER = "package"
"""Folder of all files in npm's package files."""
ATTRIBUTION_FILE = "ATTRIBUTION.md"
_DATE = (1980, 1, 1, 0, 0, 0)


def open_texture_store() -> "TextureStore":
    """Open the store of photographs in the data folder."""
    return TextureStore(find_data_folder() / "assets" / "textures")


def describe_package(pack: TexturePack) -> AssetPackage:
    """Describe the package of a pack."""
    return AssetPackage(pack.package, pack.version, pack.sha256, pack.size_bytes, "npm")


@dataclass(frozen=True)
class TextureStore:
    """A folder of packs, which stay packed."""

    folder: Path

    def install(self, pack: TexturePack, source: Path | None = None) -> None:
        """Store the files of a pack from a package file or folder, or download the package.

        Raises:
            InputError: `source` does not exist, or is another file.
            RunError: It cannot be downloaded, or lacks a file as declared.
        """
        with report_write_errors(), tempfile.TemporaryDirectory() as work:
            package = fetch_package(describe_package(pack), Path(work), source)
            write_atomically(self._find_file(pack), _build_archive(pack, package))

    def is_installed(self, pack: TexturePack) -> bool:
        """Return whether all files of a pack are here, each as declared."""
        try:
            for file in pack.files:
                self._read(pack, file)
        except RunError:
            return False
        return True

    def remove(self, pack: TexturePack) -> None:
        """Delete a pack; a changed one stays, and a warning says so.

        Raises:
            InputError: The folder is a link.
        """
        check_is_no_link(self.folder)
        path = self._find_file(pack)
        if self._is_as_stored(pack):
            with report_write_errors():
                path.unlink()
        elif os.path.lexists(path):
            _logger.warning("%s: changed since it was stored, kept", path)

    def _is_as_stored(self, pack: TexturePack) -> bool:
        path = self._find_file(pack)
        if path.is_symlink() or not self.is_installed(pack):
            return False
        contents = {file.path: self._read(pack, file) for file in pack.files}
        return path.read_bytes() == _pack_archive(pack, contents)

    def load_maps(self, pack: TexturePack, name: str) -> MaterialMaps:
        """Load the images of a surface, brought to the albedo and roughness of its material.

        Raises:
            RunError: The pack is not installed, or is damaged.
        """
        surface = pack.surfaces[name]
        images = {
            kind: _decode_image(self._read(pack, file), file)
            for kind, file in surface.files.items()
        }
        roughness = images.get("roughness")
        return encode_photographs(
            images["color"],
            images.get("normal"),
            None if roughness is None else roughness[..., 0],
            MATERIALS[surface.material],
            surface.tile_m,
        )

    def _find_file(self, pack: TexturePack) -> Path:
        return self.folder / f"{pack.name}-{pack.digest[:16]}.zip"

    def _read(self, pack: TexturePack, file: TextureFile) -> bytes:
        path = self._find_file(pack)
        try:
            with zipfile.ZipFile(path) as archive:
                content = archive.read(file.path)
        except (OSError, KeyError, RuntimeError, zipfile.BadZipFile, zlib.error) as error:
            raise RunError(f"{path}: cannot be read: {error}; {_REMEDY}") from error
        if hashlib.sha256(content).hexdigest() != file.sha256:
            raise RunError(f"{path}: {file.path} is not as declared; {_REMEDY}")
        return content


_REMEDY = "`advercity assets install` stores it again"


def format_pack_attribution(pack: TexturePack) -> str:
    """Format the author and licence of every file of a pack, as Markdown."""
    rows = [
        f"| {name} | {file.path} | {pack.author} | {pack.licence} |\n"
        for name, surface in pack.surfaces.items()
        for file in surface.files.values()
    ]
    head = f"# Attribution\n\nFrom {pack.package} {pack.version}; the licence is in LICENSE.\n\n"
    return head + "| surface | file | author | licence |\n|---|---|---|---|\n" + "".join(rows)


def _build_archive(pack: TexturePack, package: Path) -> bytes:
    """Build the archive of the declared files of a package; the same files give the same bytes."""
    try:
        with tarfile.open(package) as archive:
            contents = {file.path: _extract(archive, file) for file in pack.files}
    except (tarfile.TarError, EOFError, OSError, KeyError, ValueError) as error:
        raise RunError(f"{package.name}: is not {pack.package} {pack.version}: {error}") from error
    return _pack_archive(pack, contents)


def _pack_archive(pack: TexturePack, contents: Mapping[str, bytes]) -> bytes:
    attribution = {ATTRIBUTION_FILE: format_pack_attribution(pack).encode()}
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for name, content in {**attribution, **contents}.items():
            archive.writestr(zipfile.ZipInfo(name, _DATE), content)
    return stream.getvalue()


def _extract(archive: tarfile.TarFile, file: TextureFile) -> bytes:
    """Read a declared file of a package into memory; ValueError if it is another one."""
    member = archive.getmember(f"{NPM_FOLDER}/{file.path}")
    stream = archive.extractfile(member) if member.isfile() else None
    content = stream.read() if stream else b""
    if hashlib.sha256(content).hexdigest() != file.sha256:
        raise ValueError(f"{file.path} is not as declared")
    return content


def _decode_image(content: bytes, file: TextureFile) -> Uint8Array:
    """Decode an image to (h, w, 3) RGB or (h, w, 4) RGBA."""
    image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None or image.dtype != np.uint8:
        raise RunError(f"{file.path}: is no image of 8 bits")
    if image.ndim == 2:
        return np.repeat(image[..., None], 3, axis=2).astype(np.uint8)
    channels = [2, 1, 0, 3][: image.shape[2]]
    return np.ascontiguousarray(image[..., channels], np.uint8)
