"""Images of surfaces for a world, made on first use and kept in the cache."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from advercity.array_files import load_arrays
from advercity.assets.maps.catalogue import BAKED_SURFACES, bake_maps
from advercity.assets.texture_store import open_texture_store
from advercity.digests import compute_json_digest, compute_source_digest
from advercity.errors import RunError
from advercity.material_maps import MaterialMaps
from advercity.pipeline.cache_entries import ensure_entry, load_or_build_entry
from advercity.texture_packs import TexturePack

MAX_MAPS_BYTES = 2**28
_CODE = (
    "advercity.assets.maps",
    "advercity.assets.texture_store",
    "advercity.materials",
    "advercity.randomness",
)
"""Sources the images depend on; other changes of the program do not invalidate them."""


class SurfaceMaps(Mapping[str, MaterialMaps]):
    """Images of surfaces by name: photographs of a pack, else baked ones.

    A lookup loads a surface from the cache, or makes it in half a second.

    Args:
        packs: Installed packs.
        models: Images of models, under other names.
    """

    def __init__(
        self,
        packs: Iterable[TexturePack] = (),
        models: Mapping[str, MaterialMaps] = MappingProxyType({}),
    ) -> None:
        self._models = models
        self._packs = {name: pack for pack in packs for name in pack.surfaces}
        self._names = {**BAKED_SURFACES, **self._packs}

    def __getitem__(self, name: str) -> MaterialMaps:
        if name not in self._names:
            return self._models[name]
        return load_or_build_entry(*self._describe_entry(name), _load_maps)

    def list_checksums(self) -> list[str]:
        """List the SHA-256 of the entries of all surfaces; make missing entries."""
        return [ensure_entry(*self._describe_entry(name), _load_maps) for name in self._names]

    def _describe_entry(self, name: str) -> tuple[str, Callable[[Path], None]]:
        """Return the name of a surface's entry, and a function to write it."""
        pack = self._packs.get(name)
        return (
            f"maps/{_compute_key(name, pack)}.npz",
            lambda partial: _save_maps(_make_maps(name, pack), partial),
        )

    def __contains__(self, name: object) -> bool:
        return name in self._names or name in self._models

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)


def _make_maps(name: str, pack: TexturePack | None) -> MaterialMaps:
    return open_texture_store().load_maps(pack, name) if pack else bake_maps(name)


def _compute_key(name: str, pack: TexturePack | None) -> str:
    source = {"surface": name, "pack": asdict(pack) if pack else None}
    return compute_json_digest({**source, "code": compute_source_digest(*_CODE)})


def _save_maps(maps: MaterialMaps, path: Path) -> None:
    arrays: dict[str, Any] = {
        "color": maps.color,
        "normal": maps.normal,
        "roughness": maps.roughness,
        "tile_m": maps.tile_m,
    }
    np.savez(path, **{name: array for name, array in arrays.items() if array is not None})


def _load_maps(path: Path) -> MaterialMaps:
    """Load a file of `_save_maps`; RunError if it is another file."""
    arrays = load_arrays(path, max_bytes=MAX_MAPS_BYTES)
    try:
        maps = MaterialMaps(
            color=arrays["color"],
            normal=arrays.get("normal"),
            roughness=arrays.get("roughness"),
            tile_m=float(arrays["tile_m"]),
        )
        _check_images(maps)
    except (KeyError, TypeError, ValueError) as error:
        raise RunError(f"{path}: not images of a surface: {error}") from error
    return maps


def _check_images(maps: MaterialMaps) -> None:
    """Raise ValueError unless the images fit each other."""
    height, width, channels = maps.color.shape
    images = [
        (maps.color, (height, width, 4 if channels == 4 else 3)),
        (maps.normal, (height, width, 3)),
        (maps.roughness, (height, width)),
    ]
    for image, shape in images:
        if image is not None and (image.dtype != np.uint8 or image.shape != shape):
            raise ValueError(f"{image.dtype} {image.shape} where {shape} bytes belong")
    if not 0 < maps.tile_m < math.inf:
        raise ValueError(f"{maps.tile_m} m wide")
