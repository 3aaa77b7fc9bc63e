import ast
import functools
import re
import subprocess
import sys
import tomllib
from importlib.metadata import packages_distributions
from itertools import chain
from pathlib import Path

import pytest

from advercity.pipeline.cache import TRAFFIC_CODE, WORLD_CODE

ROOT = Path(__file__).parent.parent
ROOMS = (
    (
        "errors",
        "diagnostics",
        "documents",
        "semantics",
        "materials",
        "material_maps",
        "image_files",
        "media",
        "digests",
        "identity_cache",
        "array_files",
        "atomic_files",
        "data_folder",
        "output_files",
        "processes",
        "run_options",
        "texture_packs",
    ),
    ("foreign",),
    ("geometry", "randomness"),
    ("physics",),
    ("frames", "signal_heads"),
    ("roads", "recordings"),
    ("world",),
    ("conflicts",),
    ("compiler",),
    ("traffic",),
    ("assets",),
    ("scene",),
    ("rendering",),
    ("sensors",),
    ("channel",),
    ("dataset",),
    ("viewer",),
    ("pipeline",),
    ("exports",),
    ("api", "testing"),
    ("cli",),
)
LAYERS = {
    "advercity_dsl": 0,
    **{name: number for number, names in enumerate(ROOMS, start=1) for name in names},
}
"""Imports run from a higher layer to a lower one, never back."""

DISTRIBUTIONS = sorted(path.parent for path in ROOT.glob("packages/*/pyproject.toml"))
"""Distributions beside the core, which finds them by their entry points."""


def modules(folder: Path | None = None) -> list[Path]:
    """List the modules of a distribution; without one, of the core."""
    folders = [folder] if folder else [ROOT / "advercity", ROOT / "dsl"]
    return sorted(path for one in folders for path in one.rglob("*.py"))


def part_of(module: str) -> str:
    names = module.split(".")
    return names[0] if names[0] == "advercity_dsl" or len(names) == 1 else names[1]


@functools.cache
def list_imports(path: Path) -> frozenset[str]:
    """Names that a module imports, wherever in it: modules, and what is taken from them."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return frozenset(found)


@pytest.mark.parametrize("path", modules(), ids=lambda path: str(path.relative_to(ROOT)))
def test_imports_run_one_way(path: Path) -> None:
    base = ROOT / "dsl" if (ROOT / "dsl") in path.parents else ROOT
    own = part_of(".".join(path.relative_to(base).with_suffix("").parts))
    assert own in {*LAYERS, "__init__"}
    for name in list_imports(path):
        package, other = name.split(".")[0], part_of(name)
        if package in ("advercity", "advercity_dsl") and other in LAYERS and own in LAYERS:
            assert LAYERS[other] <= LAYERS[own], f"{own} must not import {name}"


@pytest.mark.parametrize("folder", [ROOT / "advercity", *DISTRIBUTIONS], ids=lambda path: path.name)
def test_a_distribution_imports_the_core_alone(folder: Path) -> None:
    own = {path.name for path in folder.iterdir()} | {"advercity", "advercity_dsl"}
    found = {name.split(".")[0] for path in modules(folder) for name in list_imports(path)}
    assert {name for name in found if name.startswith("advercity")} <= own


@pytest.mark.parametrize(
    ("library", "home"),
    [
        ("rerun", {"viewer"}),
        ("sapien", set[str]()),
        ("libsumo", {"traffic"}),
        ("typer", {"cli"}),
        ("embreex", {"rendering"}),
        ("fsspec", {"dataset"}),
        ("ray", set[str]()),
    ],
)
def test_each_engine_has_one_home(library: str, home: set[str]) -> None:
    users = {
        path.relative_to(ROOT).parts[1]
        for path in modules()
        if any(name.split(".")[0] == library for name in list_imports(path))
    }
    assert users <= home


def list_requirements(folder: Path) -> set[str]:
    """List the distributions that one and its extras require."""
    project = tomllib.loads((folder / "pyproject.toml").read_text())["project"]
    extras = project.get("optional-dependencies", {})
    listed = [*project["dependencies"], *chain(*extras.values())]
    return {re.split(r"[^\w-]", item)[0].lower().replace("_", "-") for item in listed}


@pytest.mark.parametrize("folder", [ROOT, *DISTRIBUTIONS], ids=lambda path: path.name)
def test_each_imported_package_is_required(folder: Path) -> None:
    """Packages of the development environment are not on a user's machine."""
    owners, required = packages_distributions(), list_requirements(folder)
    paths = modules(None if folder == ROOT else folder)
    imported = {name.split(".")[0] for path in paths for name in list_imports(path)}
    own = {"advercity", "advercity_dsl", *(path.name for path in folder.iterdir())}
    others = imported - own - sys.stdlib_module_names
    with_others = {"annotated_types", "pydantic_core", "pyoidn"}  # of pydantic, and of backends
    missing = {
        name
        for name in others - with_others
        if not required & {owner.lower().replace("_", "-") for owner in owners.get(name, [name])}
    }
    assert missing == set()


def test_files_of_sensors_load_nothing_that_measures_or_shows() -> None:
    code = (
        "import sys; from advercity.dataset.sensor_files import load_all_files; load_all_files();"
    )
    code += "print([name for name in sys.modules if 'driver' in name or '.viewer' in name])"
    child = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert child.stdout.strip() == "[]"


def test_a_worker_loads_no_library_that_its_run_may_do_without() -> None:
    libraries = {"rerun", "trimesh", "ray", "pandas", "matplotlib"}
    code = f"import sys, advercity.pipeline.worker_process; print({libraries} & {{*sys.modules}})"
    child = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert child.stdout.strip() == "set()"


@pytest.mark.parametrize("listed", [TRAFFIC_CODE, WORLD_CODE])
def test_a_key_of_the_cache_covers_each_module_that_makes_its_entry(
    listed: tuple[str, ...],
) -> None:
    users = [path for path in modules() if name_module(path) in listed]
    imported = {name for path in users for name in list_imports(path)}
    own = {".".join(name.split(".")[:2]) for name in imported if name.startswith("advercity.")}
    assert {name for name in own if is_module(name)} <= {*listed}


def name_module(path: Path) -> str:
    """Name the package, or the module at the root, that a file is part of."""
    if (ROOT / "dsl") in path.parents:
        return "advercity_dsl"
    return ".".join(path.relative_to(ROOT).with_suffix("").parts[:2])


def is_module(name: str) -> bool:
    return (ROOT / name.replace(".", "/")).with_suffix(".py").exists() or (
        ROOT / name.replace(".", "/")
    ).is_dir()
