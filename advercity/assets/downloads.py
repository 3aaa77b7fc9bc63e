"""Fetches pinned packages: from a file or folder, or with the client of their registry."""

import hashlib
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from advercity.errors import InputError, RunError

Registry = Literal["debian", "npm", "pypi"]


@dataclass(frozen=True)
class AssetPackage:
    """The one supported version of a package of assets.

    Attributes:
        name: Name of the package.
        version: Its version.
        sha256: SHA-256 of the package file.
        size_bytes: Its size.
        registry: Where it is from.
        collections: Names of the files of models to unpack from Debian's.
    """

    name: str
    version: str
    sha256: str
    size_bytes: int
    registry: Registry = "debian"
    collections: tuple[str, ...] = ()

    @property
    def file_name(self) -> str:
        """Name of the package file as downloaded by the registry's client."""
        if self.registry == "npm":
            return f"{self.name.removeprefix('@').replace('/', '-')}-{self.version}.tgz"
        if self.registry == "pypi":
            return f"{self.name}-{self.version}-py3-none-any.whl"
        return f"{self.name}_{self.version}_all.deb"

    @property
    def command(self) -> list[str]:
        """Command for downloading the package file into the current folder, without root."""
        if self.registry == "npm":
            return ["npm", "pack", "--silent", f"{self.name}@{self.version}"]
        if self.registry == "pypi":
            return ["pip", "download", "-q", "--no-deps", f"{self.name}=={self.version}"]
        return ["apt-get", "download", "-q", f"{self.name}={self.version}"]

    def is_for(self, source: Path | None) -> bool:
        """Return whether a source may have this package: any but a file of another registry."""
        if source is None or source.is_dir():
            return True
        return source.suffix == Path(self.file_name).suffix

    def __str__(self) -> str:
        return f"{self.file_name} ({round(self.size_bytes / 1e6)} MB)"


def fetch_package(package: AssetPackage, work: Path, source: Path | None) -> Path:
    """Find a package file or download it into a folder; its checksum is right.

    Args:
        package: The package.
        work: Folder for the download.
        source: The package file, or a folder with it; None downloads it.

    Raises:
        InputError: `source` does not exist, or is another file.
        RunError: It cannot be downloaded.
    """
    if source is None:
        return _download_package(package, work)
    path = source / package.file_name if source.is_dir() else source
    if not path.is_file():
        raise InputError(f"{path}: no such file; it is {_describe_source(package)}")
    if not _has_checksum(package, path):
        raise InputError(
            f"{path}: is not {package.name} {package.version}, whose SHA-256 is {package.sha256};"
            f" take {_describe_source(package)}"
        )
    return path


def _describe_source(package: AssetPackage) -> str:
    if package.registry == "debian":
        return f"{package.file_name} of any Debian mirror"
    return f"the file downloaded by `{' '.join(package.command)}`"


def _download_package(package: AssetPackage, work: Path) -> Path:
    try:
        path = _run_client(package, work)
        if _has_checksum(package, path):
            return path
        failure = f"{path.name} has another SHA-256"
    except OSError as error:
        failure = str(error)
    raise RunError(
        f"{package.name} {package.version} cannot be downloaded ({failure}); take"
        f" {_describe_source(package)}, then `advercity assets install --from {package.file_name}`"
    )


def _run_client(package: AssetPackage, work: Path) -> Path:
    """Download a package with its registry's client, which knows this machine's mirror."""
    client, *arguments = package.command
    # An environment without activation has its own pip next to its interpreter.
    program = shutil.which(client) or shutil.which(client, path=str(Path(sys.executable).parent))
    if program is None:
        raise FileNotFoundError(f"there is no {client}")
    done = subprocess.run(  # noqa: S603 - the user's own package manager
        [program, *arguments], cwd=work, capture_output=True, text=True, check=False
    )
    path = work / package.file_name
    if done.returncode != 0 or not path.is_file():
        messages = done.stderr.strip().splitlines() or ["no error message"]
        raise OSError(f"{client}: {messages[-1]}")
    return path


def _has_checksum(package: AssetPackage, path: Path) -> bool:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest() == package.sha256
