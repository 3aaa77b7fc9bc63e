import subprocess
import sys
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from advercity_dsl import Blueprint, Spec
from numpy.typing import NDArray

from advercity.assets.bodies import build_body
from advercity.assets.model_store import ModelStore
from advercity.compiler import write_specs
from advercity.errors import RunError
from advercity.geometry.mesh import Mesh
from advercity.pipeline.cache import compute_world_key
from advercity.pipeline.preparation import load_or_build_world
from advercity.scene.build import build_world
from advercity.scene.world_storage import load_body, load_world, save_body, save_world
from advercity.semantics import Semantic
from advercity.world import Body, World

NETWORK = Path("road.net.xml")
TRIANGLE = Mesh(
    "ground",
    np.eye(3, dtype=np.float32),
    np.array([[0, 1, 2]], np.int32),
    "grass",
    Semantic.TERRAIN,
)
SAVE_PROGRAM = """
import sys
from pathlib import Path
from advercity.assets.bodies import build_body
from advercity.compiler import read_spec
from advercity.scene.build import build_world
from advercity.scene.world_storage import save_body, save_world

spec, folder = read_spec(Path(sys.argv[1])), Path(sys.argv[2])
save_world(build_world(spec, Path("road.net.xml")), folder / "world.npz")
for name in sys.argv[3:]:
    save_body(build_body(name, spec.blueprints[name]), folder / f"{name}.npz")
"""
PEOPLE = ["pedestrian_0001", "pedestrian_0008"]


@pytest.fixture(scope="module")
def spec(specs: dict[str, Spec]) -> Spec:
    return specs["ui_clear_day_sparse"]


@pytest.fixture(scope="module")
def world(spec: Spec) -> World:
    return build_world(spec, NETWORK)


def is_close(first: NDArray[Any], second: NDArray[Any]) -> bool:
    """Whether arrays differ by no more than the rounding to 9 decimals."""
    return first.shape == second.shape and np.allclose(first, second, rtol=0, atol=1.1e-9)


def are_equal(first: Mesh, second: Mesh) -> bool:
    return all(
        is_close(one, other) and one.dtype == other.dtype
        if isinstance(one := getattr(first, item.name), np.ndarray)
        and isinstance(other := getattr(second, item.name), np.ndarray)
        else one == getattr(second, item.name)
        for item in fields(Mesh)
    )


def test_a_stored_world_is_the_same_world(world: World, tmp_path: Path):
    save_world(world, tmp_path / "world.npz")
    loaded = load_world(tmp_path / "world.npz", NETWORK)
    assert len(loaded.static) == len(world.static)
    assert all(map(are_equal, loaded.static, world.static))
    for lane, other in zip(world.lanes, loaded.lanes, strict=True):
        assert (lane.id, lane.kind, lane.in_junction) == (other.id, other.kind, other.in_junction)
        assert is_close(lane.left, other.left)
        assert is_close(lane.right, other.right)
    assert loaded.street_lamps == world.street_lamps
    assert loaded.signal_lamps == world.signal_lamps
    assert (loaded.id, loaded.network) == (world.id, NETWORK)


@pytest.mark.parametrize("name", ["lincoln_mkz_2017", "yamaha_yzf", "pedestrian_0001"])
def test_a_stored_body_is_the_same_body(name: str, spec: Spec, tmp_path: Path):
    body = build_body(name, spec.blueprints[name])
    save_body(body, tmp_path / "body.npz")
    loaded = load_body(tmp_path / "body.npz")
    assert loaded.size == body.size
    assert len(loaded.parts) == len(body.parts)
    assert all(map(are_equal, loaded.parts, body.parts))


@pytest.mark.usefixtures("older_processor")
def test_worlds_and_people_do_not_depend_on_the_processor(spec: Spec, world: World, tmp_path: Path):
    save_world(world, tmp_path / "world.npz")
    for name in PEOPLE:
        save_body(build_body(name, spec.blueprints[name]), tmp_path / f"{name}.npz")
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    write_specs([spec], tmp_path)
    file = tmp_path / f"{spec.id}.json"
    subprocess.run([sys.executable, "-c", SAVE_PROGRAM, file, elsewhere, *PEOPLE], check=True)
    for name in ("world", *PEOPLE):
        content = (elsewhere / f"{name}.npz").read_bytes()
        assert content == (tmp_path / f"{name}.npz").read_bytes(), name


