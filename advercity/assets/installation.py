"""Installs third-party assets of specs: furniture models, people, photographs of surfaces."""

from collections.abc import Callable
from pathlib import Path

from advercity.assets.downloads import AssetPackage
from advercity.assets.locking import CONVERSION_REMEDY, find_differing_models
from advercity.assets.model_store import ModelStore, open_model_store
from advercity.assets.texture_store import describe_package, open_texture_store
from advercity.compiler.library import load_library
from advercity.compiler.shipped_library import find_shipped_library
from advercity.errors import RunError
from advercity.texture_packs import TEXTURE_PACKS


def install_assets(source: Path | None, earlier: Path, report: Callable[[str], None]) -> list[str]:
    """Install all missing packages, and check the models made of them.

    Args:
        source: A package file, installed alone, or a folder of them; None downloads them.
        earlier: Folder of models of earlier versions, which are copied.
        report: Takes a line about every step.

    Returns:
        The failures, as texts.

    Raises:
        InputError: `source` does not exist, or is another file.
    """
    store, textures = open_model_store(), open_texture_store()
    if store.adopt(ModelStore(earlier)):
        report(f"models of an earlier version: copied from {earlier} to {store.folder}")
    steps: dict[AssetPackage, Callable[[], None]] = {}
    if not store.has_package:
        steps[store.package] = lambda: store.install_package(source)
    if not store.has_people:
        steps[store.people_package] = lambda: store.install_people(source)
    for pack in TEXTURE_PACKS.values():
        if not textures.is_installed(pack):
            steps[describe_package(pack)] = lambda pack=pack: textures.install(pack, source)
    given = [package for package in steps if package.is_for(source)]
    for package in steps:
        report(f"{package}{'' if package in given else ': is not installed'}")
    failures = [failure for package in given if (failure := _try(steps[package]))]
    if (store.has_package or store.has_people) and (failure := _try(lambda: _check_models(store))):
        failures.append(failure)
    if not failures and len(given) == len(steps):
        report(f"{store.folder}: models, people and photographs are installed")
    return failures


def _try(step: Callable[[], None]) -> str:
    """Return the message of a RunError, or an empty one."""
    try:
        step()
    except RunError as error:
        return str(error)
    return ""


def _check_models(store: ModelStore) -> None:
    """Convert all models of the shipped library and compare them with its lock."""
    library = load_library(find_shipped_library())
    if find_differing_models(library, store):
        store.remove_converted_models()
    differing = find_differing_models(library, store)
    if differing:
        raise RunError(
            f"{', '.join(differing)}: converted to other triangles here than locked;"
            f" {CONVERSION_REMEDY}"
        )
