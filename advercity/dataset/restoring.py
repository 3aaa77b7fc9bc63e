"""Puts back files of a scenario as its manifest has them, and touches no others."""

import shutil
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path

from advercity.dataset.beside_frames import beside_frames
from advercity.dataset.formats import format_called, frame_name
from advercity.dataset.journal import FileRecord, journals, staging_of
from advercity.dataset.manifest import Manifest
from advercity.dataset.reading import Reading
from advercity.dataset.staging import failures_named, lock, move, write
from advercity.dataset.verification import Problem
from advercity.errors import RunError
from advercity.world.roads import built

ReadingsOf = Callable[[int], tuple[Reading, ...]]


def restore(scenario: Path, problems: Iterable[Problem], readings_of: ReadingsOf) -> list[Problem]:
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
    staging = staging_of(scenario)
    with failures_named(scenario), lock(staging / "lock"):
        _remove_leftovers(scenario, manifest, found)
        damaged = {problem.path for problem in found if problem.kind != "extra"}
        beside = beside_frames(manifest.spec, manifest.identity)
        _put_back(scenario, manifest, {path: beside[path] for path in damaged & beside.keys()})
        for frame in sorted({item.frame for item in found if item.frame is not None}):
            files = _files(manifest, frame, readings_of(frame))
            _put_back(scenario, manifest, {path: files[path] for path in damaged & files.keys()})
        shutil.rmtree(staging / "incoming", ignore_errors=True)
        if not journals(scenario):
            shutil.rmtree(staging)
            with suppress(OSError):  # another scenario is being written
                staging.parent.rmdir()
    return [item for item in found if item.kind == "extra" and (scenario / item.path).exists()]


def _files(manifest: Manifest, frame: int, readings: tuple[Reading, ...]) -> dict[str, bytes]:
    encode = format_called(manifest.identity.format).encode
    lanes = built(manifest.spec.road).lanes
    return encode(readings, lanes, name=frame_name(manifest.spec, frame))


def _put_back(scenario: Path, manifest: Manifest, files: dict[str, bytes]) -> None:
    incoming = staging_of(scenario) / "incoming"
    for path, content in files.items():
        expected = manifest.files[path]
        if FileRecord.of(content, frame=expected.frame) != expected:
            raise RunError(
                f"{scenario / path}: comes out other than the manifest has it, although spec,"
                " traffic, versions and device are the same; it is left as it is:"
                " `advercity run --fresh` makes the scenario anew"
            )
        write(incoming / path, content)
        move(incoming / path, scenario / path)


def _remove_leftovers(scenario: Path, manifest: Manifest, problems: Iterable[Problem]) -> None:
    """What a killed run left of a frame; anything else that is extra may be precious."""
    folders = {
        format_called(manifest.identity.format).folder_name(agent) for agent in manifest.spec.agents
    }
    for problem in problems:
        folder, _, name = problem.path.partition("/")
        if problem.kind == "extra" and folder in folders and name[:6].isdigit():
            (scenario / problem.path).unlink()