def test_a_world_of_nothing_can_be_stored(tmp_path: Path):
    save_world(World("empty", (), {}, (), NETWORK), tmp_path / "world.npz")
    loaded = load_world(tmp_path / "world.npz", NETWORK)
    assert (loaded.static, loaded.bodies, loaded.lanes) == ((), {}, ())


@pytest.fixture
def built(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Roads and blueprints that are built, one mesh each, with an empty cache."""
    built: list[str] = []

    def build_world(spec: Spec, network: Path) -> World:
        built.append(spec.road.id)
        return World(spec.road.id, (TRIANGLE,), {}, (), network)

    def build(name: str, blueprint: Blueprint, store: ModelStore) -> Body:
        built.append(name)
        return Body((TRIANGLE,), (1.0, 1.0, 1.0))

    monkeypatch.setenv("ADVERCITY_CACHE", str(tmp_path))
    monkeypatch.setattr("advercity.pipeline.preparation.build_world", build_world)
    monkeypatch.setattr("advercity.pipeline.preparation.build_body", build)
    return built


def test_a_world_is_built_once_and_then_read(spec: Spec, built: list[str]):
    worlds = [load_or_build_world(spec, NETWORK) for _ in range(2)]
    assert built == [spec.road.id, *spec.blueprints]
    assert list(worlds[1].bodies) == list(spec.blueprints)
    assert are_equal(worlds[0].static[0], worlds[1].static[0])


def test_roads_share_their_bodies(specs: dict[str, Spec], built: list[str]):
    one, other = specs["ri_clear_day_sparse"], specs["ui_clear_day_sparse"]
    for spec in (one, other):
        load_or_build_world(spec, NETWORK)
    assert sorted(built) == sorted({one.road.id, other.road.id, *one.blueprints, *other.blueprints})


def test_what_is_no_world_is_an_error_with_its_path(tmp_path: Path):
    """As an entry of the cache that was edited together with its checksum: it is made again."""
    path = tmp_path / "world.npz"
    save_world(World("empty", (), {}, (), NETWORK), path)
    with np.load(path) as stored:
        arrays = dict(stored)
    for changes in ({"record": np.zeros(0, np.uint8)}, {"vertices": None}, {"record": None}):
        kept = {name: array for name, array in (arrays | changes).items() if array is not None}
        np.savez(path, allow_pickle=False, **kept)
        with pytest.raises(RunError, match=r"world\.npz: not a world: "):
            load_world(path, NETWORK)
    path.write_bytes(b"notes")
    with pytest.raises(RunError, match=r"world\.npz: not a file of arrays"):
        load_world(path, NETWORK)


@pytest.mark.parametrize(
    "changes",
    [
        {"triangles": np.array([0, 1, 3], np.int32)},
        {"triangles": np.array([0, 1, -1], np.int32)},
        {"triangles": np.array([0, 1, 2], np.float64)},
        {"vertices": np.zeros(9, np.int32)},
    ],
)
def test_triangles_of_vertices_that_are_none_are_no_world(
    tmp_path: Path, changes: dict[str, NDArray[Any]]
):
    """Renderers would read beyond the end of the vertices."""
    path = tmp_path / "world.npz"
    save_world(World("small", (TRIANGLE,), {}, (), NETWORK), path)
    assert load_world(path, NETWORK).static[0].triangles.tolist() == [[0, 1, 2]]
    with np.load(path) as stored:
        arrays = {**stored, **changes}
    np.savez(path, allow_pickle=False, **arrays)
    with pytest.raises(RunError, match=r"world\.npz: not a world: "):
        load_world(path, NETWORK)


def test_worlds_are_shared_between_weathers_but_not_between_poses_of_units(spec: Spec):
    other_weather = spec.model_copy(update={"id": "other", "weather": None})
    agents = {**spec.road.agents}
    unit = agents["rsu1"]
    agents["rsu1"] = unit.model_copy(update={"yaw_deg": 3.0})
    moved = spec.model_copy(update={"road": spec.road.model_copy(update={"agents": agents})})
    assert compute_world_key(spec) == compute_world_key(other_weather)
    assert compute_world_key(spec) != compute_world_key(moved)
