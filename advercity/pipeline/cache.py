"""The folder of the cache, and the keys of its entries: digests of everything they depend on.

An entry depends on the modules that make it and on those that they import. Others may change.

The order of mappings counts, since streets and blueprints are drawn in it. Weathers of one road and
density share a trace, which makes them pairs.
"""

import functools
import os
from importlib.metadata import version
from pathlib import Path
from typing import Any

from advercity_dsl import Spec

from advercity.data_folder import report_missing_home
from advercity.digests import compute_json_digest, compute_source_digest

TRAFFIC_CODE = (
    "advercity_dsl",
    "advercity.array_files",
    "advercity.atomic_files",
    "advercity.compiler",
    "advercity.conflicts",
    "advercity.data_folder",
    "advercity.diagnostics",
    "advercity.digests",
    "advercity.documents",
    "advercity.errors",
    "advercity.foreign",
    "advercity.frames",
    "advercity.geometry",
    "advercity.identity_cache",
    "advercity.materials",
    "advercity.output_files",
    "advercity.physics",
    "advercity.processes",
    "advercity.randomness",
    "advercity.recordings",
    "advercity.roads",
    "advercity.semantics",
    "advercity.signal_heads",
    "advercity.texture_packs",
    "advercity.traffic",
)
"""Modules that make road networks and traces."""

WORLD_CODE = (
    *TRAFFIC_CODE,
    "advercity.assets",
    "advercity.image_files",
    "advercity.material_maps",
    "advercity.media",
    "advercity.scene",
    "advercity.world",
)
"""Modules that make worlds and bodies."""


def find_cache_folder() -> Path:
    """Find the cache: `$ADVERCITY_CACHE`, else `advercity` in the user's cache folder.

    Raises:
        InputError: The user has no home folder.
    """
    chosen = os.environ.get("ADVERCITY_CACHE")
    if chosen:
        return Path(chosen)
    with report_missing_home():
        return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "advercity"


def compute_road_key(spec: Spec) -> str:
    """Compute the key of a road network: code and road, without agents and traffic."""
    road = spec.road.model_dump(mode="json", exclude={"agents", "traffic", "trajectories"})
    return _compute_key(TRAFFIC_CODE, {"road": road})


def compute_world_key(spec: Spec) -> str:
    """Compute the key of a world without bodies: code and road."""
    road = spec.road.model_dump(mode="json", exclude={"trajectories"})
    return _compute_key(WORLD_CODE, {"road": road})


def compute_body_key(spec: Spec, name: str) -> str:
    """Compute the key of the body of a blueprint: code, blueprint and model."""
    blueprint = spec.blueprints[name].model_dump(mode="json")
    return _compute_key(WORLD_CODE, {name: blueprint, "model": spec.assets.get(f"model/{name}")})


def compute_traffic_key(spec: Spec) -> str:
    """Compute the key of a trace: the spec without weather, sensors and appearance.

    The drivers' response to the weather is part of it.
    """
    parts = {"road", "demand", "conflicts", "blueprints", "timing", "agents"}
    parts |= {"caution", "caution_changes", "reaction"}
    data = spec.model_dump(mode="json", include=parts)
    for agent in data["agents"]:
        del agent["sensors"]
    for blueprint in data["blueprints"].values():
        for look in ("shape", "lamps", "model"):
            blueprint.pop(look, None)
    return _compute_key(TRAFFIC_CODE, {"seed": spec.seeds.traffic, **data})


@functools.cache
def find_sumo_version() -> str:
    """Find the installed version of SUMO."""
    return version("eclipse-sumo")


def _compute_key(modules: tuple[str, ...], data: dict[str, Any]) -> str:
    """Compute a key from the sources of modules, SUMO's version and data."""
    code = {
        "code": compute_source_digest(*modules),
        "eclipse-sumo": find_sumo_version(),
    }
    return compute_json_digest({**code, **data}, sort_keys=False)
