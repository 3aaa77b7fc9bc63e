"""Whether a dataset still is as its manifests and its index say.

Puts back files of a scenario as its manifest has them, and touches no others.
"""

import hashlib
import shutil
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from advercity.dataset.formats import find_format, format_frame_name
from advercity.dataset.index import DatasetIndex
from advercity.dataset.manifest import Manifest
from advercity.dataset.opv2v import FRAME_ENCODERS
from advercity.dataset.partial_files import (
    FileRecord,
    lock_file,
    move_file,
    report_disk_errors,
    write_file,
)
from advercity.dataset.scenario_folders import (
    MANIFEST_FILE,
    find_journals,
    find_scenarios,
    find_staging_folder,
)
from advercity.dataset.writer import encode_scenario_files
from advercity.errors import RunError
from advercity.roads.road_network import build_road
from advercity.sensors.sensor_frame import SensorFrame


@dataclass(frozen=True)
class FileProblem:
    """A file that is not as the manifest has it."""

    scenario: Path
    path: str
    """Within the scenario."""
    kind: Literal["missing", "extra", "changed"]
    frame: int | None = None
    """That has to be written again; None if no frame has."""

    def __str__(self) -> str:
        return f"{self.scenario / self.path}: {self.kind}"


def verify_dataset(dataset: Path) -> list[FileProblem]:
    """Problems of every scenario of a dataset, or of the one scenario that it is.

    Where there is an index, also of the scenarios in it that are gone, and of manifests that are
    others than it says.

    Raises:
        InputError: There is no dataset.
        RunError: A file cannot be read.
    """
    unlike = compare_with_index(dataset)
    if unlike and not any(path.exists() for path in dataset.glob(f"*/{MANIFEST_FILE}")):
        return unlike
    return [
        *unlike,
        *(item for scenario in find_scenarios(dataset) for item in verify_scenario(scenario)),
    ]


def compare_with_index(dataset: Path) -> list[FileProblem]:
    """Scenarios of the index that are gone, and manifests that are others than it says.

    Raises:
        RunError: A file cannot be read.
    """
    index = DatasetIndex.load(dataset) or DatasetIndex()
    problems: list[FileProblem] = []
    for name in sorted(index.present_scenarios):
        path = dataset / name / MANIFEST_FILE
        try:
            if not index.matches_manifest(name, path.read_bytes()):
                problems.append(FileProblem(dataset / name, MANIFEST_FILE, "changed"))
        except FileNotFoundError:
            problems.append(FileProblem(dataset / name, MANIFEST_FILE, "missing"))
        except OSError as error:
            raise RunError(f"{path}: cannot be read: {error.strerror}") from error
    return problems


def verify_scenario(scenario: Path) -> list[FileProblem]:
    """Compare every file of a scenario with its manifest, by size and checksum.

    Raises:
        InputError: The folder has no manifest.
        RunError: A file cannot be read.
    """
    return compare_with_manifest(
        scenario,
        Manifest.load(scenario),
        _list_files(scenario),
        lambda path, record: _matches_record(scenario / path, record),
    )


def compare_with_manifest(
    scenario: Path,
    manifest: Manifest,
    paths: Iterable[str],
    matches: Callable[[str, FileRecord], bool],
) -> list[FileProblem]:
    """Compare what is there of a scenario with its manifest.

    Args:
        scenario: Its folder, for the problems.
        manifest: What ought to be there.
        paths: What is there, within the scenario.
        matches: Whether the file at a path is as recorded; called by several threads.
    """
    recorded, found = manifest.files, set(paths) - {MANIFEST_FILE}
    problems = [FileProblem(scenario, path, "extra") for path in found - recorded.keys()]
    missing = recorded.keys() - found
    problems += [FileProblem(scenario, path, "missing", recorded[path].frame) for path in missing]
    present = {path: record for path, record in recorded.items() if path in found}
    with ThreadPoolExecutor() as pool:
        same = pool.map(matches, present, present.values())
        problems += [
            FileProblem(scenario, path, "changed", record.frame)
            for (path, record), is_same in zip(present.items(), same, strict=True)
            if not is_same
        ]
    return sorted(problems, key=lambda problem: problem.path)


