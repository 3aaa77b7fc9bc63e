"""Compares the models and photographs named in specs with those on this machine.

A spec means one picture: a missing or differently converted model stops a run, unless the user
allows generated bodies and surfaces in its place.
"""

from collections.abc import Collection, Iterable

from advercity_dsl import Spec

from advercity.assets.locking import CONVERSION_REMEDY
from advercity.assets.model_store import ModelStore, open_model_store
from advercity.assets.packages import FURNITURE
from advercity.assets.people.package import PEOPLE
from advercity.assets.texture_store import open_texture_store
from advercity.errors import InputError
from advercity.pipeline.cache import find_cache_folder
from advercity.texture_packs import TEXTURE_PACKS

MAX_LISTED_MODELS = 5
SHAPE_HINT = "or generate bodies and surfaces instead with `allow_missing_models`"


def check_models(specs: Iterable[Spec], *, allow_missing: bool) -> None:
    """Check whether all models and photographs of the specs are installed and the same.

    Raises:
        InputError: One is missing or differs, and `allow_missing` is false.
        RunError: A model is installed, but cannot be converted.
    """
    store = open_model_store()
    problems = {
        name: problem for spec in specs for name, problem in _find_problems(spec, store).items()
    }
    if problems and not allow_missing:
        texts = [
            f"{_list_names(name for name, found in problems.items() if found == problem)} {problem}"
            for problem in dict.fromkeys(problems.values())
        ]
        raise InputError(*(f"assets: {text}; {SHAPE_HINT}" for text in texts))


def find_missing_models(spec: Spec) -> tuple[str, ...]:
    """Find the missing and differently converted models and photographs of a spec.

    Returns:
        Blueprints of models, and names of packs of photographs as in the assets of the spec.
    """
    return tuple(sorted(_find_problems(spec, open_model_store())))


def replace_models(spec: Spec, names: Collection[str]) -> Spec:
    """Return the spec without some models and photographs: runs generate them.

    Args:
        spec: The spec.
        names: Blueprints and packs as `find_missing_models` gives them.
    """
    if not names:
        return spec
    shaped = {
        name: blueprint.model_copy(update={"model": None}) if name in names else blueprint
        for name, blueprint in spec.blueprints.items()
    }
    assets = {name: digest for name, digest in spec.assets.items() if name not in names}
    return spec.model_copy(update={"blueprints": shaped, "assets": assets})


def _find_problems(spec: Spec, store: ModelStore) -> dict[str, str]:
    """Describe each unusable model and pack, by blueprint or name of the pack."""
    problems = _find_pack_problems(spec)
    for name, blueprint in spec.blueprints.items():
        if blueprint.model is None:
            continue
        locked, built = spec.assets.get(f"model/{name}"), store.compute_model_digest(blueprint)
        if locked is None:
            problems[name] = "have no checksum in the spec; compile its library again"
        elif built is None and blueprint.model.file is not None:
            problems[name] = f"are not installed; run `advercity assets add {blueprint.model.file}`"
        elif built is None and blueprint.person is not None:
            problems[name] = _describe_download(PEOPLE.size_bytes)
        elif built is None:
            problems[name] = _describe_missing_package()
        elif built != locked:
            problems[name] = (
                "are converted to other triangles here than the spec has; `advercity assets"
                f" install` converts them again, or {CONVERSION_REMEDY}"
            )
    return problems


def _find_pack_problems(spec: Spec) -> dict[str, str]:
    """Describe each unusable pack of photographs, by name."""
    problems: dict[str, str] = {}
    for name, digest in spec.assets.items():
        pack = TEXTURE_PACKS.get(name)
        if name.startswith("textures/") and (pack is None or pack.digest != digest):
            problems[name] = "are of another version of advercity; compile the library again"
        elif pack is not None and not open_texture_store().is_installed(pack):
            problems[name] = _describe_download(pack.size_bytes)
    return problems


def _describe_download(size_bytes: int) -> str:
    size_mb = round(size_bytes / 1e6)
    return (
        f"are not installed; `advercity assets install` fetches them ({size_mb} MB; `--from FILE`"
        " without a network)"
    )


def _describe_missing_package() -> str:
    earlier = find_cache_folder() / "assets"
    if ModelStore(earlier).has_package:
        return f"are not installed; `advercity assets install` copies them here from {earlier}"
    return _describe_download(FURNITURE.size_bytes)


def _list_names(names: Iterable[str]) -> str:
    listed = list(names)
    more = len(listed) - MAX_LISTED_MODELS
    shown = ", ".join(listed[:MAX_LISTED_MODELS])
    return f"{shown} and {more} more" if more > 0 else shown
