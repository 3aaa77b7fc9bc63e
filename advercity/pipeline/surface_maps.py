"""Images of surfaces for a world: each is baked when it is first needed, and kept in the cache."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from advercity.array_files import load_arrays
from advercity.assets.maps.catalogue import BAKED_SURFACES, bake_maps
from advercity.digests import compute_json_digest, compute_source_digest
from advercity.material_maps import MaterialMaps
from advercity.pipeline.cache_entries import load_or_build_entry

MAX_MAPS_BYTES = 2**28
_CODE = ("advercity.assets.maps", "advercity.materials", "advercity.randomness")
"""What decides the images; other changes of the program leave them as they are."""


class BakedMaps(Mapping[str, MaterialMaps]):
    """The images of all baked surfaces by name.

    Looking one up loads it from the cache, or bakes it, which takes half a second.
    """

    def __getitem__(self, name: str) -> MaterialMaps:
        if name not in BAKED_SURFACES:
            raise KeyError(name)
        return load_or_build_entry(
            f"maps/{_compute_key(name)}.npz",
            lambda partial: _save_maps(bake_maps(name), partial),
            _load_maps,
        )

    def __contains__(self, name: object) -> bool:
        return name in BAKED_SURFACES

    def __iter__(self) -> Iterator[str]:
        return iter(BAKED_SURFACES)

    def __len__(self) -> int:
        return len(BAKED_SURFACES)


def _compute_key(name: str) -> str:
    return compute_json_digest({"surface": name, "code": compute_source_digest(*_CODE)})


def _save_maps(maps: MaterialMaps, path: Path) -> None:
    arrays: dict[str, Any] = {
        "color": maps.color,
        "normal": maps.normal,
        "roughness": maps.roughness,
        "tile_m": maps.tile_m,
    }
    np.savez(path, **{name: array for name, array in arrays.items() if array is not None})


def _load_maps(path: Path) -> MaterialMaps:
    arrays = load_arrays(path, max_bytes=MAX_MAPS_BYTES)
    return MaterialMaps(
        color=arrays["color"],
        normal=arrays.get("normal"),
        roughness=arrays.get("roughness"),
        tile_m=float(arrays["tile_m"]),
    )
