"""Compares a dataset with its manifests and its index, and restores missing and changed files.

Restoring touches only recorded files and a killed run's remains. Changed files get a new name.
"""

import os
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NoReturn

from advercity.dataset.formats import format_frame_name
from advercity.dataset.index import EMPTY_INDEX, DatasetIndex
from advercity.dataset.manifest import Manifest
from advercity.dataset.opv2v import select_encoder
from advercity.dataset.partial_files import (
    FileRecord,
    is_being_written,
    list_matching_files,
    lock_scenario,
    read_journals,
    remove_unfinished_files,
    replace_file,
    report_disk_errors,
    set_aside,
)
from advercity.dataset.scenario_folders import (
    MANIFEST_FILE,
    check_folders_are_no_links,
    find_scenarios,
)
from advercity.dataset.writer import encode_scenario_files
from advercity.documents import MAX_JSON_BYTES, read_bytes
from advercity.errors import RunError, describe_cause, escape_control_characters
from advercity.roads.road_network import build_road
from advercity.sensors.sensor_frame import SensorFrame


@dataclass(frozen=True)
class FileProblem:
    """A file that differs from the manifest, or is not listed in it.

    Attributes:
        scenario: Folder of the scenario.
        path: Path within the scenario.
        kind: The problem. Unlisted files are `unfinished` if an interrupted run left them, and else
            `foreign`, which is no damage. A scenario that is `being written` has this one problem,
            with an empty path.
        frame: Frame to be written again; None for files of the whole scenario.
    """

    scenario: Path
    path: str
    kind: Literal["missing", "changed", "unfinished", "foreign", "being written"]
    frame: int | None = None

    @property
    def is_damage(self) -> bool:
        """Whether the dataset is not as its manifests say."""
        return self.kind != "foreign"

    def __str__(self) -> str:
        if self.kind == "being written":
            return f"{self.scenario}: a run is writing it; verify it when the run has ended"
        what = "not part of the dataset" if self.kind == "foreign" else self.kind
        return f"{escape_control_characters(str(self.scenario / self.path))}: {what}"


def verify_dataset(dataset: Path) -> list[FileProblem]:
    """Verify every scenario of a dataset, or one scenario, and the dataset's index if it has one.

    Raises:
        InputError: The folder holds no scenario.
        RunError: A file cannot be read.
    """
    # If every scenario is missing, only the index identifies a dataset.
    differing = [one for one in compare_with_index(dataset) if not is_being_written(one.scenario)]
    if differing and not any(path.exists() for path in dataset.glob(f"*/{MANIFEST_FILE}")):
        return differing
    return [
        *differing,
        *(item for scenario in find_scenarios(dataset) for item in _verify_if_at_rest(scenario)),
    ]


def _verify_if_at_rest(scenario: Path) -> list[FileProblem]:
    if is_being_written(scenario):
        return [FileProblem(scenario, "", "being written")]
    return verify_scenario(scenario)


def compare_with_index(dataset: Path) -> list[FileProblem]:
    """List missing scenarios of the index, and manifests with another checksum.

    A scenario which failed before its manifest was written counts if it has files.

    Raises:
        RunError: A file cannot be read.
    """
    index = DatasetIndex.load(dataset) or EMPTY_INDEX
    problems: list[FileProblem] = []
    for name in index.list_with_manifest(lambda name: any((dataset / name).glob("*"))):
        path = dataset / name / MANIFEST_FILE
        try:
            if not index.matches_manifest(name, read_bytes(path, max_bytes=MAX_JSON_BYTES)):
                problems.append(FileProblem(dataset / name, MANIFEST_FILE, "changed"))
        except FileNotFoundError:
            problems.append(FileProblem(dataset / name, MANIFEST_FILE, "missing"))
        except OSError as error:
            raise RunError(f"{path}: cannot be read: {describe_cause(error)}") from error
    return problems


def verify_scenario(scenario: Path) -> list[FileProblem]:
    """Compare every file of a scenario with its manifest, by size and checksum.

    Raises:
        InputError: The folder has no manifest.
        RunError: A file cannot be read.
    """
    manifest = Manifest.load(scenario)
    names = manifest.frame_file_names
    paths = {*list_files(scenario, names.folders)} - {MANIFEST_FILE}
    moving = read_journals(scenario, moved=False)
    return compare_with_records(
        scenario,
        manifest.files,
        paths,
        lambda path, record: matches_record(scenario / path, record),
        unfinished=list_matching_files(scenario, paths - manifest.files.keys(), moving),
    )


