"""Checks whether a folder may hold a dataset."""

import re
from collections.abc import Iterator
from contextlib import suppress
from itertools import islice
from pathlib import Path

from advercity_dsl import DECLARATIONS

from advercity.atomic_files import resolve_links
from advercity.dataset.index import INDEX_FILE
from advercity.dataset.scenario_folders import (
    MANIFEST_FILE,
    check_is_outside_exports,
)
from advercity.errors import InputError, describe_cause
from advercity.output_files import check_is_outside_scenarios

MAX_LISTED = 100
"""Largest number of files and folders searched for declarations."""


def check_output_folder(path: Path) -> None:
    """Check whether a folder may hold a dataset.

    Raises:
        InputError: It is a file, a library, in a scenario or an export, the root or the home
            folder, or cannot exist.
    """
    try:
        if path.exists() and not path.is_dir():
            raise InputError(f"`output` {path}: is a file; name a folder")
        if path.is_symlink() and not path.exists():
            raise InputError(f"`output` {path}: is a link to {path.readlink()}, which is not there")
        check_is_outside_scenarios(path)
        check_is_outside_exports(path)
        _check_is_no_top_folder(path)
        declaration = next(filter(_is_declaration, _list_shallow_yaml_files(path)), None)
    except OSError as error:
        raise InputError(f"`output` {path!s:.60}: {describe_cause(error)}") from error
    if declaration is not None:
        raise InputError(
            f"`output` {path}: is a library, with {declaration.relative_to(path)}; name another"
            " folder for the dataset"
        )


def _check_is_no_top_folder(path: Path) -> None:
    """Refuse the root of the file system and the user's home folder."""
    if (path / INDEX_FILE).exists():
        return  # a run may continue an existing dataset
    tops = {Path(path.absolute().anchor): "the root of the file system"}
    with suppress(RuntimeError):  # a user without a home
        tops[resolve_links(Path.home())] = "your home folder"
    name = tops.get(resolve_links(path))
    if name is not None:
        raise InputError(f"`output` {path}: is {name}; name a folder in it")


def _list_shallow_yaml_files(folder: Path) -> Iterator[Path]:
    """List the first YAML files of a folder and of its subfolders, scenarios left out."""
    own = (name for name in folder.glob("*") if name.is_dir() and name.name[0] != ".")
    inside = [path for path in islice(own, MAX_LISTED) if not (path / MANIFEST_FILE).exists()]
    patterns = ((folder, "*.yaml"), *((path, "*.yaml") for path in inside))
    deeper = ((path, "*/*.yaml") for path in inside)
    for base, pattern in (*patterns, *deeper):
        yield from islice(base.glob(pattern), MAX_LISTED)


def _is_declaration(path: Path) -> bool:
    if not path.is_file():  # opening a pipe would wait for its writer
        return False
    with path.open("rb") as stream:
        found = re.search(rb"^kind: *(\w+)", stream.read(4096), re.MULTILINE)
    return found is not None and found[1].decode() in DECLARATIONS
