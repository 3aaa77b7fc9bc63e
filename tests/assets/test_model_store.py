"""Models of others as bodies: from a package that these tests write, and from users' files."""

import hashlib
import io
import os
import shutil
import tarfile
import zipfile
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh
from advercity_dsl import Blueprint, BodyModel
from typer.testing import CliRunner

from advercity.assets.bodies import build_body
from advercity.assets.downloads import AssetPackage, fetch_package
from advercity.assets.model_files import ModelPart, read_obj, to_glb
from advercity.assets.model_store import ModelStore
from advercity.assets.packages import unpack_package
from advercity.cli import app
from advercity.errors import InputError, RunError
from advercity.geometry.mesh import MeshLayer
from tests.builders import SMALL_LIBRARY
from tests.command_line import Command
from tests.shipped import CATALOGUE

COPYRIGHT = """Format: https://www.debian.org/doc/packaging-manuals/copyright-format/1.0/

Files: Tiny/*
Copyright: 2020, Somebody
License: CC-BY-3.0

Files: Closed/*
Copyright: 2020, Somebody Else
License: All-rights-reserved
"""
BOX_FACES = "1 2 3 4|8 7 6 5|1 5 6 2|2 6 7 3|3 7 8 4|4 8 5 1"


def box(low: tuple[float, ...], high: tuple[float, ...], first: int, material: str) -> str:
    """A box of a Wavefront model whose vertices are `first` and the seven after it."""
    (x0, y0, z0), (x1, y1, z1) = low, high
    corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    vertices = [f"v {x} {y} {z}" for z in (z0, z1) for x, y in corners]
    faces = [
        "f " + " ".join(str(int(corner) + first - 1) for corner in face.split())
        for face in BOX_FACES.split("|")
    ]
    return "\n".join([*vertices, f"usemtl {material}", *faces, ""])


def car_obj() -> bytes:
    """A car of boxes in centimetres, y up, its front along z; one box is hidden inside it."""
    parts = [
        box((-90, 20, -220), (90, 80, 220), 1, "body_paint"),
        box((-80, 80, -150), (80, 150, 80), 9, "window"),
        box((-60, 30, -100), (60, 60, 100), 17, "seat"),
        box((60, 40, 215), (85, 55, 222), 25, "head_light"),
        box((60, 40, -222), (85, 55, -215), 33, "tail_light"),
        box((-90, 0, 100), (90, 40, 160), 41, "tyres"),
        box((-90, 0, -160), (90, 40, -100), 49, "tyres"),
    ]
    return "\n".join(parts).encode()


def collection(folder: str) -> bytes:
    """An archive of models as the package has them."""
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        archive.writestr(
            "PluginFurnitureCatalog.properties",
            f"model#1=/{folder}/car/car.obj\ncreator#1=Ann Author\nname#1=Car\n",
        )
        archive.writestr(f"{folder}/car/car.obj", car_obj())
        archive.writestr(f"{folder}/car/car.mtl", "newmtl body_paint\nKd 1 0 0\n")
    return content.getvalue()


def debian_package() -> bytes:
    """A Debian package with one free collection and one that is not."""
    data = io.BytesIO()
    with tarfile.open(fileobj=data, mode="w:xz") as archive:
        for name, content in {
            "./usr/share/sweethome3d/furniture/Tiny.sh3f": collection("tiny"),
            "./usr/share/sweethome3d/furniture/Closed.sh3f": collection("closed"),
            "./usr/share/doc/sweethome3d-furniture/copyright": COPYRIGHT.encode(),
            "./usr/share/doc/sweethome3d-furniture/changelog.Debian.gz": b"nothing",
        }.items():
            member = tarfile.TarInfo(name)
            member.size = len(content)
            archive.addfile(member, io.BytesIO(content))
    members = {"debian-binary": b"2.0\n", "data.tar.xz": data.getvalue()}
    packed = b"!<arch>\n"
    for name, content in members.items():
        packed += f"{name:<16}{0:<12}{0:<6}{0:<6}{'100644':<8}{len(content):<10}`\n".encode()
        packed += content + b"\n" * (len(content) % 2)
    return packed


