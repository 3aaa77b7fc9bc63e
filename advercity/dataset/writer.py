"""Writes a scenario; frames are complete or absent, whatever interrupts the run.

`ScenarioWriter` opens a scenario for one run: it merges the journals of interrupted runs into the
manifest, removes unrecorded files, and leaves a manifest of all present files. Frames come from
it and from a `FrameWriter` in each further process.
"""

import logging
import os
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Self

from advercity_dsl import Spec

from advercity.atomic_files import move_file, sync_files, write_file
from advercity.dataset.adver_city_names import build_protocol
from advercity.dataset.attribution import format_attribution
from advercity.dataset.formats import ADVER_CITY, FrameFileNames, format_frame_name
from advercity.dataset.manifest import Identity, Manifest
from advercity.dataset.opv2v import select_encoder
from advercity.dataset.partial_files import (
    FileRecord,
    append_to_journal,
    find_partial_file,
    format_file_count,
    list_matching_files,
    lock_file,
    read_journals,
    remove_idle_staging_folder,
    remove_journals,
    remove_partial_files,
    remove_staging_folder,
    remove_unfinished_files,
    replace_file,
    report_disk_errors,
    set_aside,
    share_lock,
)
from advercity.dataset.plain_documents import format_yaml
from advercity.dataset.scenario_folders import (
    MANIFEST_FILE,
    PROTOCOL_FILE,
    check_folders_are_no_links,
    find_staging_folder,
    no_dataset_to_replace_error,
)
from advercity.documents import MAX_JSON_BYTES, read_bytes
from advercity.errors import RunError, describe_cause
from advercity.roads.road_network import build_road
from advercity.sensors.sensor_frame import SensorFrame

_logger = logging.getLogger(__name__)

ATTRIBUTION_FILE = "ATTRIBUTION.md"
SCENARIO_FILES = {PROTOCOL_FILE, ATTRIBUTION_FILE}
"""Files of the whole scenario, not of a frame."""


def encode_scenario_files(spec: Spec, identity: Identity) -> dict[str, bytes]:
    """Encode the files of the whole scenario, by path.

    These are the spec as YAML, in the original's layout with keys for its tools, and the
    attribution of models and photographs, if there are any.
    """
    as_original = identity.format == ADVER_CITY.name
    document = build_protocol(spec) if as_original else spec.model_dump(mode="json")
    files = {PROTOCOL_FILE: format_yaml(document)}
    attribution = format_attribution(spec, identity)
    if attribution:
        files[ATTRIBUTION_FILE] = attribution.encode()
    return files


class FrameWriter:
    """Adds frames to a scenario opened by a `ScenarioWriter`, here or in another process.

    Args:
        scenario: Folder of the scenario.
        spec: The spec.
        identity: The inputs of the bytes.
        length: Number of frames of the whole scenario.
        process: Number of this process among the writers of the scenario's frames.
    """

    def __init__(
        self, scenario: Path, spec: Spec, identity: Identity, *, length: int, process: int = 0
    ) -> None:
        self.scenario = scenario
        self._names = FrameFileNames(spec, identity.format, length)
        self._spec, self._process = spec, process
        self._encode = select_encoder(identity.format, identity.clouds)
        self._lanes = build_road(spec.road).lanes
        self._staging = find_staging_folder(scenario)
        self._size_bytes = 0

    @property
    def size_bytes(self) -> int:
        """Size of the files written so far; safe to read while another thread writes."""
        return self._size_bytes

    def claim_frame(self, frame: int) -> bool:
        """Claim a frame for this process; False if another process was first."""
        with report_disk_errors(self.scenario):
            try:
                # Creating a folder is atomic on every file system, network drives included.
                (self._staging / "claims" / str(frame)).mkdir(parents=True)
            except FileExistsError:
                return False
        return True

    def write_frame(self, frame: int, sensor_frames: Sequence[SensorFrame]) -> None:
        """Write the files of a frame, given the sensor frames of all agents.

        Raises:
            RunError: The disk is full or not writable; the frame is absent then.
        """
        files = self._encode(sensor_frames, self._lanes, name=format_frame_name(self._spec, frame))
        with report_disk_errors(self.scenario):
            check_folders_are_no_links(self.scenario, self._names.folders)
            # All files are on the disk before the first is moved: a full disk leaves no part.
            partials = {
                path: find_partial_file(self.scenario, f"{self._process}/{path}") for path in files
            }
            for path, content in files.items():
                write_file(partials[path], content)
            records = {
                path: FileRecord.from_content(content, frame=frame)
                for path, content in files.items()
            }
            # Whatever interrupts the moves, the next run knows this one's files.
            journal = append_to_journal(self.scenario, self._process, records, moved=False)
            sync_files([*partials.values(), journal, journal.parent])
            set_aside(self.scenario, files)
            for path, partial in partials.items():
                move_file(partial, self.scenario / path)
            # Only now: after a power cut, every file in a journal has its content and its name.
            sync_files({(self.scenario / path).parent for path in files})
            append_to_journal(self.scenario, self._process, records, moved=True)
        self._size_bytes += sum(record.size for record in records.values())


