"""Where the cache is, and the keys of its entries, computed from all that these depend on.

Weathers of one road and density share a trace; that is what makes them pairs.
"""

import os
from importlib.metadata import version
from pathlib import Path

from advercity_dsl import Spec

from advercity.dataset.manifest import CODE_PACKAGES
from advercity.digests import compute_json_digest, compute_source_digest


def find_cache_folder() -> Path:
    """Find the cache: `$ADVERCITY_CACHE`, else `advercity` in the user's cache folder."""
    chosen = os.environ.get("ADVERCITY_CACHE")
    if chosen:
        return Path(chosen)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "advercity"


def compute_road_key(spec: Spec) -> str:
    """Compute the key of a road network: code and road, without agents and traffic."""
    road = spec.road.model_dump(mode="json", exclude={"agents", "traffic"})
    return compute_json_digest({"code": _compute_code_digest(), "road": road})


def compute_world_key(spec: Spec) -> str:
    """Compute the key of a world: code, road and bodies."""
    data = spec.model_dump(mode="json", include={"road", "blueprints", "assets"})
    return compute_json_digest({"code": _compute_code_digest(), **data})


def compute_traffic_key(spec: Spec) -> str:
    """Compute the key of a trace: the spec without weather, sensors and appearance.

    The drivers' response to the weather is part of it.
    """
    parts = {"road", "demand", "conflicts", "caution", "reaction", "blueprints", "timing", "agents"}
    data = spec.model_dump(mode="json", include=parts)
    for agent in data["agents"]:
        del agent["sensors"]
    for blueprint in data["blueprints"].values():
        for look in ("shape", "lamps", "model"):
            blueprint.pop(look, None)
    return compute_json_digest({"code": _compute_code_digest(), "seed": spec.seeds.traffic, **data})


def _compute_code_digest() -> str:
    """Compute the digest of the program; any change to it invalidates the cache."""
    return compute_json_digest(
        {"code": compute_source_digest(*CODE_PACKAGES), "eclipse-sumo": version("eclipse-sumo")}
    )
