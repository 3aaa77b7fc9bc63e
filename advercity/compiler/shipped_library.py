"""The library of advercity, and the examples in it, which you can copy."""

import shutil
from collections.abc import Iterable
from importlib.resources import files
from pathlib import Path

from advercity_dsl.base import suggest_name

from advercity.errors import InputError, report_write_errors
from advercity.output_files import check_is_outside_scenarios

EXAMPLES_FOLDER = "examples"
"""Folder of declarations to copy from, which is not part of the library around it."""


def find_shipped_library() -> Path:
    """Return the library of the installed package, or of the checkout around the source."""
    # The checkout first: an editable install can leave a stale copy inside the package.
    folder = Path(__file__).parents[2] / "library"
    return folder if folder.is_dir() else Path(str(files("advercity") / "_library"))


def copy_shipped_library(folder: Path) -> Path:
    """Copy advercity's library into a new folder and return the folder.

    Raises:
        InputError: The folder exists, or is in a dataset.
        RunError: It cannot be written.
    """
    if folder.exists() or folder.is_symlink():
        raise InputError(f"{folder}: exists; name a new folder")
    check_is_outside_scenarios(folder)
    with report_write_errors():
        return shutil.copytree(find_shipped_library(), folder)


def find_example(kind: str, name: str) -> Path | None:
    """Find the example with a name; None without one."""
    return _find_declaration(EXAMPLES_FOLDER, kind, name)


def _find_declaration(folder: str, kind: str, name: str) -> Path | None:
    for path in find_shipped_library().glob(f"{folder}/*.yaml"):
        if path.stem == name and f"\nkind: {kind}\n" in path.read_text(encoding="utf-8"):
            return path
    return None


def suggest_declaration(kind: str, name: str, valid: Iterable[str]) -> str:
    """Return a hint with the example or library of this name, else with similar or all names."""
    example = find_example(kind, name)
    if example is not None:
        return f"an example has this name; copy {example} into the library"
    if _find_declaration("**", kind, name) is not None:
        return (
            "advercity's library has it; name its folder, too (`advercity library path` prints it)"
        )
    return suggest_name(name, valid)
