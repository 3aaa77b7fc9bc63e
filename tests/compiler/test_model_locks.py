"""Models are part of specs: names and checksums from the lock beside a catalogue."""

import json
from pathlib import Path

import pytest
import trimesh
from advercity_dsl import Catalogue, Spec

from advercity.assets.locking import build_locks
from advercity.assets.model_conversion import CONVERSION_VERSION
from advercity.assets.model_store import ModelStore
from advercity.assets.packages import FURNITURE
from advercity.compiler import load_library, to_json
from advercity.compiler.crossing import compile_library
from advercity.compiler.model_locks import compute_declared_digest
from advercity.errors import InputError
from advercity.texture_packs import EZ_TREE
from tests.builders import Write, compile_shaped, describe_errors
from tests.command_line import Command

CATALOGUE = """
kind: catalogue
id: one_car
ego: saloon
blueprints:
  saloon:
    actor_class: car
    length_m: 4.9
    width_m: 1.9
    height_m: 1.5
    model: {file: box.glb, author: Me, licence: MIT}
  borrowed:
    actor_class: car
    length_m: 4.2
    width_m: 1.8
    height_m: 1.5
    model: {pack: scopia/seat_leon, author: Scopia, licence: CC-BY-3.0}
"""


def write_modelled(write: Write, text: str = CATALOGUE) -> Path:
    """Writes a library whose catalogue has a GLB of its own and a model of the package."""
    folder = write(catalogue=text)
    box = trimesh.creation.box((1.9, 1.5, 4.9))
    trimesh.Scene({"body_paint": box}).export(folder / "box.glb")
    return folder


def lock(folder: Path, store: ModelStore, **built: str) -> None:
    """Locks the models of a library; `built` are checksums of some that are not installed."""
    path = folder / "catalogue.lock.json"
    for name, digest in built.items():
        declared = read_declared_digest(folder, name)
        models = {name: {"declared": declared, "built": digest}}
        path.write_text(json.dumps({"conversion": 1, "packages": {}, "models": models}))
    for file, text in build_locks(load_library(folder), store).items():
        file.write_text(text)


def read_declared_digest(folder: Path, name: str) -> str:
    (catalogue,) = load_library(folder).get_declarations(Catalogue).values()
    return compute_declared_digest(catalogue.blueprints[name])


def test_shipped_specs_have_a_checksum_of_every_model_they_may_use(library: Path) -> None:
    shipped = json.loads((library / "nhtsa/catalogues/adver_city.lock.json").read_text())
    specs = compile_library(library)
    for spec in specs[::10]:
        modelled = [name for name, made in spec.blueprints.items() if made.model is not None]
        assert {name: spec.assets[f"model/{name}"] for name in modelled} == {
            name: shipped["models"][name]["built"] for name in modelled
        }
        assert len(modelled) >= 10
    models = {f"model/{name}" for name in shipped["models"]}
    assert {name for spec in specs for name in spec.assets} == models | {EZ_TREE.asset}


def test_shipped_specs_have_the_checksum_of_the_photographs(library: Path) -> None:
    assert {spec.assets["textures/ez_tree"] for spec in compile_library(library)} == {
        EZ_TREE.digest
    }


def test_the_shipped_lock_is_of_the_pinned_package_and_of_this_conversion(library: Path) -> None:
    shipped = json.loads((library / "nhtsa/catalogues/adver_city.lock.json").read_text())
    assert shipped["packages"] == {FURNITURE.name: FURNITURE.sha256}
    assert shipped["conversion"] == CONVERSION_VERSION


def test_shaped_specs_use_no_package(specs: dict[str, Spec], library: Path) -> None:
    for spec in specs.values():
        assert spec.assets == {}
        assert all(made.model is None for made in spec.blueprints.values())
    assert '"assets"' not in to_json(next(iter(specs.values())))


def test_a_suite_may_use_the_models_beside_it_and_no_package(write: Write, tmp_path: Path) -> None:
    folder = write_modelled(write)
    lock(folder, ModelStore(tmp_path / "store"), borrowed="ab" * 32)
    (full,), (shaped,) = compile_library(folder), compile_shaped(folder)
    assert full.assets["model/borrowed"] == "ab" * 32
    assert set(full.assets) == {"model/borrowed", "model/saloon", EZ_TREE.asset}
    assert shaped.assets == {"model/saloon": full.assets["model/saloon"]}
    assert shaped.blueprints["borrowed"].model is None
    suite = "kind: suite\nid: small\nrig: one_camera\ncatalogue: one_car\nlooks: shaped\n"
    (folder / "suite.yaml").write_text(suite)
    (declared,) = compile_library(folder)
    assert declared.assets == shaped.assets


