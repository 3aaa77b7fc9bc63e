"""Files of a scenario that belong to no frame: its protocol, and whose models it shows.

Adds frames to a scenario that is open, so that a frame is whole or absent whatever happens.

A frame's files are written into staging and renamed into place when all of them are there; then
one write to the journal says so.

Opens a scenario for writing, and leaves it with a manifest that tells what is there.

Frames come from `FrameWriter`s, here and in other processes. Whoever opens the scenario next adds
the journals of those that were cut short to the manifest, and removes what none of them knows.
"""

import shutil
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Self

from advercity_dsl import Spec

from advercity.dataset.formats import format_frame_name
from advercity.dataset.frame_documents import format_yaml
from advercity.dataset.manifest import Identity, Manifest
from advercity.dataset.opv2v import FRAME_ENCODERS
from advercity.dataset.partial_files import (
    FileRecord,
    append_to_journal,
    lock_file,
    move_file,
    read_journals,
    remove_journals,
    report_disk_errors,
    write_file,
)
from advercity.dataset.scenario_folders import MANIFEST_FILE, find_staging_folder
from advercity.errors import RunError
from advercity.roads.road_network import build_road
from advercity.sensors.sensor_frame import SensorFrame

PROTOCOL_FILE = "data_protocol.yaml"


def encode_protocol(spec: Spec) -> bytes:
    """`data_protocol.yaml`: the whole spec."""
    return format_yaml(spec.model_dump(mode="json"))


ATTRIBUTION_FILE = "ATTRIBUTION.md"
LICENCE_URLS = {
    "CC0-1.0": "https://creativecommons.org/publicdomain/zero/1.0/",
    "CC-BY-3.0": "https://creativecommons.org/licenses/by/3.0/",
    "CC-BY-3.0-US": "https://creativecommons.org/licenses/by/3.0/us/",
    "CC-BY-4.0": "https://creativecommons.org/licenses/by/4.0/",
    "CC-BY-SA-4.0": "https://creativecommons.org/licenses/by-sa/4.0/",
    "MIT": "https://opensource.org/license/mit",
}
ATTRIBUTION_HEADER = """# Attribution

Pictures and point clouds of this scenario show 3-D models of others. They were scaled to the size
of their blueprints, thinned, and given materials of this project; what their authors made is used
under these licences:

| blueprint | model | author | licence |
|---|---|---|---|
"""


def encode_scenario_files(spec: Spec, identity: Identity) -> dict[str, bytes]:
    """Content of every such file by its path; models are attributed where any were used."""
    files = {PROTOCOL_FILE: encode_protocol(spec)}
    if identity.bodies:
        files[ATTRIBUTION_FILE] = format_attribution(spec, identity).encode()
    return files


def format_attribution(spec: Spec, identity: Identity) -> str:
    """Who made the models that the scenario shows, and on what terms they are used."""
    rows = [
        f"| {name} | {model.pack or model.file} | {model.author} |"
        f" [{model.licence}]({LICENCE_URLS[model.licence]}) |\n"
        for name in sorted(identity.bodies)
        if (model := spec.blueprints[name].model) is not None
    ]
    return ATTRIBUTION_HEADER + "".join(rows)


class FrameWriter:
    """One of the processes that write frames of a scenario, which a `DatasetWriter` has open.

    Args:
        scenario: Its folder.
        spec: What is written.
        format: In which layout.
        process: Number of the process among those that write frames of the scenario.
    """

    def __init__(self, scenario: Path, spec: Spec, format: str, process: int = 0) -> None:
        self._scenario, self._spec, self._process = scenario, spec, process
        self._encode = FRAME_ENCODERS[format]
        self._lanes = build_road(spec.road).lanes
        self._staging = find_staging_folder(scenario)
        self._size_bytes = 0

    @property
    def size_bytes(self) -> int:
        """Of the files that were written here; may be asked for while another thread writes."""
        return self._size_bytes

    def claim_frame(self, frame: int) -> bool:
        """Whether this process shall make a frame: the first that asks, and no other."""
        with report_disk_errors(self._scenario):
            try:
                (self._staging / "claims" / str(frame)).mkdir(parents=True)
            except FileExistsError:
                return False
        return True

    def write_frame(self, frame: int, readings: Sequence[SensorFrame]) -> None:
        """Add a frame: the readings of all viewpoints.

        Raises:
            RunError: The disk does not take it; the frame is absent then.
        """
        incoming = self._staging / "incoming" / str(self._process)
        files = self._encode(readings, self._lanes, name=format_frame_name(self._spec, frame))
        with report_disk_errors(self._scenario):
            for path, content in files.items():
                write_file(incoming / path, content)
            for path in files:
                move_file(incoming / path, self._scenario / path)
            records = {
                path: FileRecord.from_content(content, frame=frame)
                for path, content in files.items()
            }
            append_to_journal(self._scenario, self._process, records)
        self._size_bytes += sum(record.size for record in records.values())


