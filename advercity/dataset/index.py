"""The index of a dataset, with the state of every scenario, and splits of a dataset by road.

The index is a file next to the folders of the scenarios; loaders look for folders only. A split is
a folder of links to scenarios, which loaders take as their root.
"""

import hashlib
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Literal

from advercity_dsl import Id, Model, Spec
from pydantic import ValidationError

from advercity.atomic_files import move_file, write_file
from advercity.dataset.manifest import Manifest, compute_spec_digest
from advercity.dataset.partial_files import (
    find_partial_file,
    lock_file,
    remove_staging_folder,
    report_disk_errors,
)
from advercity.dataset.scenario_folders import (
    MANIFEST_FILE,
    check_folders_are_no_links,
    find_staging_folder,
)
from advercity.documents import MAX_JSON_BYTES, parse_json, read_bytes
from advercity.errors import InputError, RunError, describe_cause

INDEX_FILE = "index.json"


class IndexEntry(Model):
    """A scenario of a dataset at the end of its latest run.

    Attributes:
        spec_sha256: Checksum of the spec.
        state: `waiting` has no result yet, `partial` lacks frames, `failed` does so after an error;
            a refused run leaves a scenario `whole` or `partial`.
        frames: Number of written frames.
        length: Number of frames of the whole scenario.
        files: Number of files.
        size_bytes: Size of the files.
        manifest_sha256: Checksum of the manifest; None without one.
    """

    spec_sha256: str
    state: Literal["waiting", "failed", "partial", "whole"] = "waiting"
    frames: int = 0
    length: int | None = None
    files: int = 0
    size_bytes: int = 0
    manifest_sha256: str | None = None

    @staticmethod
    def from_manifest_text(
        spec: Spec, text: bytes | None, *, failed: bool = False, refused: bool = False
    ) -> "IndexEntry":
        """Build the entry of a scenario with the manifest `text`, or of one without a manifest.

        A failed run was `refused` if it ended before it began to make frames.
        """
        if text is None:
            state = "failed" if failed else "waiting"
            return IndexEntry(spec_sha256=compute_spec_digest(spec), state=state)
        manifest = Manifest.parse(text, where=f"{spec.id}/{MANIFEST_FILE}")
        return IndexEntry(
            spec_sha256=manifest.identity.spec_sha256,
            state="whole"
            if manifest.complete
            else "failed"
            if failed and not refused
            else "partial",
            frames=len(manifest.frames),
            length=manifest.length,
            files=len(manifest.files),
            size_bytes=manifest.size_bytes,
            manifest_sha256=hashlib.sha256(text).hexdigest(),
        )


class DatasetIndex(Model):
    """Entries of the scenarios of a dataset by folder; the same dataset gives the same text."""

    index_version: Literal[1]
    scenarios: dict[Id, IndexEntry]

    def list_with_manifest(self, has_files: Callable[[str], bool]) -> list[str]:
        """List the names of the scenarios with an expected manifest.

        They had one when their last run ended, or failed before it was written and have files.
        """
        return sorted(
            name
            for name, entry in self.scenarios.items()
            if entry.manifest_sha256 or (entry.state == "failed" and has_files(name))
        )

    def matches_manifest(self, name: str, manifest: bytes) -> bool:
        """Return whether a scenario's manifest has the recorded checksum, or none is recorded."""
        entry = self.scenarios.get(name)
        known = None if entry is None else entry.manifest_sha256
        return known in (None, hashlib.sha256(manifest).hexdigest())

    def with_entries(self, entries: Mapping[str, IndexEntry]) -> "DatasetIndex":
        """Return a copy with these entries added or replaced, sorted by name."""
        merged = {**self.scenarios, **entries}
        return DatasetIndex(
            index_version=1, scenarios={name: merged[name] for name in sorted(merged)}
        )

    def with_waiting(self, specs: Iterable[Spec]) -> "DatasetIndex":
        """Return a copy with the missing ones of these scenarios added as waiting."""
        return self.with_entries(
            {
                spec.id: IndexEntry.from_manifest_text(spec, None)
                for spec in specs
                if spec.id not in self.scenarios
            }
        )

    def format_summary(self) -> str:
        """Format the number of scenarios in each state: `3 scenarios: 2 whole, 1 failed`."""
        states = [entry.state for entry in self.scenarios.values()]
        counts = {state: states.count(state) for state in ("whole", "partial", "failed", "waiting")}
        parts = [f"{count} {state}" for state, count in counts.items() if count]
        return f"{len(states)} scenario{'' if len(states) == 1 else 's'}: {', '.join(parts)}"

    def to_json(self) -> bytes:
        """Format it as JSON: sorted, without times and machine paths, with a newline."""
        return self.model_dump_json(indent=1).encode() + b"\n"

    @staticmethod
    def parse(text: bytes, *, where: str) -> "DatasetIndex":
        """Parse the text of `to_json`.

        Raises:
            InputError: It is no JSON; the text names line and column.
            RunError: It is no index of this version.
        """
        hint = "rename or delete it, and the next run starts another"
        document = parse_json(text, Path(where), hint=hint)
        try:
            return DatasetIndex.model_validate(document)
        except ValidationError as error:
            raise RunError(f"{where}: not an index of this version; {hint}") from error

    @staticmethod
    def load(dataset: Path) -> "DatasetIndex | None":
        """Load the index of a dataset; None if it has none, RunError if it cannot be read."""
        path = dataset / INDEX_FILE
        try:
            raw = read_bytes(path, max_bytes=MAX_JSON_BYTES)
            return DatasetIndex.parse(raw, where=str(path))
        except (FileNotFoundError, NotADirectoryError):
            return None
        except OSError as error:
            raise RunError(f"{path}: cannot be read: {describe_cause(error)}") from error


