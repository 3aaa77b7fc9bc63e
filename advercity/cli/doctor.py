"""Checks what this machine has for advercity, and what is missing."""

import platform
import shutil
import subprocess
from collections.abc import Callable, Iterator
from importlib.metadata import version
from pathlib import Path

import sumo

from advercity import __version__
from advercity.assets.catalogue import load_catalogue_blueprints
from advercity.assets.model_store import open_model_store
from advercity.errors import AdvercityError, RunError
from advercity.pipeline.cache import find_cache_folder
from advercity.rendering.backend import list_backend_names, load_backend

CheckResult = tuple[str, bool, str]
"""Name of the check, whether it passed, and what was found."""


def check_machine() -> tuple[str, bool]:
    """Run every check; return a line per check, and whether all passed."""
    checks = list(_run_checks())
    width = max(len(name) for name, _, _ in checks)
    lines = [
        f"{'ok ' if fine else 'BAD'}  {name:<{width}}  {found}" for name, fine, found in checks
    ]
    return "\n".join(lines), all(fine for _, fine, _ in checks)


def _run_checks() -> Iterator[CheckResult]:
    yield "advercity", True, f"{__version__} on Python {platform.python_version()}"
    yield _run_check("traffic", _check_sumo)
    names = list_backend_names()
    if not names:
        yield "rendering", False, "no backend is installed; try: pip install advercity-sapien"
    for name in names:
        yield _run_check(f"backend {name}", lambda name=name: _check_backend(name))
    for package in ("embreex", "rerun-sdk", "opencv-python-headless"):
        yield package, True, version(package)
    yield _run_check("bodies", _check_bodies)
    yield _run_check("cache", _check_cache)


def _run_check(name: str, look: Callable[[], str]) -> CheckResult:
    try:
        return name, True, look()
    except (AdvercityError, ImportError, OSError) as error:
        return name, False, str(error)


def _check_sumo() -> str:
    program = Path(sumo.SUMO_HOME) / "bin" / "netconvert"
    done = subprocess.run(  # noqa: S603 - SUMO's own program
        [program, "--version"], capture_output=True, text=True, check=False
    )
    if done.returncode != 0:
        raise RunError(f"{program} does not run: {done.stderr.strip()}")
    return f"{done.stdout.splitlines()[0]}, libsumo {version('libsumo')}"


def _check_backend(name: str) -> str:
    found = load_backend(name).capabilities()
    rays = "raster and ray tracing" if found.ray_traced else "raster only"
    return f"{found.device}, {rays}"


def _check_bodies() -> str:
    if not open_model_store().has_package:
        return "procedural; the shipped specs need `advercity assets install`"
    found = [
        open_model_store().prepare_model(blueprint)
        for blueprint in load_catalogue_blueprints().values()
    ]
    count = sum(path is not None for path in found)
    return f"{count} of {len(found)} are models of the asset pack, the rest procedural"


def _check_cache() -> str:
    folder = find_cache_folder()
    folder.mkdir(parents=True, exist_ok=True)
    free_gb = shutil.disk_usage(folder).free / 1e9
    return f"{folder}, {free_gb:.0f} GB free"
