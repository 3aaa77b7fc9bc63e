"""Stores models: downloads, users' files, and conversions of both, keyed by their sources."""

import hashlib
import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from advercity_dsl import Blueprint
from advercity_dsl.catalogue import BodyModel

from advercity.assets.model_conversion import CONVERSION_VERSION, convert_model
from advercity.assets.model_files import ModelPart, read_glb, read_obj, to_glb
from advercity.assets.packages import DIGEST_FILE, check_licence, fetch_package, load_source_model
from advercity.atomic_files import write_atomically
from advercity.errors import InputError, RunError, describe_cause


@dataclass(frozen=True)
class ModelStore:
    """A folder of models; blueprints whose models are missing get procedural bodies.

    `package` holds Debian's collections, `own` the users' files by checksum, and `models` the
    converted models of both.
    """

    folder: Path

    @property
    def has_package(self) -> bool:
        """Whether the asset package is installed."""
        return (self._package_folder / DIGEST_FILE).is_file()

    def install_package(self) -> None:
        """Download and unpack the asset package; RunError if that is impossible on this machine."""
        fetch_package(self._package_folder)

    def remove_package(self) -> None:
        """Delete the asset package and all converted models."""
        for folder in (self._package_folder, self.folder / "models"):
            shutil.rmtree(folder, ignore_errors=True)

    def add_model(self, path: Path) -> str:
        """Store a user's GLB and return its SHA-256.

        Raises:
            InputError: It cannot be read, or is not a GLB.
        """
        try:
            content = path.read_bytes()
        except OSError as error:
            raise InputError(f"{path}: cannot be read: {describe_cause(error)}") from error
        if not content.startswith(b"glTF"):
            raise InputError(f"{path}: is not a GLB file; export the model as binary glTF")
        digest = hashlib.sha256(content).hexdigest()
        self._write_once(self._user_model_path(digest), lambda: content)
        return digest

    def prepare_model(self, blueprint: Blueprint) -> Path | None:
        """Return the converted model of a blueprint; None if it names none or it is not installed.

        Raises:
            RunError: The model is installed, but cannot be converted.
        """
        model = blueprint.model
        if model is None:
            return None
        source = self._find_source_digest(model)
        if source is None:
            return None
        # A rider sits on top of the machine, whose model is therefore lower than the box.
        height_m = model.ridden.machine_height_m if model.ridden else blueprint.height_m
        size = (blueprint.length_m, blueprint.width_m, height_m)
        inputs = [CONVERSION_VERSION, source, size, model.model_dump(mode="json")]
        key = hashlib.sha256(json.dumps(inputs, sort_keys=True).encode()).hexdigest()
        path = self.folder / "models" / f"{key}.glb"
        self._write_once(path, lambda: to_glb(convert_model(self._load_parts(model), model, size)))
        return path

    def _find_source_digest(self, model: BodyModel) -> str | None:
        """Find the digest of the file that holds a model; None if it is not installed."""
        if model.pack is not None:
            return (self._package_folder / DIGEST_FILE).read_text() if self.has_package else None
        exists = model.sha256 is not None and self._user_model_path(model.sha256).is_file()
        return model.sha256 if exists else None

    def _load_parts(self, model: BodyModel) -> list[ModelPart]:
        if model.pack is not None:
            source = load_source_model(self._package_folder, model.pack)
            check_licence(model, source)
            return read_obj(source.obj, source.files)
        return read_glb(self._user_model_path(str(model.sha256)).read_bytes(), str(model.file))

    def _write_once(self, path: Path, make: Callable[[], bytes]) -> None:
        """Write a file atomically, unless it exists; other processes may write the same one."""
        if path.is_file():
            return
        content = make()
        try:
            write_atomically(path, content)
        except OSError as error:
            raise RunError(f"{path}: cannot be written: {describe_cause(error)}") from error

    @property
    def _package_folder(self) -> Path:
        return self.folder / "package"

    def _user_model_path(self, digest: str) -> Path:
        return self.folder / "own" / f"{digest}.glb"
