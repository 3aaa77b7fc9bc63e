"""Images of surfaces in the cache."""

import hashlib
import os
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from advercity_dsl import Spec
from numpy.typing import NDArray

from advercity.pipeline import RunOptions
from advercity.pipeline.cache import find_cache_folder
from advercity.pipeline.cache_entries import describe_cache, list_entries
from advercity.pipeline.preparation import prepare_scenario
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
    kept = {name: array for name, array in arrays.items() if array is not None}
    np.savez(tmp_path / "edited.npz", allow_pickle=False, **kept)
    replace_entry(path, (tmp_path / "edited.npz").read_bytes())
    assert np.array_equal(maps["kerb"].color, baked.color)
    assert maps["kerb"].tile_m == baked.tile_m


@pytest.mark.sumo
def test_a_scenario_is_not_continued_with_edited_images_of_a_surface(
    specs: dict[str, Spec], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    spec, options = specs["rsnj_clear_day_sparse"], RunOptions(tmp_path / "output", backend="fake")
    before = prepare_scenario(spec, options).identity
    # Linked, since everything else of the cache is used and not changed.
    shutil.copytree(find_cache_folder(), tmp_path / "cache", copy_function=os.link)
    monkeypatch.setenv("ADVERCITY_CACHE", str(tmp_path / "cache"))
    assert prepare_scenario(spec, options).identity == before
    baked, edited = SurfaceMaps()["kerb"], b""
    for path in (tmp_path / "cache").glob("maps/*.npz"):
        with np.load(path) as stored:
            arrays = dict(stored)
        if arrays["color"].shape == baked.color.shape and (arrays["color"] == baked.color).all():
            np.savez(tmp_path / "edited.npz", **{**arrays, "color": 255 - arrays["color"]})
            edited = (tmp_path / "edited.npz").read_bytes()
            replace_entry(path, edited)
    assert edited
    assert np.array_equal(SurfaceMaps()["kerb"].color, 255 - baked.color)
    assert prepare_scenario(spec, options).identity.world_sha256 != before.world_sha256


def replace_entry(path: Path, content: bytes) -> None:
    """Replace an entry of the cache and its checksum, and nothing that is linked to them."""
    checksum = path.with_name(f"{path.name}.sha256")
    for file, text in (
        (path, content),
        (checksum, f"{hashlib.sha256(content).hexdigest()}  maps/{path.name}\n".encode()),
    ):
        file.unlink()
        file.write_bytes(text)