EMPTY_INDEX = DatasetIndex(index_version=1, scenarios={})


class IndexWriter:
    """Keeps the index of a dataset up to date; several processes may do so at a time.

    The first scenario creates the folder of a dataset; until then no file is written.

    Args:
        dataset: Folder of the dataset.
        specs: The specs of a run.

    Raises:
        InputError: The path is a file.
    """

    def __init__(self, dataset: Path, specs: Iterable[Spec]) -> None:
        if dataset.exists() and not dataset.is_dir():
            raise InputError(f"`output` {dataset}: is a file; name a folder")
        self._dataset = dataset
        self._specs = {spec.id: spec for spec in specs}
        if (dataset / INDEX_FILE).exists():
            self._update({})

    def record_start(self, name: str, *, missing_frames: int) -> None:
        """Record the start of making frames; the scenario has no result until the run ends.

        A complete scenario with its recorded manifest keeps its entry: nothing changes.
        Without an index there is no entry to correct.

        Raises:
            RunError: The disk is full or not writable.
        """
        index = DatasetIndex.load(self._dataset)
        if index is None:
            return
        manifest = self._read_manifest(name)
        if missing_frames or manifest is None or not index.matches_manifest(name, manifest):
            self._update({name: IndexEntry.from_manifest_text(self._specs[name], None)})

    def record_result(self, name: str, *, failed: bool, refused: bool = False) -> None:
        """Record the end of a scenario; RunError if the disk is full or not writable.

        A failed run was `refused` if it ended before it began to make frames.
        """
        if self._dataset.is_dir():
            text, spec = self._read_manifest(name), self._specs[name]
            entry = IndexEntry.from_manifest_text(spec, text, failed=failed, refused=refused)
            self._update({name: entry})

    def _read_manifest(self, name: str) -> bytes | None:
        """Read the manifest of a scenario; None if it has none, or a user has deleted it."""
        path = self._dataset / name / MANIFEST_FILE
        with report_disk_errors(path), suppress(FileNotFoundError):
            return read_bytes(path, max_bytes=MAX_JSON_BYTES)
        return None

    def _update(self, entries: Mapping[str, IndexEntry]) -> None:
        path = self._dataset / INDEX_FILE
        check_folders_are_no_links(path, ())
        staging = find_staging_folder(path)
        with report_disk_errors(self._dataset), lock_file(staging / "lock", "the index"):
            try:
                index = DatasetIndex.load(self._dataset) or EMPTY_INDEX
                index = index.with_waiting(self._specs.values()).with_entries(entries)
                partial = find_partial_file(path, INDEX_FILE)
                write_file(partial, index.to_json())
                move_file(partial, path)
            finally:
                remove_staging_folder(path)