@pytest.fixture
def tiny(tmp_path: Path) -> AssetPackage:
    """Our package, pinned by its checksum."""
    path = tmp_path / "mirror" / "tiny_1_all.deb"
    path.parent.mkdir()
    path.write_bytes(debian_package())
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    collections = ("Tiny.sh3f", "Closed.sh3f")
    return AssetPackage("tiny", "1", digest, path.stat().st_size, collections=collections)


@pytest.fixture
def mirror(tiny: AssetPackage, tmp_path: Path) -> Path:
    """A folder with the file of the package."""
    return tmp_path / "mirror"


@pytest.fixture
def shelf(tiny: AssetPackage, mirror: Path, tmp_path: Path) -> ModelStore:
    """A shelf with the package installed."""
    here = ModelStore(tmp_path / "shelf", tiny)
    here.install_package(mirror)
    return here


def blueprint(model: BodyModel, **more: float) -> Blueprint:
    size = {"length_m": 4.44, "width_m": 1.80, "height_m": 1.50} | more
    return Blueprint(actor_class="car", model=model, **size)  # pyright: ignore[reportArgumentType]


INDICATORS = ("lamp_amber_left", "lamp_amber_right")
"""Glasses that every vehicle has at its corners."""
TINY = BodyModel(pack="tiny/car", author="Ann Author", licence="CC-BY-3.0")


def points_of(made: Blueprint, here: ModelStore) -> dict[str, np.ndarray]:
    """Corners (n, 3, 3) of a model's own triangles, without seats and driver, by material."""
    return {
        part.material: part.vertices[part.triangles]
        for part in build_body("x", made, here).parts
        if part.layer == MeshLayer.SHAPE
    }


UNPACKED = ["Closed.sh3f", "Tiny.sh3f", "copyright", "package.sha256"]