def test_a_model_without_a_lock_and_one_declared_otherwise_since_are_located(
    write: Write, tmp_path: Path
) -> None:
    folder = write_modelled(write)
    lines = describe_errors(folder).splitlines()
    assert [line.split(": ")[:2] for line in lines] == [
        ["catalogue.yaml:11:12", "blueprints.saloon.model"],
        ["catalogue.yaml:17:12", "blueprints.borrowed.model"],
    ]
    assert all("`advercity assets lock`" in line for line in lines)
    lock(folder, ModelStore(tmp_path / "store"), borrowed="ab" * 32)
    text = (folder / "catalogue.yaml").read_text()
    (folder / "catalogue.yaml").write_text(text.replace("4.2", "4.3"))
    assert "blueprints.borrowed.model" in describe_errors(folder)
    assert "saloon" not in describe_errors(folder)


def test_a_catalogue_that_extends_another_locks_its_own_models_alone(
    write: Write, tmp_path: Path
) -> None:
    folder = write_modelled(write)
    store = ModelStore(tmp_path / "store")
    lock(folder, store, borrowed="ab" * 32)
    (folder / "more.yaml").write_text(
        "kind: catalogue\nid: more\nextends: one_car\nblueprints:\n"
        "  long: {actor_class: car, length_m: 5, width_m: 1.9, height_m: 1.5,\n"
        "    model: {file: box.glb, author: Me, licence: MIT}}\n"
    )
    (folder / "suite.yaml").write_text("kind: suite\nid: small\nrig: one_camera\ncatalogue: more\n")
    lock(folder, store)
    own = json.loads((folder / "more.lock.json").read_text())
    assert list(own["models"]) == ["long"]
    (spec,) = compile_library(folder)
    assert set(spec.assets) == {"model/borrowed", "model/long", "model/saloon", EZ_TREE.asset}


def test_a_file_that_is_no_lock_is_not_replaced_by_one(write: Write, tmp_path: Path) -> None:
    folder, store = write_modelled(write), ModelStore(tmp_path / "store")
    lock(folder, store, borrowed="ab" * 32)
    longer = CATALOGUE.partition("  borrowed")[0].replace("4.9", "4.95")
    text = longer.replace("id: one_car\nego: saloon", "id: more\nextends: one_car")
    (folder / "more.yaml").write_text(
        text.replace("    model: {file: box.glb, author: Me, licence: MIT}\n", "")
    )
    mine = folder / "more.lock.json"
    mine.write_text('{"mine": 1}')
    with pytest.raises(InputError, match=r"more\.lock\.json: is not a lock of models"):
        lock(folder, store)
    mine.unlink()
    lock(folder, store)
    assert list(json.loads(mine.read_text())["models"]) == ["saloon"]


def test_a_lock_is_not_written_where_a_link_leads(
    advercity: Command, write: Write, tmp_path: Path
) -> None:
    folder = write_modelled(write, CATALOGUE.partition("  borrowed")[0])
    shared, link = tmp_path / "shared.json", folder / "catalogue.lock.json"
    assert advercity("assets", "lock", folder).err == "1 lock is current\n"
    link.rename(shared)
    link.symlink_to(shared)
    assert advercity("assets", "lock", folder).code == 0
    other = shared.read_text().replace('"saloon"', '"other"')
    shared.write_text(other)
    code, _, err = advercity("assets", "lock", folder)
    assert code == 2
    assert f"{link}: is a link to {shared}, which stays as it is" in err
    assert shared.read_text() == other
    assert link.is_symlink()


@pytest.mark.parametrize("text", ["{", "[]", '{"models": {}}'])
def test_a_damaged_lock_is_an_error(write: Write, text: str) -> None:
    folder = write_modelled(write)
    (folder / "catalogue.lock.json").write_text(text)
    with pytest.raises(InputError, match=r"catalogue\.lock\.json"):
        compile_library(folder)