def _list_files(scenario: Path) -> Iterator[str]:
    for path in scenario.rglob("*"):
        if not path.is_dir():
            yield path.relative_to(scenario).as_posix()


def _matches_record(path: Path, record: FileRecord) -> bool:
    try:
        if path.stat().st_size != record.size:
            return False
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest() == record.sha256
    except OSError as error:
        raise RunError(f"{path}: cannot be read: {error.strerror}") from error


SensorFrameSource = Callable[[int], tuple[SensorFrame, ...]]


def restore_files(
    scenario: Path, problems: Iterable[FileProblem], readings_of: SensorFrameSource
) -> list[FileProblem]:
    """Mend what `verify` found; the problems that stay, which are files of somebody else.

    Frames are made again one by one; of each, the files that are missing or changed take their
    places by renaming, once their checksums are those of the manifest. So whatever interrupts it,
    the scenario is no worse than before, and the same call goes on.

    Args:
        scenario: Folder of the scenario.
        problems: What is wrong with it.
        readings_of: Makes the readings of a frame.

    Raises:
        RunError: What is made again is not what was there, another run is writing, or the disk
            does not take it.
    """
    manifest = Manifest.load(scenario)
    found = list(problems)
    staging = find_staging_folder(scenario)
    with report_disk_errors(scenario), lock_file(staging / "lock"):
        _remove_leftovers(scenario, manifest, found)
        damaged = {problem.path for problem in found if problem.kind != "extra"}
        beside = encode_scenario_files(manifest.spec, manifest.identity)
        _replace_files(scenario, manifest, {path: beside[path] for path in damaged & beside.keys()})
        for frame in sorted({item.frame for item in found if item.frame is not None}):
            files = _encode_frame_files(manifest, frame, readings_of(frame))
            _replace_files(
                scenario, manifest, {path: files[path] for path in damaged & files.keys()}
            )
        shutil.rmtree(staging / "incoming", ignore_errors=True)
        if not find_journals(scenario):
            shutil.rmtree(staging)
            with suppress(OSError):  # another scenario is being written
                staging.parent.rmdir()
    return [item for item in found if item.kind == "extra" and (scenario / item.path).exists()]


def _encode_frame_files(
    manifest: Manifest, frame: int, readings: tuple[SensorFrame, ...]
) -> dict[str, bytes]:
    encode = FRAME_ENCODERS[manifest.identity.format]
    lanes = build_road(manifest.spec.road).lanes
    return encode(readings, lanes, name=format_frame_name(manifest.spec, frame))


def _replace_files(scenario: Path, manifest: Manifest, files: dict[str, bytes]) -> None:
    incoming = find_staging_folder(scenario) / "incoming"
    for path, content in files.items():
        expected = manifest.files[path]
        if FileRecord.from_content(content, frame=expected.frame) != expected:
            raise RunError(
                f"{scenario / path}: comes out other than the manifest has it, although spec,"
                " traffic, versions and device are the same; it is left as it is:"
                " `advercity run --fresh` makes the scenario anew"
            )
        write_file(incoming / path, content)
        move_file(incoming / path, scenario / path)


def _remove_leftovers(scenario: Path, manifest: Manifest, problems: Iterable[FileProblem]) -> None:
    """What a killed run left of a frame; anything else that is extra may be precious."""
    folders = {
        find_format(manifest.identity.format).format_folder(agent) for agent in manifest.spec.agents
    }
    for problem in problems:
        folder, _, name = problem.path.partition("/")
        if problem.kind == "extra" and folder in folders and name[:6].isdigit():
            (scenario / problem.path).unlink()