class ScenarioWriter:
    """The one who has a scenario open; a context manager.

    Opening it finds what is already done; closing it, also after an error, writes the manifest.
    Every failure of the disk is a RunError that names the path.

    Args:
        root: Folder of the dataset; the scenario goes into `root/<spec id>`.
        spec: What is written.
        identity: What decides the bytes; data of another identity are not continued.
        length: Frames of the whole scenario.
        fresh: Start over, whatever is there.

    Raises:
        RunError: Another run is writing, the data there are of another identity, or the folder
            holds something that is not a dataset.
    """

    def __init__(
        self,
        root: Path,
        spec: Spec,
        identity: Identity,
        *,
        length: int,
        fresh: bool = False,
    ) -> None:
        self.scenario = root / spec.id
        self._staging = find_staging_folder(self.scenario)
        self._incoming = self._staging / "incoming"
        self._spec = spec
        self._identity = identity
        self._length = length
        self._fresh = fresh
        self._frames = FrameWriter(self.scenario, spec, identity.format)
        self._files: dict[str, FileRecord] = {}
        self._done_frames: set[int] = set()
        self._size_bytes = 0

    @property
    def done_frames(self) -> frozenset[int]:
        """Frames that need not be written."""
        return frozenset(self._done_frames)

    @property
    def size_bytes(self) -> int:
        """Of all files that were there or are written here; also while another thread writes."""
        return self._size_bytes + self._frames.size_bytes

    @property
    def lock_descriptor(self) -> int:
        """File descriptor; whichever process has it open keeps others from the scenario."""
        return self._lock.fileno()

    def __enter__(self) -> Self:
        with report_disk_errors(self.scenario):
            self._lock = lock_file(self._staging / "lock")
            try:
                self._open()
            except BaseException:
                self._lock.close()
                raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        try:
            if error is not None:
                with suppress(RunError):
                    self.finish()
        finally:
            self._lock.close()

    def claim_frame(self, frame: int) -> bool:
        """Whether this process shall make a frame: the first that asks, and no other."""
        return self._frames.claim_frame(frame)

    def write_frame(self, frame: int, readings: Sequence[SensorFrame]) -> None:
        """Add a frame: the readings of all viewpoints.

        Raises:
            RunError: The disk does not take it; the frame is absent then.
        """
        self._frames.write_frame(frame, readings)
        self._done_frames.add(frame)

    def finish(self) -> Manifest:
        """Bring the manifest up to date and clear up; after an error it happens by itself."""
        with report_disk_errors(self.scenario):
            self._files |= read_journals(self.scenario)
            self._remove_unfinished()
            manifest = self._save()
            shutil.rmtree(self._staging)
            with suppress(OSError):  # another scenario is being written
                self._staging.parent.rmdir()
        return manifest

    def _open(self) -> None:
        if self._fresh:
            self._clear()
        self._files = self._load_finished_records()
        self._remove_unfinished()
        beside = encode_scenario_files(self._spec, self._identity)
        self._files |= {path: FileRecord.from_content(content) for path, content in beside.items()}
        self._size_bytes = sum(record.size for record in self._files.values())
        self._save()
        for path, content in beside.items():
            self._replace(path, content)

    def _clear(self) -> None:
        self._check_ownership()
        remove_journals(self.scenario)
        if self.scenario.exists():
            for path in self.scenario.iterdir():
                if path.is_dir():
                    shutil.rmtree(path)
                elif path.name != MANIFEST_FILE:
                    path.unlink()
            (self.scenario / MANIFEST_FILE).unlink(missing_ok=True)

    def _check_ownership(self) -> None:
        """So that no mistyped output folder is emptied or mixed into a dataset."""
        foreign = self.scenario.exists() and any(self.scenario.iterdir())
        if foreign and not (self.scenario / MANIFEST_FILE).exists():
            raise RunError(
                f"{self.scenario}: holds files but no {MANIFEST_FILE}, so not a dataset;"
                " delete it, or choose another --output"
            )

    def _load_finished_records(self) -> dict[str, FileRecord]:
        """Records of the frames that are done and wholly there."""
        self._check_ownership()
        if not (self.scenario / MANIFEST_FILE).exists():
            return {}
        manifest = Manifest.load(self.scenario)
        differences = manifest.identity.find_differences(self._identity)
        if differences:
            raise RunError(
                f"{self.scenario}: made from something else ({'; '.join(differences)});"
                " --fresh starts over, another --output leaves it alone"
            )
        damaged = {
            record.frame
            for path, record in manifest.files.items()
            if not self._has_recorded_size(path, record)
        }
        again = damaged | {None}
        return {
            path: record for path, record in manifest.files.items() if record.frame not in again
        }

    def _has_recorded_size(self, path: str, record: FileRecord) -> bool:
        try:
            return (self.scenario / path).stat().st_size == record.size
        except FileNotFoundError:
            return False

    def _remove_unfinished(self) -> None:
        """Remove what is left of frames that are not done, and of making them."""
        self._done_frames = {file.frame for file in self._files.values() if file.frame is not None}
        absent = {
            format_frame_name(self._spec, k) for k in set(range(self._length)) - self._done_frames
        }
        for path in self.scenario.glob("*/[0-9]*"):
            if path.name[:6] in absent and path.is_file():
                path.unlink()
        for folder in (self._incoming, self._staging / "claims"):
            if folder.exists():
                shutil.rmtree(folder)

    def _save(self) -> Manifest:
        manifest = Manifest.from_files(
            self._identity, self._spec, length=self._length, files=self._files
        )
        self._replace(MANIFEST_FILE, manifest.to_json().encode())
        remove_journals(self.scenario)
        return manifest

    def _replace(self, path: str, content: bytes) -> None:
        write_file(self._incoming / path, content)
        move_file(self._incoming / path, self.scenario / path)
