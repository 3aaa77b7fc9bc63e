"""Splits of a dataset by road, as folders of links that loaders take as their roots."""

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from advercity.dataset.manifest import Manifest, scenarios
from advercity.errors import InputError, RunError

PAPER = {"train": ("ri", "rsnj", "unj"), "validate": ("rcnj",), "test": ("ui",)}
"""Roads by split, as Adver-City was published."""
INDEX = "splits.json"


def split(
    dataset: Path, output: Path, roads: Mapping[str, Sequence[str]] = PAPER
) -> dict[str, list[str]]:
    """Link every scenario into `output/<split>/`, and write an index; scenarios by split.

    Nothing is copied. Calling it again brings the links up to date.

    Raises:
        InputError: A road belongs to no split, or to two.
        RunError: The links cannot be made.
    """
    split_of = _split_of(roads)
    folders = scenarios(dataset)
    found: dict[str, list[str]] = {name: [] for name in roads}
    for folder in folders:
        road = Manifest.load(folder).spec.road.id
        if road not in split_of:
            raise InputError(f"{folder}: road '{road}' is in no split; name it in one")
        found[split_of[road]].append(folder.name)
    try:
        _link({folder.name: folder for folder in folders}, found, output)
    except OSError as error:
        raise RunError(
            f"{error.filename or output}: cannot be written: {error.strerror}"
        ) from error
    return found


def _split_of(roads: Mapping[str, Sequence[str]]) -> dict[str, str]:
    names = [road for chosen in roads.values() for road in chosen]
    twice = sorted({road for road in names if names.count(road) > 1})
    if twice:
        raise InputError(f"road '{twice[0]}' is in two splits; leave it in one")
    return {road: name for name, chosen in roads.items() for road in chosen}


def _link(folders: dict[str, Path], found: dict[str, list[str]], output: Path) -> None:
    for name, members in found.items():
        split_folder = output / name
        split_folder.mkdir(parents=True, exist_ok=True)
        for link in split_folder.iterdir():
            if link.is_symlink():
                link.unlink()
        for member in members:
            target = os.path.relpath(folders[member].resolve(), split_folder.resolve())
            (split_folder / member).symlink_to(target)
    (output / INDEX).write_text(json.dumps(found, indent=1) + "\n")
