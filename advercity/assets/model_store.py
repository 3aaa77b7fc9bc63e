"""Stores models: downloads, users' files, and conversions of both, keyed by their sources."""

import hashlib
import json
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from advercity_dsl import Blueprint, PedestrianAppearance
from advercity_dsl.catalogue import BodyModel

from advercity.assets.downloads import AssetPackage
from advercity.assets.model_conversion import (
    CONVERSION_VERSION,
    convert_model,
    project_model_images,
)
from advercity.assets.model_files import (
    ModelPart,
    compute_parts_digest,
    read_glb,
    read_obj,
    to_glb,
)
from advercity.assets.model_images import (
    StoredImages,
    compute_images_digest,
    find_images_file,
    pack_images,
    read_images,
)
from advercity.assets.package_folders import is_unpacked, remove_package
from advercity.assets.packages import (
    FURNITURE,
    check_licence,
    copy_package,
    install_package,
    load_source_model,
)
from advercity.assets.people.base_mesh import load_base_mesh
from advercity.assets.people.casting import draw_people
from advercity.assets.people.conversion import PEOPLE_VERSION, RiggedPerson, convert_person
from advercity.assets.people.package import (
    PEOPLE,
    check_people_licence,
    install_people,
)
from advercity.assets.people.storage import compute_people_digest, pack_people
from advercity.atomic_files import check_is_no_link, write_atomically
from advercity.data_folder import find_data_folder
from advercity.digests import compute_json_digest
from advercity.documents import MAX_MODEL_BYTES, read_bytes
from advercity.errors import InputError, RunError, describe_cause, report_write_errors
from advercity.geometry.mesh import Size


def open_model_store() -> "ModelStore":
    """Open the store of models in the data folder."""
    return ModelStore(find_data_folder() / "assets")


