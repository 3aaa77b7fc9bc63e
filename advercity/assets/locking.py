"""Locks the models of catalogues: writes their checksums as built next to the catalogues' files."""

from pathlib import Path

from advercity_dsl import Blueprint, Catalogue

from advercity.assets.model_conversion import CONVERSION_VERSION, format_model_name
from advercity.assets.model_store import ModelStore
from advercity.compiler.extends import ResolvedDeclaration
from advercity.compiler.library import Library, find_model_file
from advercity.compiler.model_locks import (
    LockedModel,
    ModelLock,
    compute_declared_digest,
    find_inherited_model,
    find_lock_file,
    find_locked_model,
    read_lock,
)
from advercity.errors import RunError

CONVERSION_REMEDY = (
    "install the versions of numpy, trimesh, embreex and fast-simplification in requirements.lock,"
    " or make specs for this machine with `advercity assets lock` and `advercity compile`"
)
"""Remedy if a model is converted to something else than locked."""


def build_locks(library: Library, store: ModelStore) -> dict[Path, str]:
    """Build the lock of every catalogue with models of its own: its text by its file.

    Users' GLB files are added to the store. Assets not installed keep their locked checksums.

    Raises:
        InputError: A GLB file cannot be read, or a lock is damaged or another file.
        RunError: A model is neither installed nor locked, or cannot be converted.
    """
    texts: dict[Path, str] = {}
    for catalogue in library.get_declarations(Catalogue).values():
        source = library.find_entry(catalogue).source
        models = {
            name: LockedModel(declared=compute_declared_digest(blueprint), built=built)
            for name, blueprint in catalogue.blueprints.items()
            if (built := _find_built_digest(name, blueprint, source, store))
        }
        if models:
            packages = {store.package.name: store.package.sha256}
            lock = ModelLock(conversion=CONVERSION_VERSION, packages=packages, models=models)
            path = find_lock_file(source.document.path)
            # The text replaces the file, which may be another than a lock.
            read_lock(path)
            texts[path] = lock.to_json()
    return texts


def find_differing_models(library: Library, store: ModelStore) -> list[str]:
    """Find the blueprints whose installed model is converted to other triangles than locked."""
    differing: list[str] = []
    for catalogue in library.get_declarations(Catalogue).values():
        source = library.find_entry(catalogue).source
        for name, blueprint in catalogue.blueprints.items():
            built = store.compute_model_digest(blueprint)
            if built is not None and built != find_inherited_model(source, name, blueprint):
                differing.append(name)
    return differing


def _find_built_digest(
    name: str, blueprint: Blueprint, source: ResolvedDeclaration, store: ModelStore
) -> str | None:
    """Find the checksum of a model as built; None without a model, or if a parent's lock has it."""
    model = blueprint.model
    if model is None:
        return None
    if model.file is not None:
        store.add_model(find_model_file(name, model.file, source))
    own, declaring = source.document.path, source.find_document(("blueprints", name, "model")).path
    locked = find_locked_model(declaring, name, blueprint)
    built = store.compute_model_digest(blueprint) or locked
    if own != declaring and built == locked:
        return None
    if built is None:
        raise RunError(
            f"{own}: {format_model_name(model)} is neither installed nor locked;"
            " `advercity assets install` fetches models"
        )
    return built
