"""Damages declarations and specs: each must be read, or rejected with a message."""

import shutil
from pathlib import Path

import numpy as np
from mutations import choose, mutate, time_limit

from advercity.compiler import read_spec, validate_paths, write_specs
from advercity.compiler.crossing import compile_library
from advercity.errors import InputError
from advercity.randomness import create_generator

ROOT = Path(__file__).parent.parent
SMALL_LIBRARY = ROOT / "tests" / "compiler" / "base"


def check_declaration(number: int, seed: int, folder: Path) -> str:
    """Damage a file of a library and compile it: `read` or `refused`; anything else is raised.

    Args:
        number: Number of the mutation; with `seed` it decides everything.
        seed: Seed of the series.
        folder: An empty folder to work in.
    """
    rng = create_generator(seed, "declaration", number)
    with time_limit():
        match int(rng.integers(3)):
            case 0:
                return _check_library(rng, folder)
            case 1:
                return _check_library(rng, folder, only="suite")
            case _:
                return _check_file(
                    choose(sorted((ROOT / "library").rglob("*.yaml")), rng), rng, folder
                )


def check_spec(number: int, seed: int, folder: Path) -> str:
    """Damage a spec and validate it, as `check_declaration` does with a declaration."""
    rng = create_generator(seed, "spec", number)
    with time_limit():
        return _check_file(choose(sorted((ROOT / "compiled").glob("*.json")), rng), rng, folder)


def _check_library(rng: np.random.Generator, folder: Path, only: str = "*") -> str:
    library, output = folder / "library", folder / "output"
    shutil.copytree(SMALL_LIBRARY, library)
    files = sorted(library.glob(f"{only}.yaml"))
    path = files[int(rng.integers(len(files)))]
    path.write_bytes(mutate(path.read_text(), rng))
    before = {item for item in folder.rglob("*") if item.is_file()}
    try:
        write_specs(compile_library(library), output)
    except InputError as error:
        assert str(error).strip(), "empty message"
        assert not output.exists(), "partial output is left"
        return "refused"
    for spec in output.glob("*.json"):
        read_spec(spec)
    new = {item for item in folder.rglob("*") if item.is_file()} - before
    assert all(item.parent == output for item in new), f"files elsewhere: {new}"
    return "read"


def _check_file(original: Path, rng: np.random.Generator, folder: Path) -> str:
    path = folder / original.name
    path.write_bytes(mutate(original.read_text(), rng))
    try:
        validate_paths(path)
    except InputError as error:
        assert str(error).startswith(str(folder)), f"no file in the message: {error}"
        return "refused"
    return "read"