def provide_apt(tools: Path, package: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let `apt-get download tiny=1` copy a file, and make it the only program there is."""
    copy = f"[ $1 = download ] && [ $3 = tiny=1 ] && /bin/cp {package} ."
    tools.mkdir()
    (tools / "apt-get").write_text(f"#!/bin/sh\n{copy}\n")
    (tools / "apt-get").chmod(0o755)
    monkeypatch.setenv("PATH", str(tools))


def test_the_package_is_downloaded_by_apt_and_unpacked_without_root(
    tiny: AssetPackage, mirror: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    provide_apt(tmp_path / "bin", mirror / tiny.file_name, monkeypatch)
    here = ModelStore(tmp_path / "shelf", tiny)
    here.install_package()
    assert here.has_package
    assert sorted(path.name for path in (here.folder / "package").iterdir()) == UNPACKED


def test_without_apt_the_message_names_the_file_to_take_and_the_command(
    tiny: AssetPackage, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("PATH", str(tmp_path))
    here = ModelStore(tmp_path / "shelf", tiny)
    with pytest.raises(RunError, match=r"no apt-get.*--from tiny_1_all\.deb"):
        here.install_package()
    assert not here.has_package


def test_an_environment_that_is_not_activated_downloads_with_its_own_pip(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = AssetPackage("tiny", "1.0", hashlib.sha256(b"").hexdigest(), 0, "pypi")
    tools = tmp_path / "venv/bin"
    tools.mkdir(parents=True)
    (tools / "pip").write_text(f"#!/bin/sh\n: > {package.file_name}\n")
    (tools / "pip").chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr("sys.executable", str(tools / "python"))
    assert fetch_package(package, tmp_path, None) == tmp_path / package.file_name


def test_another_file_than_the_pinned_package_is_refused(
    tiny: AssetPackage, mirror: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    (mirror / tiny.file_name).write_bytes(debian_package() + b"more")
    here = ModelStore(tmp_path / "shelf", tiny)
    for source in (mirror, mirror / tiny.file_name):
        with pytest.raises(InputError, match=f"is not tiny 1, whose SHA-256 is {tiny.sha256}"):
            here.install_package(source)
    provide_apt(tmp_path / "bin", mirror / tiny.file_name, monkeypatch)
    with pytest.raises(RunError, match=r"another SHA-256.*--from tiny_1_all\.deb"):
        here.install_package()
    assert not here.has_package
    with pytest.raises(InputError, match="no such file"):
        here.install_package(tmp_path / "nowhere")


def list_files(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


def test_models_of_an_earlier_folder_are_copied_and_stay_there(
    shelf: ModelStore, tiny: AssetPackage, tmp_path: Path
):
    path = tmp_path / "own.glb"
    path.write_bytes(to_glb(read_obj(car_obj(), {})))
    digest = shelf.add_model(path)
    (shelf.folder / "package" / "photo.jpg").write_bytes(b"mine")
    had = list_files(shelf.folder)
    here = ModelStore(tmp_path / "data" / "assets", tiny)
    assert here.adopt(shelf)
    assert list_files(shelf.folder) == had
    assert list_files(here.folder) == had - {"package/photo.jpg"}
    assert here.has_package
    copied = here.folder / "own" / f"{digest}.glb"
    copied.write_bytes(b"changed")
    assert (shelf.folder / "own" / f"{digest}.glb").read_bytes() == path.read_bytes()
    assert not here.adopt(shelf)


def test_a_store_that_is_its_own_earlier_one_keeps_its_models(shelf: ModelStore, tmp_path: Path):
    path = tmp_path / "own.glb"
    path.write_bytes(to_glb(read_obj(car_obj(), {})))
    shelf.add_model(path)
    had = list_files(shelf.folder)
    assert not shelf.adopt(shelf)
    assert list_files(shelf.folder) == had


def test_a_copy_that_is_cut_short_leaves_no_half_of_a_package(
    shelf: ModelStore, tiny: AssetPackage, tmp_path: Path
):
    (shelf.folder / "package" / "copyright").unlink()  # as a disk that cannot be read
    here = ModelStore(tmp_path / "data" / "assets", tiny)
    with pytest.raises(InputError, match="copyright: cannot be read"):
        here.adopt(shelf)
    assert list_files(here.folder) == set()


def test_removing_and_installing_keep_files_of_a_user(shelf: ModelStore, mirror: Path):
    shelf.prepare_model(blueprint(TINY))
    own = ("models/thesis.glb", "models/car.blend", "package/photo.jpg", "package/Mine.sh3f")
    for name in own:
        (shelf.folder / name).write_bytes(b"mine")
    shelf.remove_converted_models()
    shelf.remove_package()
    assert list_files(shelf.folder) == set(own)
    with pytest.raises(InputError, match="package: holds files that are not of an asset package"):
        shelf.install_package(mirror)
    for name in ("photo.jpg", "Mine.sh3f"):
        (shelf.folder / "package" / name).unlink()
    shelf.install_package(mirror)
    assert shelf.has_package


@pytest.fixture
def installed_for_all(
    tiny: AssetPackage, mirror: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Path:
    """The store of commands, with our package as both packages that there are."""
    monkeypatch.setenv("ADVERCITY_DATA", str(tmp_path))
    here = ModelStore(tmp_path / "assets", tiny)
    here.install_package(mirror)
    shutil.copytree(here.package_folder, here.people_folder)
    return here.folder


def test_removing_keeps_a_file_that_its_user_changed_and_says_so(
    advercity: Command, installed_for_all: Path
) -> None:
    changed, linked = (
        installed_for_all / name for name in ("package/copyright", "people/Tiny.sh3f")
    )
    changed.write_text("mine")
    linked.rename(installed_for_all / "Tiny.sh3f")
    linked.symlink_to(installed_for_all / "Tiny.sh3f")
    code, _, err = advercity("assets", "remove")
    assert code == 0
    assert list_files(installed_for_all) == {"package/copyright", "people/Tiny.sh3f", "Tiny.sh3f"}
    assert changed.read_text() == "mine"
    assert linked.is_symlink()
    assert f"{changed.parent}: changed since it was unpacked, kept: copyright" in err
    assert f"{linked.parent}: changed since it was unpacked, kept: Tiny.sh3f" in err


@pytest.mark.parametrize("name", ["package", "people", "models", "textures"])
def test_removing_leaves_alone_what_a_link_leads_to(
    advercity: Command, installed_for_all: Path, tmp_path: Path, name: str
) -> None:
    folder, shared = installed_for_all / name, tmp_path / "shared"
    if folder.exists():
        folder.rename(shared)
    else:
        shared.mkdir()
        (shared / f"{'0' * 64}.glb").write_text("mine")
    folder.symlink_to(shared)
    had = list_files(shared)
    code, _, err = advercity("assets", "remove")
    assert code == 2
    assert f"{folder}: is a link to {shared}, whose files stay; delete the link itself" in err
    assert list_files(shared) == had


def test_a_package_that_an_earlier_version_unpacked_is_not_removed_unseen(
    advercity: Command, installed_for_all: Path, tiny: AssetPackage
) -> None:
    (installed_for_all / "package/package.sha256").write_text(tiny.sha256)
    had = list_files(installed_for_all)
    code, _, err = advercity("assets", "remove")
    assert code == 2
    assert "package.sha256: lists no unpacked files, as in earlier versions" in err
    assert list_files(installed_for_all) == had
    assert ModelStore(installed_for_all, tiny).has_package


def test_a_changed_package_is_not_replaced_and_nothing_is_fetched(
    shelf: ModelStore, mirror: Path
) -> None:
    (shelf.package_folder / "copyright").write_text("mine")
    had = list_files(shelf.folder)
    with pytest.raises(InputError, match="or were changed since; move them"):
        shelf.install_package(mirror / "nowhere")
    assert list_files(shelf.folder) == had


@pytest.mark.parametrize("name", ["package", "people"])
def test_a_package_whose_record_cannot_be_read_is_named_by_doctor_and_stops_no_command(
    advercity: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.setenv("ADVERCITY_DATA", str(tmp_path))
    record = tmp_path / "assets" / name / "package.sha256"
    record.parent.mkdir(parents=True)
    record.write_bytes(b"\xff\xfe")
    assert advercity("assets", "list", "--library", SMALL_LIBRARY).code == 0
    code, out, _ = advercity("doctor")
    assert code == 1
    assert f"{record}: is damaged; move its folder elsewhere" in out


def test_files_that_a_user_had_before_the_package_stay(mirror: Path, tiny: AssetPackage):
    here = ModelStore(mirror / "shelf", tiny)
    (here.folder / "package").mkdir(parents=True)
    (here.folder / "package" / "copyright").write_text("mine")
    here.remove_package()
    with pytest.raises(InputError, match="not of an asset package"):
        here.install_package(mirror)
    assert list_files(here.folder) == {"package/copyright"}


def test_a_package_of_another_version_is_not_used(shelf: ModelStore):
    other = replace(shelf.package, version="2", sha256="0" * 64)
    assert not ModelStore(shelf.folder, other).has_package


def test_a_converted_model_is_upright_in_metres_and_faces_ahead(shelf: ModelStore):
    found = points_of(blueprint(TINY), shelf)
    everything = np.concatenate([corners.reshape(-1, 3) for corners in found.values()])
    np.testing.assert_allclose(everything.min(axis=0), (-2.22, -0.9, 0.0), atol=1e-3)
    np.testing.assert_allclose(everything.max(axis=0), (2.22, 0.9, 1.5), atol=1e-3)
    headlamp = found["lamp_white"].reshape(-1, 3)
    np.testing.assert_allclose(headlamp.max(axis=0), (2.22, 0.85, 0.55), atol=1e-3)
    assert found["lamp_red"][..., 0].max() < -2.1
    assert found["glass"][..., 2].min() == pytest.approx(0.8, abs=1e-3)


def test_materials_are_classified_by_their_names(shelf: ModelStore):
    assert set(points_of(blueprint(TINY), shelf)) == {
        *("paint", "glass", "lamp_white", "lamp_red", "rubber"),
        *INDICATORS,
    }
    other = TINY.model_copy(update={"materials": {"body_paint": "chrome", "tyres": "none"}})
    assert set(points_of(blueprint(other, height_m=1.30), shelf)) == {
        *("chrome", "glass", "lamp_white", "lamp_red"),
        *INDICATORS,
    }


def test_a_white_box_of_a_trucks_model_gets_rear_doors_and_a_stripe_in_its_hauliers_colour(
    shelf: ModelStore,
):
    found = {}
    for colour in ("white_paint", "red_paint"):
        model = TINY.model_copy(update={"materials": {"body_paint": colour}})
        truck = Blueprint(
            actor_class="truck", model=model, length_m=8.88, width_m=3.6, height_m=3.0
        )
        found[colour] = points_of(truck, shelf)
    trimmed, plain = found["white_paint"], found["red_paint"]
    added = set(trimmed) - set(plain) - {"car_paint_white"}
    assert any(material.startswith("car_paint_") for material in added)
    bars = trimmed["metal"].reshape(-1, 3)
    assert bars[:, 0].min() == pytest.approx(-4.44, abs=0.01)
    assert np.ptp(bars[bars[:, 0] < -4.4][:, 2]) > 1.0


def test_hidden_triangles_are_dropped_and_faces_point_outward(shelf: ModelStore):
    found = points_of(blueprint(TINY), shelf)
    assert "upholstery" not in found
    roof = found["glass"]
    normal = np.cross(roof[:, 1] - roof[:, 0], roof[:, 2] - roof[:, 0])
    middle = roof.mean(axis=1) - (-0.35, 0.0, 1.15)
    assert (np.einsum("ij,ij->i", normal, middle) > 0).all()


def test_an_inside_out_model_is_turned_outward(shelf: ModelStore, tmp_path: Path):
    flipped = [
        "f " + " ".join(reversed(line.split()[1:])) if line.startswith("f ") else line
        for line in car_obj().decode().splitlines()
    ]
    path = tmp_path / "flipped.glb"
    path.write_bytes(to_glb(read_obj("\n".join(flipped).encode(), {})))
    model = BodyModel(file=path.name, sha256=shelf.add_model(path), author="Me", licence="CC0-1.0")
    right = points_of(blueprint(TINY), shelf)["paint"]
    mended = points_of(blueprint(model), shelf)["paint"]
    for corners in (right, mended):
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        assert (np.einsum("ij,ij->i", normal, corners.mean(axis=1) - (0, 0, 0.5)) > 0).all()


def test_a_damaged_model_of_a_user_is_reported_and_renewed_by_adding_it_again(
    shelf: ModelStore, tmp_path: Path
):
    path = tmp_path / "own.glb"
    path.write_bytes(to_glb(read_obj(car_obj(), {})))
    digest = shelf.add_model(path)
    stored = shelf.folder / "own" / f"{digest}.glb"
    stored.write_bytes(path.read_bytes()[:-1] + b"\1")
    model = BodyModel(file=path.name, sha256=digest, author="Me", licence="CC0-1.0")
    with pytest.raises(RunError, match=rf"{digest}\.glb: is damaged; `advercity assets add`"):
        shelf.prepare_model(blueprint(model))
    shelf.add_model(path)
    assert stored.read_bytes() == path.read_bytes()
    assert shelf.prepare_model(blueprint(model)) is not None


def test_a_heavy_model_is_simplified_and_keeps_its_shape(shelf: ModelStore, tmp_path: Path):
    ball = trimesh.creation.icosphere(subdivisions=5, radius=1.0)
    ball.apply_scale((2.22, 0.9, 0.75))
    path = tmp_path / "ball.glb"
    path.write_bytes(to_glb([ModelPart("shell", ball.vertices, ball.faces)]))
    model = BodyModel(
        file=path.name,
        sha256=shelf.add_model(path),
        up="z",
        triangles=1500,
        author="Me",
        licence="MIT",
    )
    corners = points_of(blueprint(model), shelf)["paint"]
    assert len(ball.faces) > 20_000
    assert 900 < len(corners) <= 1600
    place = (corners.reshape(-1, 3) - (0, 0, 0.75)) / (2.22, 0.9, 0.75)
    np.testing.assert_allclose(np.linalg.norm(place, axis=1), 1.0, atol=0.03)


def test_a_model_is_converted_once(shelf: ModelStore):
    first = shelf.prepare_model(blueprint(TINY))
    assert first is not None
    age = first.stat().st_mtime_ns
    assert shelf.prepare_model(blueprint(TINY)) == first
    assert first.stat().st_mtime_ns == age


def test_the_same_model_converts_to_the_same_bytes(shelf: ModelStore):
    again = ModelStore(shelf.folder.parent / "other", shelf.package)
    again.install_package(shelf.folder.parent / "mirror")
    first, second = shelf.prepare_model(blueprint(TINY)), again.prepare_model(blueprint(TINY))
    assert first is not None
    assert second is not None
    assert second.read_bytes() == first.read_bytes()


def test_a_model_of_wrong_proportions_is_rejected(shelf: ModelStore):
    sideways = TINY.model_copy(update={"turn_deg": 90.0})
    with pytest.raises(RunError, match="turn_deg"):
        shelf.prepare_model(blueprint(sideways))


def test_a_declared_licence_must_be_that_of_the_package(shelf: ModelStore):
    other = TINY.model_copy(update={"author": "Somebody Else"})
    with pytest.raises(RunError, match=r"is by Ann Author under CC-BY-3\.0"):
        shelf.prepare_model(blueprint(other))
    closed = TINY.model_copy(update={"pack": "closed/car"})
    with pytest.raises(RunError, match="not a free one"):
        shelf.prepare_model(blueprint(closed))
    missing = TINY.model_copy(update={"pack": "tiny/bus"})
    with pytest.raises(RunError, match="no model 'tiny/bus'"):
        shelf.prepare_model(blueprint(missing))


def test_without_the_package_a_body_is_procedural_and_of_the_same_size(
    shelf: ModelStore, tmp_path: Path
):
    nothing = ModelStore(tmp_path / "nothing")
    made = blueprint(TINY)
    assert nothing.prepare_model(made) is None
    with pytest.raises(RunError, match="tiny/car is not installed"):
        build_body("x", made, nothing)
    shaped, modelled = build_body("x", made), build_body("x", made, shelf)
    assert shaped.size == modelled.size
    for whole in (shaped, modelled):
        corners = np.concatenate([part.vertices[part.triangles] for part in whole.parts])
        np.testing.assert_allclose(np.ptp(corners.reshape(-1, 3), axis=0), whole.size, atol=1e-3)


def test_triangles_are_classified_as_lamps_and_trim_by_texture(shelf: ModelStore):
    picture = np.zeros((4, 4, 3), np.uint8)
    picture[:, 2:] = (40, 30, 200)
    text = (
        "v 0 0 0\nv 0 1 0\nv 0 0 1\nv 5 0 0\nv 5 1 0\nv 5 0 1\n"
        "vt 0.1 0.1\nvt 0.9 0.9\nusemtl skin\nf 1/1 2/1 3/1\nf 4/2 5/2 6/2\n"
    )
    encoded = cv2.imencode(".png", picture)[1].tobytes()
    files = {"a.mtl": b"newmtl skin\nmap_Kd skin.png\n", "skin.png": encoded}
    (part,) = read_obj(text.encode(), files)
    assert part.colours is not None
    np.testing.assert_allclose(part.colours, [(0, 0, 0), (200 / 255, 30 / 255, 40 / 255)])


@pytest.mark.parametrize(
    ("content", "message"),
    [(b"nonsense", "not a Debian package"), (b"!<arch>\n", "no data.tar")],
)
def test_a_broken_package_is_rejected(tmp_path: Path, content: bytes, message: str):
    path = tmp_path / "broken.deb"
    path.write_bytes(content)
    with pytest.raises(RunError, match=message):
        unpack_package(AssetPackage("broken", "1", "", 0), path, tmp_path)


def test_a_file_that_is_not_a_glb_is_rejected(tmp_path: Path):
    path = tmp_path / "car.glb"
    path.write_bytes(b"solid car")
    with pytest.raises(InputError, match="not a GLB"):
        ModelStore(tmp_path).add_model(path)
    with pytest.raises(InputError, match="cannot be read"):
        ModelStore(tmp_path).add_model(tmp_path / "missing.glb")


def test_installing_may_be_optional(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setenv("ADVERCITY_DATA", str(tmp_path))
    done = CliRunner().invoke(app, ["assets", "install", "--allow-failure"])
    assert done.exit_code == 0
    assert "(120 MB)" in done.output
    assert "generated instead: sweethome3d-furniture 1.8-1 cannot be downloaded" in done.output
    assert "generated instead: @dgreenheck/ez-tree 1.1.0 cannot be downloaded" in done.output
    assert CliRunner().invoke(app, ["assets", "install"]).exit_code == 1


def test_bodies_are_listed_with_triangles_memory_source_and_licence():
    done = CliRunner().invoke(app, ["assets", "list", "--library", str(SMALL_LIBRARY)])
    assert done.exit_code == 0
    lines = done.output.splitlines()
    for head in ("blueprint", "triangles", "MiB", "model", "attribution"):
        assert head in lines[0]
    assert any(line.startswith("saloon ") and "4.90 x 1.90 x 1.50" in line for line in lines)
    assert "bodies," in lines[-1]
    assert "triangles" in lines[-1]


def test_no_model_is_in_the_repository():
    root = Path(__file__).parents[2]
    kinds = (".glb", ".gltf", ".obj", ".sh3f", ".deb", ".fbx", ".stl", ".dae")
    folders = ("advercity", "dsl", "backends", "library", "compiled", "docs", "examples", "tests")
    found = [path for name in folders for path in (root / name).rglob("*") if path.suffix in kinds]
    assert found == []


INSTALLED = ModelStore(Path(os.environ["ADVERCITY_TEST_MODELS"]))
MODELLED = [
    name
    for name, made in CATALOGUE.blueprints.items()
    if made.model is not None and not made.person
]


@pytest.fixture(scope="session")
def installed(tmp_path_factory: pytest.TempPathFactory) -> ModelStore:
    """The user's asset package in a new store: conversions are not written to the user's."""
    folder = tmp_path_factory.mktemp("models")
    (folder / "package").symlink_to(INSTALLED.folder / "package")
    return ModelStore(folder)


@pytest.mark.skipif(
    not INSTALLED.has_package,
    reason="no model of the asset package is tested; install it with `advercity assets install`",
)
@pytest.mark.parametrize("name", MODELLED)
def test_every_model_of_the_package_makes_a_sound_body(name: str, installed: ModelStore):
    made = CATALOGUE.blueprints[name]
    whole = build_body(name, made, installed)
    corners = np.concatenate([part.vertices[part.triangles] for part in whole.parts])
    size = np.array(whole.size)
    np.testing.assert_allclose(corners.min(axis=(0, 1)), size * (-0.5, -0.5, 0), atol=1e-3)
    np.testing.assert_allclose(corners.max(axis=(0, 1)), size * (0.5, 0.5, 1), atol=1e-3)
    by_material = {part.material: part.vertices[part.triangles] for part in whole.parts}
    assert {"paint", "glass", "lamp_white", "lamp_red"} <= by_material.keys()
    assert by_material["lamp_white"][..., 0].min() > 0.1 * size[0]
    assert by_material["lamp_red"][..., 0].max() < -0.1 * size[0]
    shapes = [part for part in whole.parts if part.layer == MeshLayer.SHAPE]
    assert sum(len(part.triangles) for part in shapes) < 15_000
