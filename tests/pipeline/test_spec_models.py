"""A run without the models of its spec, or of an edited one, stops unless that is allowed."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import pytest
from advercity_dsl import Blueprint, BodyModel, Spec

import advercity
from advercity.assets.model_store import ModelStore, open_model_store
from advercity.compiler import with_digest
from advercity.dataset.manifest import Manifest
from advercity.dataset.verification import verify_dataset
from advercity.errors import InputError, RunError
from advercity.pipeline import RunOptions, preparation, repair_dataset, run_scenario
from advercity.pipeline.spec_models import check_models, find_missing_models, replace_models
from advercity.testing import with_small_sensors
from advercity.texture_packs import EZ_TREE

PACKED = BodyModel(pack="scopia/seat_leon", author="Scopia", licence="CC-BY-3.0")


@pytest.fixture(scope="module")
def modelled(specs: dict[str, Spec]) -> Spec:
    """A spec with one model of the package, which no test has installed."""
    spec = with_small_sensors(specs["rsnj_clear_day_sparse"])
    car = spec.blueprints["seat_leon"].model_copy(update={"model": PACKED})
    blueprints, assets = {**spec.blueprints, "seat_leon": car}, {"model/seat_leon": "ab" * 32}
    return with_digest(spec.model_copy(update={"blueprints": blueprints, "assets": assets}))


def run(spec: Spec, output: Path, *, frames: int = 1, allow: str) -> Manifest:
    """Runs frames in this process, with missing models or edits allowed."""
    options = RunOptions(output, backend="fake", profile="preview", frames=slice(0, frames))
    return Manifest.load(run_scenario(spec, replace(options, **{f"allow_{allow}": True})))


def always(digest: str) -> Callable[[ModelStore, Blueprint], str]:
    """Gives every model one digest."""
    return lambda _store, _blueprint: digest


def test_a_run_without_a_model_stops_and_says_how_to_get_it(modelled: Spec, tmp_path: Path) -> None:
    with pytest.raises(
        InputError, match=r"seat_leon are not installed; `advercity assets install`"
    ):
        advercity.run(modelled, tmp_path / "output", backend="fake")
    assert not (tmp_path / "output").exists()


def test_an_earlier_installation_in_the_cache_is_named(
    modelled: Spec, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ADVERCITY_CACHE", str(tmp_path))
    earlier = ModelStore(tmp_path / "assets")
    (earlier.folder / "package").mkdir(parents=True)
    (earlier.folder / "package" / "package.sha256").write_text(earlier.package.sha256)
    with pytest.raises(InputError, match=f"copies them here from {earlier.folder}"):
        check_models([modelled], allow_missing=False)


def test_a_model_that_converts_to_something_else_here_stops_a_run(
    modelled: Spec, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ModelStore, "compute_model_digest", always("cd" * 32))
    with pytest.raises(InputError, match=r"seat_leon are converted to other triangles.*numpy"):
        check_models([modelled], allow_missing=False)
    monkeypatch.setattr(ModelStore, "compute_model_digest", always("ab" * 32))
    check_models([modelled], allow_missing=False)


def test_a_spec_from_before_models_had_checksums_is_to_be_compiled_again(modelled: Spec) -> None:
    with pytest.raises(InputError, match="have no checksum in the spec; compile its library again"):
        check_models([modelled.model_copy(update={"assets": {}})], allow_missing=False)


def test_photographs_that_are_missing_or_of_another_version_stop_a_run(
    specs: dict[str, Spec],
) -> None:
    spec = specs["rsnj_clear_day_sparse"]
    named = spec.model_copy(update={"assets": {EZ_TREE.asset: EZ_TREE.digest}})
    with pytest.raises(InputError, match=r"textures/ez_tree are not installed.*19 MB.*--from"):
        check_models([named], allow_missing=False)
    check_models([named], allow_missing=True)
    assert find_missing_models(named) == (EZ_TREE.asset,)
    car = spec.blueprints["seat_leon"].model_copy(update={"model": PACKED})
    both = named.model_copy(update={"blueprints": {**spec.blueprints, "seat_leon": car}})
    with pytest.raises(InputError) as stopped:
        check_models([both], allow_missing=False)
    assert [line.split()[1] for line in str(stopped.value).splitlines()] == [
        "textures/ez_tree",
        "seat_leon",
    ]
    other = spec.model_copy(update={"assets": {EZ_TREE.asset: "ab" * 32}})
    with pytest.raises(InputError, match=r"textures/ez_tree are of another version"):
        check_models([other], allow_missing=False)
    assert replace_models(named, {EZ_TREE.asset}).assets == {}


@pytest.mark.sumo
def test_an_allowed_run_without_a_model_is_recorded_and_not_mixed_with_others(
    modelled: Spec, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    manifest = run(modelled, tmp_path, allow="missing_models")
    assert manifest.identity.missing_models == ("seat_leon",)
    assert manifest.identity.bodies == {}
    picture = next((tmp_path / modelled.id).glob("*/*_camera0.png"))
    content = picture.read_bytes()
    picture.write_bytes(b"damaged")
    assert repair_dataset(tmp_path) == []
    assert picture.read_bytes() == content
    monkeypatch.setattr(ModelStore, "compute_model_digest", always("ab" * 32))
    generated = replace_models(modelled, {"seat_leon"})
    monkeypatch.setattr(preparation, "replace_models", Mock(return_value=generated))
    with pytest.raises(RunError, match="missing_models: seat_leon"):
        run(modelled, tmp_path, frames=2, allow="missing_models")
    (kept,) = verify_dataset(tmp_path)
    assert (kept.kind, Path(kept.path).name) == ("foreign", f"{picture.name}.kept")


@pytest.mark.sumo
def test_an_edited_spec_runs_only_if_that_is_allowed_and_is_recorded(
    specs: dict[str, Spec], tmp_path: Path
) -> None:
    compiled = with_small_sensors(specs["rsnj_clear_day_sparse"])
    seeds = compiled.seeds.model_copy(update={"sensors": 5})
    edited = compiled.model_copy(update={"seeds": seeds})
    with pytest.raises(InputError, match=r"was edited after it was compiled.*`allow_edited`"):
        advercity.run(edited, tmp_path, backend="fake")
    assert list(tmp_path.iterdir()) == []
    assert run(edited, tmp_path, allow="edited").identity.edited
    whole = json.loads((tmp_path / edited.id / "manifest.json").read_text())
    assert whole["identity"]["edited"] is True


def test_models_are_in_the_data_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ADVERCITY_DATA", str(tmp_path))
    assert open_model_store().folder == tmp_path / "assets"
    monkeypatch.delenv("ADVERCITY_DATA")
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "share"))
    assert open_model_store().folder == tmp_path / "share" / "advercity" / "assets"
