"""Whether a dataset still is as its manifests and its index say."""

import hashlib
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from advercity.dataset.index import Index
from advercity.dataset.journal import FileRecord
from advercity.dataset.manifest import MANIFEST, Manifest, scenarios
from advercity.errors import RunError


@dataclass(frozen=True)
class Problem:
    """A file that is not as the manifest has it."""

    scenario: Path
    path: str
    """Within the scenario."""
    kind: Literal["missing", "extra", "changed"]
    frame: int | None = None
    """That has to be written again; None if no frame has."""

    def __str__(self) -> str:
        return f"{self.scenario / self.path}: {self.kind}"


def verify_dataset(dataset: Path) -> list[Problem]:
    """Problems of every scenario of a dataset, or of the one scenario that it is.

    Where there is an index, also of the scenarios in it that are gone, and of manifests that are
    others than it says.

    Raises:
        InputError: There is no dataset.
        RunError: A file cannot be read.
    """
    unlike = unlike_the_index(dataset)
    if unlike and not any(path.exists() for path in dataset.glob(f"*/{MANIFEST}")):
        return unlike
    return [*unlike, *(item for scenario in scenarios(dataset) for item in verify(scenario))]


def unlike_the_index(dataset: Path) -> list[Problem]:
    """Scenarios of the index that are gone, and manifests that are others than it says.

    Raises:
        RunError: A file cannot be read.
    """
    index = Index.of_folder(dataset) or Index()
    problems: list[Problem] = []
    for name in sorted(index.made):
        path = dataset / name / MANIFEST
        try:
            if not index.agrees(name, path.read_bytes()):
                problems.append(Problem(dataset / name, MANIFEST, "changed"))
        except FileNotFoundError:
            problems.append(Problem(dataset / name, MANIFEST, "missing"))
        except OSError as error:
            raise RunError(f"{path}: cannot be read: {error.strerror}") from error
    return problems


def verify(scenario: Path) -> list[Problem]:
    """Compare every file of a scenario with its manifest, by size and checksum.

    Raises:
        InputError: The folder has no manifest.
        RunError: A file cannot be read.
    """
    return compare(
        scenario,
        Manifest.load(scenario),
        _paths(scenario),
        lambda path, record: _matches(scenario / path, record),
    )


def compare(
    scenario: Path,
    manifest: Manifest,
    paths: Iterable[str],
    matches: Callable[[str, FileRecord], bool],
) -> list[Problem]:
    """Compare what is there of a scenario with its manifest.

    Args:
        scenario: Its folder, for the problems.
        manifest: What ought to be there.
        paths: What is there, within the scenario.
        matches: Whether the file at a path is as recorded; called by several threads.
    """
    recorded, found = manifest.files, set(paths) - {MANIFEST}
    problems = [Problem(scenario, path, "extra") for path in found - recorded.keys()]
    missing = recorded.keys() - found
    problems += [Problem(scenario, path, "missing", recorded[path].frame) for path in missing]
    present = {path: record for path, record in recorded.items() if path in found}
    with ThreadPoolExecutor() as pool:
        same = pool.map(matches, present, present.values())
        problems += [
            Problem(scenario, path, "changed", record.frame)
            for (path, record), is_same in zip(present.items(), same, strict=True)
            if not is_same
        ]
    return sorted(problems, key=lambda problem: problem.path)


def _paths(scenario: Path) -> Iterator[str]:
    for path in scenario.rglob("*"):
        if not path.is_dir():
            yield path.relative_to(scenario).as_posix()


def _matches(path: Path, record: FileRecord) -> bool:
    try:
        if path.stat().st_size != record.size:
            return False
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest() == record.sha256
    except OSError as error:
        raise RunError(f"{path}: cannot be read: {error.strerror}") from error
