"""Digests by which changed code is told."""

import sys
from pathlib import Path

import pytest

from advercity.digests import compute_source_digest


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "some_backend", raising=False)
    folder = tmp_path / "some_backend"
    (folder / "shaders").mkdir(parents=True)
    (folder / "__init__.py").write_text("")
    (folder / "shaders" / "sky.frag").write_text("void main() {}")
    compute_source_digest.cache_clear()
    return folder


def digest() -> str:
    compute_source_digest.cache_clear()
    return compute_source_digest("some_backend")


def test_every_change_of_a_source_changes_the_digest(package: Path) -> None:
    found = [digest()]
    (package / "shaders" / "sky.frag").write_text("void main() {discard;}")
    found.append(digest())
    (package / "shaders" / "sky.frag").rename(package / "shaders" / "cloud.frag")
    found.append(digest())
    (package / "more.py").write_text("")
    found.append(digest())
    assert len(set(found)) == 4


def test_byte_code_does_not_count(package: Path) -> None:
    before = digest()
    (package / "__pycache__").mkdir(exist_ok=True)
    (package / "__pycache__" / "more.pyc").write_text("")
    assert digest() == before


def test_the_place_does_not_count(package: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = digest()
    elsewhere = package.parent / "elsewhere"
    elsewhere.mkdir()
    package.rename(elsewhere / package.name)
    monkeypatch.delitem(sys.modules, "some_backend")
    monkeypatch.syspath_prepend(elsewhere)
    assert digest() == before


def test_a_module_of_one_file_has_a_digest_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "single_backend.py").write_text("ONE = 1\n")
    first = compute_source_digest("single_backend")
    compute_source_digest.cache_clear()
    (tmp_path / "single_backend.py").write_text("ONE = 2\n")
    assert compute_source_digest("single_backend") != first
