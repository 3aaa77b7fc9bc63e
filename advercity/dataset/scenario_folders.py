"""Finds a dataset's scenarios, and explains errors of other folders.

Imports no pydantic model: building one takes longer than opening a dataset.
"""

import errno
import os
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Final

from advercity.atomic_files import resolve_links
from advercity.documents import MAX_JSON_BYTES, parse_json, read_bytes, suggest_path
from advercity.errors import InputError, RunError
from advercity.output_files import (
    MANIFEST_FILE,
    PROTOCOL_FILE,
    STAGING_FOLDER,
    is_dataset_or_scenario,
)

SPLITS_FILE = "splits.json"
EXPORT_FILE = "export.json"
MANIFEST_VERSION: Final = 5
"""Version of the manifest's fields, for writing and reading."""


def find_scenarios(dataset: Path) -> list[Path]:
    """Find the scenario folders in a dataset or its splits; a scenario's folder finds itself.

    Raises:
        InputError: The folder holds no scenario.
        RunError: The folder, or one in it, may not be read.
    """
    # `Path` has turned `//` into `/`; a single letter before the colon is a drive of Windows.
    if re.match(r"[a-z0-9+]{2,}:/", str(dataset)):
        raise InputError(
            f"{dataset}: is the URL of a store, which only `run --executor ray` and `verify` read;"
            " copy the dataset into a folder first, as `aws s3 sync` does"
        )
    if dataset.name in ("", ".."):
        dataset = resolve_links(dataset)  # a scenario goes by the name of its folder
    for pattern in (".", "*/", "*/*/"):
        # `glob` passes over unreadable folders as if they were empty.
        for folder in dataset.glob(pattern) if pattern != "." else (dataset,):
            if folder.name != "lost+found":  # of every disk, and for its administrator only
                check_is_readable(folder)
        found = sorted(path.parent for path in dataset.glob(f"{pattern}/{MANIFEST_FILE}"))
        if found:
            return found
    raise _not_a_dataset_error(dataset, "in it or in its folders")


def check_is_readable(folder: Path) -> None:
    """Raise a RunError if a folder exists, and its files may not be listed or opened."""
    if folder.is_dir() and not os.access(folder, os.R_OK | os.X_OK):
        raise RunError(f"{folder}: cannot be read: {os.strerror(errno.EACCES)}")


def find_scenarios_by_name(dataset: Path) -> dict[str, Path]:
    """Find the scenario folders as `find_scenarios` does, by name.

    Raises:
        InputError: The folder holds no scenario, or two of one name.
    """
    found: dict[str, Path] = {}
    for folder in find_scenarios(dataset):
        other = found.setdefault(folder.name, folder)
        if other != folder:
            raise InputError(
                f"{folder}: has the name of {other}; name one of the two datasets, or rename one of"
                " the folders"
            )
    return found


def find_staging_folder(scenario: Path) -> Path:
    """Find the folder of a scenario's unfinished files.

    It is outside the scenario because loaders of OPV2V take every folder in a scenario for an
    agent. For a link, as in a split, it is beside the folder the link leads to.
    """
    # `Path.is_symlink` fails in an unreadable folder, which the caller is to report.
    real = resolve_links(scenario) if os.path.islink(scenario) else scenario  # noqa: PTH114
    return real.parent / STAGING_FOLDER / real.name


def check_folders_are_no_links(scenario: Path, folders: Iterable[str]) -> None:
    """Check for links to folders in a scenario; the dataset itself may be a link.

    Args:
        scenario: Folder of the scenario.
        folders: Names of the agents' folders.

    Raises:
        RunError: A folder is a link, through which a run would change files elsewhere.
    """
    staging = find_staging_folder(scenario)
    inside = (scenario, staging.parent, staging, staging / "incoming", staging / "claims")
    of_agents = [parent / name for name in folders for parent in (scenario, staging / "incoming")]
    for path in (*inside, *of_agents):
        if path.is_symlink():
            kind = "file" if path.is_file() else "folder"
            raise RunError(
                f"{path}: is a link to {path.readlink()}; a dataset is written in real folders and"
                f" files only: put the {kind} itself in place of the link"
            )


