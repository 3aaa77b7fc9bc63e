"""Images of surfaces in the cache."""

from pathlib import Path

import numpy as np
import pytest

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
