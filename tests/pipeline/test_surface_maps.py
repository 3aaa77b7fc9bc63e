"""Images of surfaces in the cache."""

import hashlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from advercity.pipeline.cache_entries import describe_cache, list_entries
from advercity.pipeline.surface_maps import SurfaceMaps


def test_images_are_baked_once_and_then_come_from_the_cache(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("ADVERCITY_CACHE", str(tmp_path))
    maps = SurfaceMaps()
    assert "kerb" in maps
    assert "unknown" not in maps
    assert not list_entries()

    baked = maps["kerb"]
    assert [row["entries"] for row in describe_cache() if row["kind"] == "maps"] == [1]
    monkeypatch.setattr("advercity.pipeline.surface_maps.bake_maps", pytest.fail)
    loaded = maps["kerb"]
    assert loaded.tile_m == baked.tile_m
    for name in ("color", "normal", "roughness"):
        assert np.array_equal(getattr(loaded, name), getattr(baked, name))
    with pytest.raises(KeyError):
        maps["unknown"]


@pytest.mark.parametrize(
    "changes",
    [
        {"color": None},
        {"color": np.zeros((4, 4, 3), np.uint16)},
        {"normal": np.zeros((4, 4, 3), np.uint8)},
        {"tile_m": np.array(np.nan)},
        {"tile_m": np.zeros(2)},
    ],
)
def test_images_that_were_edited_together_with_their_checksum_are_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, changes: dict[str, NDArray[Any] | None]
):
    monkeypatch.setenv("ADVERCITY_CACHE", str(tmp_path))
    maps = SurfaceMaps()
    baked = maps["kerb"]
    (path,) = tmp_path.glob("maps/*.npz")
    with np.load(path) as stored:
        arrays = {**stored, **changes}
    np.savez(
        path,
        allow_pickle=False,
        **{name: array for name, array in arrays.items() if array is not None},
    )
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    (tmp_path / f"maps/{path.name}.sha256").write_text(f"{digest}  maps/{path.name}\n")
    assert np.array_equal(maps["kerb"].color, baked.color)
    assert maps["kerb"].tile_m == baked.tile_m