def compare_with_records(
    scenario: Path,
    recorded: Mapping[str, FileRecord],
    paths: Iterable[str],
    matches: Callable[[str, FileRecord], bool],
    *,
    unfinished: Collection[str],
) -> list[FileProblem]:
    """Compare the files of a scenario, or of another folder, with the records of its manifest.

    Args:
        scenario: The folder, for the problems.
        recorded: Records of the manifest, by path.
        paths: Paths of the existing files, within the folder.
        matches: Returns whether the file at a path is as recorded; called by several threads.
        unfinished: The paths left by an interrupted run.
    """
    found = set(paths)
    problems = [
        FileProblem(scenario, path, "unfinished" if path in unfinished else "foreign")
        for path in found - recorded.keys()
    ]
    missing = recorded.keys() - found
    problems += [FileProblem(scenario, path, "missing", recorded[path].frame) for path in missing]
    present = {path: record for path, record in recorded.items() if path in found}
    # Reading and SHA-256 both release the interpreter lock.
    with ThreadPoolExecutor() as pool:
        same = pool.map(matches, present, present.values())
        problems += [
            FileProblem(scenario, path, "changed", record.frame)
            for (path, record), is_same in zip(present.items(), same, strict=True)
            if not is_same
        ]
    return sorted(problems, key=lambda problem: problem.path)


def list_files(scenario: Path, folders: Iterable[str]) -> Iterator[str]:
    """List the files in a folder, also where one of `folders` in it is a link."""
    linked = [scenario / name for name in folders if (scenario / name).is_symlink()]
    for top in (scenario, *linked):
        for folder, _, names in os.walk(top, onerror=_raise_unreadable):
            for name in names:
                yield Path(folder, name).relative_to(scenario).as_posix()


def _raise_unreadable(error: OSError) -> NoReturn:
    raise RunError(f"{error.filename}: cannot be read: {describe_cause(error)}") from error


def matches_record(path: Path, record: FileRecord) -> bool:
    """Return whether a file is as recorded; RunError if it cannot be read."""
    try:
        return record.matches(path)
    except OSError as error:
        raise RunError(f"{path}: cannot be read: {describe_cause(error)}") from error


def restore_files(
    scenario: Path,
    problems: Iterable[FileProblem],
    capture_frame: Callable[[int], tuple[SensorFrame, ...]],
) -> list[FileProblem]:
    """Restore the files found by `verify_scenario`; return the remaining problems.

    These are foreign files, and recorded ones no run writes. Frames are captured again one by one;
    a missing or changed file is replaced once the new content has the checksum of the manifest. So
    an interruption leaves the scenario no worse than before, and the same call continues.

    Args:
        scenario: Folder of the scenario.
        problems: Problems of the scenario.
        capture_frame: Returns the sensor frames of all agents in a frame.

    Raises:
        RunError: A new content differs from its record, another run is writing, or the disk fails.
    """
    found = list(problems)
    with lock_scenario(scenario), report_disk_errors(scenario):
        manifest = Manifest.load(scenario)
        check_folders_are_no_links(scenario, manifest.frame_file_names.folders)
        unfinished = {one.path for one in found if one.kind == "unfinished"} - manifest.files.keys()
        # Again, since much may have happened between the search and the lock.
        moving = read_journals(scenario, moved=False)
        remove_unfinished_files(scenario, list_matching_files(scenario, unfinished, moving))
        damaged = {problem.path for problem in found if problem.kind in ("missing", "changed")}
        files = encode_scenario_files(manifest.spec, manifest.identity)
        damaged -= _restore(scenario, manifest, files, damaged)
        lanes = build_road(manifest.spec.road).lanes
        encode = select_encoder(manifest.identity.format, manifest.identity.clouds)
        for frame in sorted({item.frame for item in found if item.frame is not None}):
            name = format_frame_name(manifest.spec, frame)
            files = encode(capture_frame(frame), lanes, name=name)
            damaged -= _restore(scenario, manifest, files, damaged)
    return [item for item in found if item.kind == "foreign" or item.path in damaged]


def _restore(
    scenario: Path, manifest: Manifest, files: Mapping[str, bytes], damaged: set[str]
) -> set[str]:
    """Replace damaged files if the new content has the recorded checksum; return their paths."""
    restored = damaged & files.keys()
    for path in restored:
        content, expected = files[path], manifest.files[path]
        if FileRecord.from_content(content, frame=expected.frame) != expected:
            raise RunError(
                f"{scenario / path}: its new content differs from the manifest's, although spec,"
                " traffic, versions and device are the same (another kind of processor may be why);"
                " the file is left as it is: `advercity run --fresh`"
                " makes the scenario again"
            )
        set_aside(scenario, [path])
        replace_file(scenario, path, content)
    return restored