class ScenarioWriter(FrameWriter):
    """Opens a scenario for one run, writes frames, and keeps the manifest; a context manager.

    Entering it finds the complete frames. Leaving it, also after an error, writes the manifest.
    Every failure of the disk is a RunError with the path.

    Args:
        root: Folder of the dataset; the scenario's is `root/<spec id>`.
        spec: The spec.
        identity: The inputs of the bytes; a scenario of another identity is not continued.
        length: Number of frames of the whole scenario.
        fresh: Delete files of earlier runs and start over.

    Raises:
        RunError: Another run is writing, the scenario is of another identity, a folder is a link,
            or the folder holds other files than a dataset.
    """

    def __init__(
        self, root: Path, spec: Spec, identity: Identity, *, length: int, fresh: bool = False
    ) -> None:
        super().__init__(root / spec.id, spec, identity, length=length)
        self._identity = identity
        self._length = length
        self._fresh = fresh
        self._files: dict[str, FileRecord] = {}
        self._known_manifest: bytes | None = None

    @property
    def done_frames(self) -> frozenset[int]:
        """Frames already complete when the scenario was opened."""
        return frozenset(file.frame for file in self._files.values() if file.frame is not None)

    def __enter__(self) -> Self:
        with report_disk_errors(self.scenario):
            check_folders_are_no_links(self.scenario, self._names.folders)
            self._lock = lock_file(self._staging / "lock")
            with ExitStack() as on_error:
                on_error.callback(self._lock.close)
                self._open_or_leave()
                # Workers hold the lock, too, and keep other runs out should this process die first.
                share_lock(self._lock)
                on_error.pop_all()
        return self

    def __exit__(self, kind: object, error: BaseException | None, traceback: object) -> None:
        try:
            if error is not None:
                with suppress(RunError):  # the first error is the one to report
                    self.finish()
        finally:
            self._lock.close()

    def finish(self) -> Manifest:
        """Update the manifest and delete the staging folder; an error does the same.

        The manifest lists the frames whose files are all there: they may be deleted during a run.
        """
        with report_disk_errors(self.scenario):
            self._files |= read_journals(self.scenario)
            there = self._names.list_files(self.scenario)
            torn = {file.frame for path, file in self._files.items() if path not in there} - {None}
            self._files = {
                path: file for path, file in self._files.items() if file.frame not in torn
            }
            for path, content in encode_scenario_files(self._spec, self._identity).items():
                if not os.path.lexists(self.scenario / path):
                    replace_file(self.scenario, path, content)
            self._remove_unfinished({})
            manifest = self._save()
            remove_staging_folder(self.scenario)
        return manifest

    def _open_or_leave(self) -> None:
        try:
            self._open()
        except BaseException:
            with suppress(OSError):  # the first error is the one to report
                remove_idle_staging_folder(self.scenario)
            raise

    def _open(self) -> None:
        # A mistyped output folder must not be emptied or mixed into a dataset.
        has_manifest = (self.scenario / MANIFEST_FILE).exists()
        if not has_manifest and self.scenario.exists() and any(self.scenario.iterdir()):
            raise no_dataset_to_replace_error(self.scenario)
        former: dict[str, FileRecord] = {}
        if has_manifest:
            manifest = Manifest.load(self.scenario, moved=False)
            self._known_manifest = self._format_as_written()
            former = manifest.files
            if self._fresh:
                self._clear(manifest)
            else:
                self._files = self._find_finished_records(manifest)
        self._remove_unfinished(former)
        own = encode_scenario_files(self._spec, self._identity)
        self._files |= {path: FileRecord.from_content(content) for path, content in own.items()}
        self._size_bytes = sum(record.size for record in self._files.values())
        # The manifest first: a folder with files but without one counts as a user's.
        self._save()
        known = {
            path
            for records in (former, self._files)
            for path in list_matching_files(self.scenario, own, records)
            if not (self.scenario / path).is_symlink()
        }
        set_aside(self.scenario, own.keys() - known)
        for path, content in own.items():
            replace_file(self.scenario, path, content)

    def _clear(self, found: Manifest) -> None:
        names = found.frame_file_names
        check_folders_are_no_links(self.scenario, names.folders)
        own = list_matching_files(
            self.scenario,
            {*names.list_files(self.scenario), *(SCENARIO_FILES & found.files.keys())},
            found.files,
        )
        # Until there is a new one, an interrupted run finds a dataset here, without the frames.
        unnumbered = {path: file for path, file in found.files.items() if file.frame is None}
        self._replace_manifest(
            Manifest.from_files(found.identity, found.spec, length=found.length, files=unnumbered)
        )
        numbered = {path: file for path, file in found.files.items() if file.frame is not None}
        append_to_journal(self.scenario, 0, numbered, moved=False)
        for path in own:
            self._remove_former(path)
        for folder in names.folders:
            with suppress(OSError):  # not there, or files of others are in it
                (self.scenario / folder).rmdir()
        kept = sum(1 for path in self.scenario.rglob("*") if not path.is_dir()) - 1
        if kept:
            _logger.warning("%s: %s of no run kept", self.scenario, format_file_count(kept))

    def _remove_former(self, path: str) -> None:
        try:
            (self.scenario / path).unlink(missing_ok=True)
        except OSError as error:
            raise RunError(
                f"{self.scenario / path}: cannot be deleted: {describe_cause(error)}; `fresh` has"
                " deleted a part of the frames: mend this, and run again"
            ) from error

    def _find_finished_records(self, manifest: Manifest) -> dict[str, FileRecord]:
        """Find the records of the frames whose files are all as recorded.

        Files of an interrupted run are checked by content: a power cut may have cost it on disks
        which report writes too early. Other files are checked by size.
        """
        manifest.identity.check_same(
            self._identity,
            self.scenario,
            remedy="`fresh` starts over, another `output` leaves it alone",
        )
        journaled = read_journals(self.scenario, moved=False)
        frames = {path: file for path, file in manifest.files.items() if file.frame is not None}
        changed = [
            path
            for path, record in frames.items()
            if not self._is_as_recorded(path, record, by_content=path in journaled)
        ]
        set_aside(self.scenario, changed)
        again = {frames[path].frame for path in changed}
        return {path: file for path, file in frames.items() if file.frame not in again}

    def _is_as_recorded(self, path: str, record: FileRecord, *, by_content: bool) -> bool:
        check = record.matches if by_content else record.has_size_of
        try:
            return check(self.scenario / path)
        except FileNotFoundError:
            return False

    def _remove_unfinished(self, former: Mapping[str, FileRecord]) -> None:
        """Delete the files of incomplete frames, unfinished files and claims.

        Files in place are deleted only if their content is recorded by a run.
        """
        check_folders_are_no_links(self.scenario, self._names.folders)
        done = self.done_frames
        found = self._names.list_files(self.scenario)
        incomplete = [path for path, frame in found.items() if frame not in done]
        records = {**former, **read_journals(self.scenario, moved=False)}
        remove_unfinished_files(
            self.scenario, list_matching_files(self.scenario, incomplete, records)
        )
        remove_partial_files(self.scenario)

    def _save(self) -> Manifest:
        manifest = Manifest.from_files(
            self._identity, self._spec, length=self._length, files=self._files
        )
        self._replace_manifest(manifest)
        return manifest

    def _format_as_written(self) -> bytes:
        """Format the manifest in place as a run would, whatever its user made of it."""
        path = self.scenario / MANIFEST_FILE
        found = Manifest.parse(read_bytes(path, max_bytes=MAX_JSON_BYTES), where=str(path))
        if not found.identity.list_differences(self._identity):
            found = Manifest.from_files(
                self._identity, self._spec, length=self._length, files=found.files
            )
        return found.to_json().encode()

    def _replace_manifest(self, manifest: Manifest) -> None:
        path, content = self.scenario / MANIFEST_FILE, manifest.to_json().encode()
        known = (content, self._known_manifest)
        if os.path.lexists(path) and (
            path.is_symlink() or read_bytes(path, max_bytes=MAX_JSON_BYTES) not in known
        ):
            set_aside(self.scenario, [MANIFEST_FILE])
        replace_file(self.scenario, MANIFEST_FILE, content)
        self._known_manifest = content
        # Only now: the journals are the record until the manifest has their frames.
        remove_journals(self.scenario)
