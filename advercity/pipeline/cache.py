"""What many runs share, kept by content: networks, traces and worlds.

Weathers of one road and density share a trace; that is what makes them pairs.
"""

import hashlib
import os
import tempfile
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path

from advercity_dsl import Spec

from advercity.assets.model_store import ModelStore
from advercity.dataset.manifest import CODE_PACKAGES
from advercity.digests import compute_json_digest, compute_source_digest
from advercity.errors import RunError


def find_cache_folder() -> Path:
    """`$ADVERCITY_CACHE`, else `advercity` in the user's cache folder."""
    chosen = os.environ.get("ADVERCITY_CACHE")
    if chosen:
        return Path(chosen)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "advercity"


def compute_road_key(spec: Spec) -> str:
    """Of everything that the network depends on."""
    road = spec.road.model_dump(mode="json", exclude={"agents", "traffic"})
    return compute_json_digest({"code": _compute_code_digest(), "road": road})


def compute_world_key(spec: Spec) -> str:
    """Of everything that the world depends on: the road, its bodies, and whose way stays clear."""
    data = spec.model_dump(mode="json", include={"road", "blueprints", "conflicts"})
    return compute_json_digest(
        {"code": _compute_code_digest(), "models": compute_model_digests(spec), **data}
    )


def open_model_store() -> ModelStore:
    """Where models of bodies lie: in `$ADVERCITY_ASSETS`, else in the cache's `assets`."""
    chosen = os.environ.get("ADVERCITY_ASSETS")
    return ModelStore(Path(chosen) if chosen else find_cache_folder() / "assets")


def compute_model_digests(spec: Spec) -> dict[str, str]:
    """SHA-256 of the model that stands for each blueprint that has one here.

    Raises:
        RunError: A model is here, but cannot be used.
    """
    found = {
        name: open_model_store().prepare_model(blueprint)
        for name, blueprint in spec.blueprints.items()
    }
    return {
        name: hashlib.sha256(path.read_bytes()).hexdigest()
        for name, path in found.items()
        if path is not None
    }


def compute_traffic_key(spec: Spec) -> str:
    """Of everything that the trace depends on: all of the spec but weather, sensors and looks.

    Of the weather it holds what drivers do about it.
    """
    parts = {"road", "demand", "conflicts", "caution", "blueprints", "timing", "agents"}
    data = spec.model_dump(mode="json", include=parts)
    for agent in data["agents"]:
        del agent["sensors"]
    for blueprint in data["blueprints"].values():
        for look in ("shape", "lamps", "model"):
            blueprint.pop(look, None)
    return compute_json_digest({"code": _compute_code_digest(), "seed": spec.seeds.traffic, **data})


def _compute_code_digest() -> str:
    """Of the whole program: a changed one keeps nothing of what the old one made."""
    return compute_json_digest(
        {"code": compute_source_digest(*CODE_PACKAGES), "eclipse-sumo": version("eclipse-sumo")}
    )


def build_cached(path: Path, build: Callable[[Path], None]) -> Path:
    """`path`, made by `make(partial path)` if it is not there yet; whole or absent."""
    if path.is_file():
        return path
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=path.parent) as folder:
            partial = Path(folder) / path.name
            build(partial)
            partial.replace(path)
    except OSError as error:
        message = f"{error.filename or path}: cannot be written: {error.strerror}"
        raise RunError(f"{message}; set ADVERCITY_CACHE to a folder that can") from error
    return path
