"""Checks the installed and missing parts of advercity on this machine."""

import platform
import shutil
import subprocess
from collections import Counter
from collections.abc import Callable, Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Any

import sumo
from advercity_dsl.registry import Registered
from advercity_dsl.sensor_kinds import load_sensor_kinds
from advercity_dsl.weather_parts import load_weather_parts

from advercity import __version__
from advercity.assets.catalogue import load_catalogue_blueprints
from advercity.assets.model_store import open_model_store
from advercity.assets.package_folders import DIGEST_FILE, is_damaged, is_unpacked
from advercity.assets.texture_store import describe_package, open_texture_store
from advercity.cli.other_commands import load_command_sets
from advercity.errors import AdvercityError, RunError
from advercity.exports.registry import load_export_formats
from advercity.pipeline.cache import find_cache_folder
from advercity.rendering.backend import list_backend_names, load_backend
from advercity.texture_packs import TEXTURE_PACKS

_MISSING = " is not installed; the shipped specs need `advercity assets install`"
_DAMAGED = ": is damaged; move its folder elsewhere, and `advercity assets install`"
_NO_MITSUBA = "is not installed; for `full` without a graphics card: `make setup MITSUBA=1`"
CheckResult = tuple[str, bool, str]
"""Name of the check, whether it passed, and its findings."""


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
    if "mitsuba" not in names:
        yield "backend mitsuba", True, _NO_MITSUBA
    for package in ("embreex", "rerun-sdk", "opencv-python-headless"):
        yield package, True, version(package)
    yield from _check_others("sensors", load_sensor_kinds())
    yield from _check_others("weather", load_weather_parts())
    yield from _check_others("formats", load_export_formats())
    yield from _check_others("commands", load_command_sets())
    yield from _check_packages()
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


def _check_others(title: str, found: Registered[Any]) -> Iterator[CheckResult]:
    """Check the records of one sort that other distributions register."""
    working: dict[str, list[str]] = {}
    for name, distribution in found.distributions.items():
        if name in found.broken:
            yield f"{title} {name}", False, found.broken[name]
        else:
            working.setdefault(distribution, []).append(name)
    for distribution, names in working.items():
        yield title, True, f"{', '.join(names)} of {distribution} {version(distribution)}"


def _check_packages() -> Iterator[CheckResult]:
    """Check third-party packages; missing ones have generated substitutes."""
    store, textures = open_model_store(), open_texture_store()
    names = {"pedestrian": "people"}
    found = Counter(
        names.get(blueprint.actor_class, "vehicles")
        for blueprint in load_catalogue_blueprints().values()
        if store.prepare_model(blueprint) is not None
    )
    for kind, package, folder in (
        ("vehicles", store.package, store.package_folder),
        ("people", store.people_package, store.people_folder),
    ):
        made = f"{found[kind]} blueprints from {package.name} {package.version}"
        if is_damaged(folder):
            yield kind, False, f"generated; {folder / DIGEST_FILE}{_DAMAGED}"
        else:
            is_installed = is_unpacked(package, folder)
            yield kind, True, made if is_installed else f"generated; {package.name}{_MISSING}"
    for pack in TEXTURE_PACKS.values():
        package = describe_package(pack)
        state = "installed" if textures.is_installed(pack) else _MISSING.strip()
        yield "photographs", True, f"{package.name} {package.version}: {state}"


def _check_cache() -> str:
    folder = find_cache_folder()
    folder.mkdir(parents=True, exist_ok=True)
    free_gb = shutil.disk_usage(folder).free / 1e9
    return f"{folder}, {free_gb:.0f} GB free"
