"""What this machine has for advercity, and what is missing."""

import platform
import shutil
import subprocess
from collections.abc import Callable, Iterator
from importlib.metadata import version
from pathlib import Path

import sumo

from advercity import __version__
from advercity.errors import AdvercityError, RunError
from advercity.rendering.registry import backend_names, load_backend
from advercity.runner.bodies import catalogue_blueprints
from advercity.runner.cache import cache_folder, shelf

Check = tuple[str, bool, str]
"""What was looked at, whether it is fine, and what was found."""


def report() -> tuple[str, bool]:
    """One line per check, and whether all are fine."""
    checks = list(_checks())
    width = max(len(name) for name, _, _ in checks)
    lines = [
        f"{'ok ' if fine else 'BAD'}  {name:<{width}}  {found}" for name, fine, found in checks
    ]
    return "\n".join(lines), all(fine for _, fine, _ in checks)


def _checks() -> Iterator[Check]:
    yield "advercity", True, f"{__version__} on Python {platform.python_version()}"
    yield _attempt("traffic", _sumo)
    names = backend_names()
    if not names:
        yield "rendering", False, "no backend is installed; try: pip install advercity-sapien"
    for name in names:
        yield _attempt(f"backend {name}", lambda name=name: _backend(name))
    for package in ("embreex", "rerun-sdk", "opencv-python-headless"):
        yield package, True, version(package)
    yield _attempt("bodies", _bodies)
    yield _attempt("cache", _cache)


def _attempt(name: str, look: Callable[[], str]) -> Check:
    try:
        return name, True, look()
    except (AdvercityError, ImportError, OSError) as error:
        return name, False, str(error)


def _sumo() -> str:
    program = Path(sumo.SUMO_HOME) / "bin" / "netconvert"
    done = subprocess.run(  # noqa: S603 - SUMO's own program
        [program, "--version"], capture_output=True, text=True, check=False
    )
    if done.returncode != 0:
        raise RunError(f"{program} does not run: {done.stderr.strip()}")
    return f"{done.stdout.splitlines()[0]}, libsumo {version('libsumo')}"


def _backend(name: str) -> str:
    found = load_backend(name).capabilities()
    rays = "raster and ray tracing" if found.ray_traced else "raster only"
    return f"{found.device}, {rays}"


def _bodies() -> str:
    if not shelf().has_pack:
        return "shaped by the program; `advercity assets install` fetches models"
    found = [shelf().find(blueprint) for blueprint in catalogue_blueprints().values()]
    count = sum(path is not None for path in found)
    return f"{count} of {len(found)} made of the asset pack's models, the rest shaped"


def _cache() -> str:
    folder = cache_folder()
    folder.mkdir(parents=True, exist_ok=True)
    free_gb = shutil.disk_usage(folder).free / 1e9
    return f"{folder}, {free_gb:.0f} GB free"
