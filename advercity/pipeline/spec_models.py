"""Compares the models that specs name with those on this machine.

A spec means one picture: a model that is missing, or that this machine converts to something else,
stops a run, unless the user allows a generated body in its place.
"""

from collections.abc import Collection, Iterable

from advercity_dsl import Spec

from advercity.assets.locking import CONVERSION_REMEDY
from advercity.assets.model_store import ModelStore, open_model_store
from advercity.assets.packages import FURNITURE
from advercity.errors import InputError
from advercity.pipeline.cache import find_cache_folder

MAX_LISTED_MODELS = 5
SHAPE_HINT = "or generate bodies of the same sizes instead with `allow_missing_models`"


def check_models(specs: Iterable[Spec], *, allow_missing: bool) -> None:
    """Check that every model of the specs is installed, as the specs have it.

    Raises:
        InputError: One is not, and missing ones are not allowed.
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
        raise InputError("\n".join(f"3-D models: {text}; {SHAPE_HINT}" for text in texts))


def find_missing_models(spec: Spec) -> tuple[str, ...]:
    """Find the blueprints whose models this machine lacks, or converts to something else."""
    return tuple(sorted(_find_problems(spec, open_model_store())))


def replace_models(spec: Spec, blueprints: Collection[str]) -> Spec:
    """Return the spec with generated bodies in place of the models of some blueprints."""
    if not blueprints:
        return spec
    shaped = {
        name: blueprint.model_copy(update={"model": None}) if name in blueprints else blueprint
        for name, blueprint in spec.blueprints.items()
    }
    return spec.model_copy(update={"blueprints": shaped})


def _find_problems(spec: Spec, store: ModelStore) -> dict[str, str]:
    """Describe each model that cannot be used, by blueprint."""
    problems: dict[str, str] = {}
    for name, blueprint in spec.blueprints.items():
        if blueprint.model is None:
            continue
        locked, built = spec.assets.get(f"model/{name}"), store.compute_model_digest(blueprint)
        if locked is None:
            problems[name] = "have no checksum in the spec; compile its library again"
        elif built is None and blueprint.model.file is not None:
            problems[name] = f"are not installed; run `advercity assets add {blueprint.model.file}`"
        elif built is None:
            problems[name] = _describe_missing_package()
        elif built != locked:
            problems[name] = (
                "are converted to other triangles here than the spec has; `advercity assets"
                f" install` converts them again, or {CONVERSION_REMEDY}"
            )
    return problems


def _describe_missing_package() -> str:
    command = "`advercity assets install`"
    earlier = find_cache_folder() / "assets"
    if ModelStore(earlier).has_package:
        return f"are not installed; {command} moves them here from {earlier}"
    size_mb = round(FURNITURE.size_bytes / 1e6)
    return (
        f"are not installed; {command} fetches them ({size_mb} MB; `--from FILE` without a network)"
    )


def _list_names(names: Iterable[str]) -> str:
    listed = list(names)
    more = len(listed) - MAX_LISTED_MODELS
    shown = ", ".join(listed[:MAX_LISTED_MODELS])
    return f"{shown} and {more} more" if more > 0 else shown