def check_is_outside_datasets(output: Path) -> None:
    """Check that a new folder is no dataset and in none, by its own path and by links.

    Loaders of OPV2V take a folder in a dataset for a scenario, and one in a scenario for an agent.

    Raises:
        InputError: It is.
    """
    for path in (output.absolute(), resolve_links(output)):
        if is_dataset_or_scenario(path):
            raise InputError(f"`output` {output}: is a dataset; name a folder beside it")
        if any(is_dataset_or_scenario(parent) or _has_splits(parent) for parent in path.parents):
            raise InputError(f"`output` {output}: is in a dataset; name a folder beside it")


def check_is_outside_exports(output: Path, *, may_be_one: bool = False) -> None:
    """Check that a new folder is not in an export, whose files a manifest lists.

    Args:
        output: The folder.
        may_be_one: Whether it may be an export itself.

    Raises:
        InputError: It is.
    """
    for path in (output.absolute(), resolve_links(output)):
        if not may_be_one and _is_export(path):
            raise InputError(f"`output` {output}: is an export; name a folder beside it")
        if any(map(_is_export, path.parents)):
            raise InputError(f"`output` {output}: is in an export; name a folder beside it")


def _is_export(folder: Path) -> bool:
    """Return whether a folder is an export; other programs use this name for manifests, too."""
    path = folder / EXPORT_FILE
    try:
        document = parse_json(read_bytes(path, max_bytes=MAX_JSON_BYTES), path)
    except (InputError, OSError):
        return False
    return isinstance(document, dict) and "export_version" in document


def _has_splits(folder: Path) -> bool:
    return (folder / SPLITS_FILE).is_file() and any(folder.glob(f"*/*/{PROTOCOL_FILE}"))


def find_journals(scenario: Path) -> list[Path]:
    """Find the journals of frames written since the last manifest, one per process."""
    found = find_staging_folder(scenario).glob("journal_*.jsonl")
    return sorted(path for path in found if re.fullmatch(r"journal_[0-9]+", path.stem))


def not_a_scenario_error(folder: Path) -> InputError:
    """Explain why a folder is no scenario; for a dataset, list scenarios to choose from."""
    inside = sorted(path.parent.name for path in folder.glob(f"*/{MANIFEST_FILE}"))
    if not inside:
        return _not_a_dataset_error(folder, "in it")
    more = f" and {len(inside) - 3} more" if len(inside) > 3 else ""
    names = ", ".join(inside[:3])
    return InputError(f"{folder}: is a dataset; name one of its scenarios: {names}{more}")


def no_dataset_to_replace_error(folder: Path | str) -> RunError:
    """Explain why a run does not write into a folder with other files."""
    return RunError(
        f"{folder}: holds files but no {MANIFEST_FILE}, so not a dataset; delete it, or choose"
        " another `output`"
    )


def no_frames_error(path: Path) -> InputError:
    """Explain the missing frames of a scenario or a whole dataset."""
    return InputError(f"{path}: no frames here yet; `advercity run` with its spec makes them")


def _not_a_dataset_error(folder: Path, where: str) -> InputError:
    if not folder.exists():
        hint = suggest_path(folder) or "is the path right?"
        return InputError(f"{folder}: no such folder; {hint}")
    if not folder.is_dir():
        return InputError(f"{folder}: is a file; name the folder of a dataset")
    if (folder.parent / MANIFEST_FILE).exists():
        return InputError(f"{folder}: is a part of a scenario; name {folder.parent}")
    depths = ("*", "*/*", "*/*/*")
    is_foreign = any(any(folder.glob(f"{depth}/[0-9]*.yaml")) for depth in depths)
    hint = "; for a foreign folder give `layout`, such as opv2v" if is_foreign else ""
    return InputError(f"{folder}: no {MANIFEST_FILE} {where}, so not a dataset{hint}")
