"""The wheels, installed without the repository: what a checkout hides, they show."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
BESIDE = [ROOT / "backends/sapien", *sorted((ROOT / "packages").iterdir())]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder where the wheels are installed, their dependencies left to the environment."""
    wheels, target = tmp_path_factory.mktemp("wheels"), tmp_path_factory.mktemp("site")
    for project in (ROOT, *BESIDE):
        build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(wheels)]
        subprocess.run(build, cwd=project, check=True)
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index"]
    subprocess.run([*pip, "--target", target, *wheels.glob("*.whl")], check=True)
    return target


def run_with(site: Path, code: str) -> str:
    """Run `code` in another folder, on what is installed in `site`."""
    result = subprocess.run(
        [sys.executable, "-c", code],
        cwd=site.parent,
        env={**os.environ, "PYTHONPATH": str(site)},
        check=True,
        stdout=subprocess.PIPE,
        text=True,
    )
    return result.stdout.strip()


@pytest.mark.parametrize(
    "package",
    ["advercity", "advercity_dsl", *(f"advercity_{path.name}" for path in BESIDE)],
)
def test_every_package_is_imported_from_its_wheel(site: Path, package: str):
    found = run_with(site, f"import {package}; print({package}.__file__)")
    assert Path(found) == site / package / "__init__.py"


def test_every_source_file_is_in_the_wheels(site: Path):
    sources = {
        Path(package, path.relative_to(folder / package))
        for folder, package in (
            (ROOT, "advercity"),
            (ROOT / "dsl", "advercity_dsl"),
            *((path, f"advercity_{path.name}") for path in BESIDE),
        )
        for path in (folder / package).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    assert {path for path in sources if not (site / path).is_file()} == set()


def test_the_shipped_library_is_found_without_a_checkout(site: Path):
    code = "from advercity.compiler import find_shipped_library as find; print(find())"
    shipped = Path(run_with(site, code))
    assert shipped == site / "advercity/_library"
    for path in (ROOT / "library").rglob("*.yaml"):
        assert (shipped / path.relative_to(ROOT / "library")).read_bytes() == path.read_bytes()


def test_the_backend_is_found_by_its_name(site: Path):
    code = "from advercity.rendering.backend import load_backend; print(load_backend('sapien'))"
    assert "advercity_sapien" in run_with(site, code)
