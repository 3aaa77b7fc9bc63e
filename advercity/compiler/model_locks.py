"""Locks of catalogues: the checksum of each 3-D model as built, in a file next to the catalogue.

`advercity assets lock` writes them. Specs take checksums from here: compiling needs no models.
"""

from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path

from advercity_dsl import Blueprint, Catalogue, Id, Model
from advercity_dsl.base import Digest
from pydantic import ValidationError

from advercity.compiler.extends import ResolvedDeclaration
from advercity.compiler.library import Library
from advercity.diagnostics import Diagnostic, DiagnosticsError
from advercity.digests import compute_json_digest
from advercity.documents import parse_json, read_text
from advercity.errors import InputError


class LockedModel(Model):
    """A model of a blueprint.

    Attributes:
        declared: SHA-256 of its sources, `compute_declared_digest`.
        built: SHA-256 of the converted model.
    """

    declared: Digest
    built: Digest


class ModelLock(Model):
    """The models of a catalogue by blueprint, and the tools of their conversion.

    Attributes:
        conversion: Version of the conversion.
        packages: SHA-256 of the installed asset packages.
        models: Models by blueprint.
    """

    conversion: int
    packages: dict[str, Digest]
    models: dict[Id, LockedModel]

    def to_json(self) -> str:
        """Format it as JSON with sorted blueprints."""
        ordered = self.model_copy(update={"models": dict(sorted(self.models.items()))})
        return ordered.model_dump_json(indent=1) + "\n"


def find_lock_file(catalogue: Path) -> Path:
    """Return the lock of a catalogue's file: `adver_city.lock.json` of `adver_city.yaml`."""
    return catalogue.with_suffix(".lock.json")


def read_lock(path: Path) -> ModelLock | None:
    """Read a lock; None if there is none.

    Raises:
        InputError: It is damaged, or not a file.
    """
    if not path.exists():
        return None
    try:
        return ModelLock.model_validate(parse_json(read_text(path), path))
    except ValidationError:
        remedy = "delete it, and `advercity assets lock` with the folders of the library makes one"
        raise InputError(f"{path}: is not a lock of models; {remedy}") from None


def compute_declared_digest(blueprint: Blueprint) -> str:
    """Compute the SHA-256 of a model's declaration, its size, and a person's looks."""
    assert blueprint.model is not None
    declared = [blueprint.model.model_dump(mode="json"), blueprint.model_size]
    if blueprint.person is not None and blueprint.looks is not None:
        declared.append(blueprint.looks.model_dump(mode="json"))
    return compute_json_digest(declared)


ReadLock = Callable[[Path], ModelLock | None]


def find_locked_model(
    catalogue: Path, name: str, blueprint: Blueprint, read: ReadLock = read_lock
) -> str | None:
    """Find the checksum of a blueprint's model in the lock of a catalogue's file.

    Returns:
        None if the lock lacks it, or has it with another declaration or size.

    Raises:
        InputError: The lock is damaged.
    """
    lock = read(find_lock_file(catalogue))
    locked = lock.models.get(name) if lock else None
    is_current = locked is not None and locked.declared == compute_declared_digest(blueprint)
    return locked.built if locked is not None and is_current else None


def find_inherited_model(
    source: ResolvedDeclaration, name: str, blueprint: Blueprint, read: ReadLock = read_lock
) -> str | None:
    """Find the checksum in the lock of a catalogue, or of the catalogue with the model."""
    own, declaring = source.document, source.find_document(("blueprints", name, "model"))
    paths = dict.fromkeys((own.path, declaring.path))
    found = (find_locked_model(path, name, blueprint, read) for path in paths)
    return next(filter(None, found), None)


def list_model_assets(
    library: Library, catalogue: Catalogue, blueprints: Mapping[str, Blueprint]
) -> dict[str, str]:
    """List the checksums of the models of blueprints as assets of a spec.

    Raises:
        DiagnosticsError: A model is not locked, or was declared otherwise when it was.
        InputError: A lock is damaged.
    """
    assets: dict[str, str] = {}
    diagnostics: list[Diagnostic] = []
    source, read = library.find_entry(catalogue).source, cache(read_lock)
    for name, blueprint in blueprints.items():
        if blueprint.model is None:
            continue
        built = find_inherited_model(source, name, blueprint, read)
        if built is None:
            message = "the lock of the catalogue lacks this model, or has it otherwise declared"
            hint = "`advercity assets lock` with the folders of the library writes it"
            value_path = ("blueprints", name, "model")
            diagnostics.append(source.build_diagnostic(value_path, message, hint=hint))
        else:
            assets[f"model/{name}"] = built
    if diagnostics:
        raise DiagnosticsError(*diagnostics)
    return assets