@dataclass(frozen=True)
class ModelStore:
    """A folder of models.

    `package` holds Debian's collections, `own` the users' files by checksum, and `models` the
    converted models of both. `people` holds the base mesh of people.
    """

    folder: Path
    package: AssetPackage = FURNITURE
    people_package: AssetPackage = PEOPLE

    @property
    def people_folder(self) -> Path:
        """Folder of the unpacked package of people."""
        return self.folder / "people"

    @property
    def package_folder(self) -> Path:
        """Folder of the unpacked asset package."""
        return self.folder / "package"

    @property
    def has_package(self) -> bool:
        """Whether the asset package is installed, in the supported version."""
        return is_unpacked(self.package, self.package_folder)

    @property
    def has_people(self) -> bool:
        """Whether the package of people is installed, in the supported version."""
        return is_unpacked(self.people_package, self.people_folder)

    def install_people(self, source: Path | None = None) -> None:
        """Unpack the package of people from a file or folder, or download it.

        Raises:
            InputError: `source` does not exist, or is another file.
            RunError: It cannot be downloaded, or lacks a file.
        """
        install_people(self.people_package, self.people_folder, source)

    def install_package(self, source: Path | None = None) -> None:
        """Unpack the asset package from a file or folder, or download it.

        Raises:
            InputError: `source` does not exist, or is another file.
            RunError: It cannot be downloaded.
        """
        install_package(self.package, self.package_folder, source)

    def adopt(self, earlier: "ModelStore") -> bool:
        """Copy the package and the users' files of another store here, unless this one has them.

        The other store keeps them: another data folder may be in use for a while only.

        Returns:
            Whether anything was copied.

        Raises:
            InputError: A user's file is not a model, or the package's folder holds other files.
        """
        is_wanted = earlier.has_package and not self.has_package
        if is_wanted:
            copy_package(self.package, earlier.package_folder, self.package_folder)
        had = len(_list_stored_models(self.folder / "own"))
        for path in _list_stored_models(earlier.folder / "own"):
            self.add_model(path)
        return is_wanted or len(_list_stored_models(self.folder / "own")) > had

    def remove_package(self) -> None:
        """Delete the asset packages, but for changed files, and all converted models.

        Raises:
            InputError: A folder is a link, or a package was unpacked by an earlier version.
        """
        remove_package(self.package_folder)
        remove_package(self.people_folder)
        self.remove_converted_models()

    def add_model(self, path: Path) -> str:
        """Store a user's GLB, in place of a damaged copy of it if need be; return its SHA-256.

        Raises:
            InputError: It cannot be read, or is not a GLB.
        """
        try:
            content = read_bytes(path, max_bytes=MAX_MODEL_BYTES)
        except OSError as error:
            raise InputError(f"{path}: cannot be read: {describe_cause(error)}") from error
        if not content.startswith(b"glTF"):
            raise InputError(f"{path}: is not a GLB file; export the model as binary glTF")
        digest = hashlib.sha256(content).hexdigest()
        stored = self._user_model_path(digest)
        if not stored.is_file() or _compute_file_digest(stored) != digest:
            _write_file(stored, content)
        return digest

    def prepare_model(self, blueprint: Blueprint) -> Path | None:
        """Return the converted model of a blueprint; None if it names none or it is not installed.

        Images of models other than people are stored where `find_images_file` says.

        Raises:
            RunError: The model is installed, but cannot be converted.
        """
        model = blueprint.model
        source = None if model is None else self._find_source_digest(model)
        if model is None or source is None:
            return None
        path, size = self._find_converted_file(blueprint, source), blueprint.model_size
        if model.person is not None:
            self._write_once(path, lambda: pack_people(self._convert_people(blueprint)))
        else:
            self._write_once(
                path, lambda: to_glb(convert_model(self._load_parts(model), model, size))
            )
            self._write_once(
                find_images_file(path), lambda: self._project_images(path, model, size)
            )
        return path

    def compute_model_digest(self, blueprint: Blueprint) -> str | None:
        """Compute the SHA-256 of a converted model; None if it is not installed.

        Raises:
            RunError: The model is installed, but cannot be converted or read.
        """
        path = self.prepare_model(blueprint)
        if path is not None and blueprint.person is not None:
            return compute_people_digest(path)
        return compute_parts_digest(read_glb(path.read_bytes(), path.name)) if path else None

    def compute_images_digest(self, blueprint: Blueprint) -> str | None:
        """Compute the SHA-256 of a model's images; None if it has none, or is not installed.

        Raises:
            RunError: The model is installed, but cannot be converted, or its images not be read.
        """
        path = self.prepare_model(blueprint)
        if path is None or blueprint.person is not None:
            return None
        return compute_images_digest(read_images(find_images_file(path)))

    def remove_converted_models(self) -> None:
        """Delete all converted models; they are converted again where they are needed.

        Raises:
            InputError: Their folder is a link.
        """
        check_is_no_link(self.folder / "models")
        with report_write_errors():
            for path in _list_stored_models(self.folder / "models"):
                path.unlink(missing_ok=True)

    def _find_converted_file(self, blueprint: Blueprint, source: str) -> Path:
        assert blueprint.model is not None
        declared: list[object] = [blueprint.model.model_dump(mode="json")]
        version, suffix = CONVERSION_VERSION, "glb"
        if blueprint.person is not None:
            declared.append(blueprint.looks and blueprint.looks.model_dump(mode="json"))
            version, suffix = PEOPLE_VERSION, "npz"
        inputs = [version, source, blueprint.model_size, *declared]
        key = hashlib.sha256(json.dumps(inputs, sort_keys=True).encode()).hexdigest()
        return self.folder / "models" / f"{key}.{suffix}"

    def _find_source_digest(self, model: BodyModel) -> str | None:
        """Find the digest of the file with a model; None if it is not installed."""
        if model.pack is not None:
            return self.package.sha256 if self.has_package else None
        if model.person is not None:
            return self.people_package.sha256 if self.has_people else None
        exists = model.sha256 is not None and self._user_model_path(model.sha256).is_file()
        return model.sha256 if exists else None

    def _load_parts(self, model: BodyModel) -> list[ModelPart]:
        if model.pack is not None:
            source = load_source_model(self.package_folder, model.pack)
            check_licence(model, source)
            return read_obj(source.obj, source.files)
        path = self._user_model_path(str(model.sha256))
        if _compute_file_digest(path) != model.sha256:
            raise RunError(
                f"{path}: is damaged; `advercity assets add` with {model.file} renews it"
            )
        return read_glb(path.read_bytes(), str(model.file))

    def _project_images(self, path: Path, model: BodyModel, size: Size) -> bytes:
        converted = read_glb(path.read_bytes(), path.name)
        return pack_images(project_model_images(self._load_parts(model), converted, model, size))

    @property
    def images(self) -> StoredImages:
        """The images of converted models."""
        return StoredImages(self.folder / "models")

    def _convert_people(self, blueprint: Blueprint) -> list[RiggedPerson]:
        assert blueprint.model is not None and blueprint.person is not None
        check_people_licence(blueprint.model)
        looks = blueprint.looks or PedestrianAppearance()
        size = blueprint.model_size
        key = compute_json_digest([blueprint.person.model_dump(), looks.model_dump(), size])
        base = load_base_mesh(self.people_folder)
        return [
            convert_person(base, *drawn, size[2])
            for drawn in draw_people(blueprint.person, looks, size[2], key)
        ]

    def _write_once(self, path: Path, make: Callable[[], bytes]) -> None:
        """Write a file atomically, unless it exists; other processes may write the same one."""
        if path.is_file():
            return
        _write_file(path, make())

    def _user_model_path(self, digest: str) -> Path:
        return self.folder / "own" / f"{digest}.glb"


def _write_file(path: Path, content: bytes) -> None:
    try:
        write_atomically(path, content)
    except OSError as error:
        raise RunError(f"{path}: cannot be written: {describe_cause(error)}") from error


def _compute_file_digest(path: Path) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _list_stored_models(folder: Path) -> list[Path]:
    """List the models in a folder of the store; other files are a user's."""
    return [
        path for path in folder.glob("*") if re.fullmatch(r"[0-9a-f]{64}\.(glb|npz)", path.name)
    ]
