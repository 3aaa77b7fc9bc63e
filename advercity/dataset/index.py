"""The index of a set: every scenario that was asked for, what it is made from, how far it is.

It lies beside the scenarios' folders, where loaders, which look for folders, pass it by.

Splits of a dataset by road, as folders of links that loaders take as their roots.
"""

import hashlib
import json
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Literal

from advercity_dsl import Model, Spec
from pydantic import Field, ValidationError

from advercity.dataset.manifest import Manifest, compute_spec_digest
from advercity.dataset.partial_files import lock_file, move_file, report_disk_errors, write_file
from advercity.dataset.scenario_folders import MANIFEST_FILE, find_scenarios
from advercity.errors import InputError, RunError

INDEX_FILE = "index.json"


class IndexEntry(Model):
    """A scenario of a set, as it was when a run came to its end."""

    spec_sha256: str
    state: Literal["waiting", "failed", "partial", "whole"] = "waiting"
    """Waiting for a run that was cut short to be started again; partial if frames are left."""
    frames: int = 0
    """That are done."""
    length: int | None = None
    """Frames of the whole scenario."""
    files: int = 0
    size_bytes: int = 0
    manifest_sha256: str | None = None

    @staticmethod
    def from_manifest_text(spec: Spec, text: bytes | None, *, failed: bool = False) -> "IndexEntry":
        """Of a scenario with the manifest `text`, or of one that has none."""
        if text is None:
            state = "failed" if failed else "waiting"
            return IndexEntry(spec_sha256=compute_spec_digest(spec), state=state)
        manifest = Manifest.parse(text, where=f"{spec.id}/{MANIFEST_FILE}")
        return IndexEntry(
            spec_sha256=manifest.identity.spec_sha256,
            state="failed" if failed else "whole" if manifest.complete else "partial",
            frames=len(manifest.frames),
            length=manifest.length,
            files=len(manifest.files),
            size_bytes=sum(record.size for record in manifest.files.values()),
            manifest_sha256=hashlib.sha256(text).hexdigest(),
        )


class DatasetIndex(Model):
    """What a set consists of; the same set gives the same text."""

    index_version: Literal[1] = 1
    scenarios: dict[str, IndexEntry] = Field(default_factory=dict[str, IndexEntry])
    """By folder."""

    @property
    def present_scenarios(self) -> set[str]:
        """Scenarios that are there, wholly or in part."""
        return {name for name, entry in self.scenarios.items() if entry.manifest_sha256}

    def matches_manifest(self, name: str, manifest: bytes) -> bool:
        """Whether the manifest of a scenario is the one that is known, if one is."""
        entry = self.scenarios.get(name)
        known = None if entry is None else entry.manifest_sha256
        return known in (None, hashlib.sha256(manifest).hexdigest())

    def with_entries(self, entries: Mapping[str, IndexEntry]) -> "DatasetIndex":
        """The same but for these."""
        every = {**self.scenarios, **entries}
        return DatasetIndex(scenarios={name: every[name] for name in sorted(every)})

    def with_waiting(self, specs: Iterable[Spec]) -> "DatasetIndex":
        """The same, with these scenarios under way: nothing is known of them but their specs."""
        return self.with_entries(
            {spec.id: IndexEntry.from_manifest_text(spec, None) for spec in specs}
        )

    def format_summary(self) -> str:
        """How many scenarios are how far, in words."""
        states = [entry.state for entry in self.scenarios.values()]
        counts = {state: states.count(state) for state in ("whole", "partial", "failed", "waiting")}
        parts = [f"{count} {state}" for state, count in counts.items() if count]
        return f"{len(states)} scenario{'' if len(states) == 1 else 's'}: {', '.join(parts)}"

    def to_json(self) -> bytes:
        """Sorted, without times and places, ending in a newline."""
        return self.model_dump_json(indent=1).encode() + b"\n"

    @staticmethod
    def parse(text: bytes, *, where: str) -> "DatasetIndex":
        """Read what `to_json` gave; RunError if it is something else."""
        try:
            return DatasetIndex.model_validate_json(text)
        except ValidationError as error:
            raise RunError(
                f"{where}: not an index of this version; delete it, and the next run starts another"
            ) from error

    @staticmethod
    def load(dataset: Path) -> "DatasetIndex | None":
        """That of a dataset; None if it has none. RunError if it cannot be read."""
        path = dataset / INDEX_FILE
        try:
            return DatasetIndex.parse(path.read_bytes(), where=str(path))
        except (FileNotFoundError, NotADirectoryError):
            return None
        except OSError as error:
            raise RunError(f"{path}: cannot be read: {error.strerror}") from error


class IndexWriter:
    """Keeps the index of a folder up to date; several processes may at a time.

    A folder comes into being with its first scenario; before that nothing is noted.

    Args:
        dataset: The folder.
        specs: What a run was asked for.

    Raises:
        InputError: It is a file.
    """

    def __init__(self, dataset: Path, specs: Iterable[Spec]) -> None:
        if dataset.exists() and not dataset.is_dir():
            raise InputError(f"--output {dataset}: is a file; name a folder")
        self._dataset = dataset
        self._specs = {spec.id: spec for spec in specs}
        self._has_written = False
        if (dataset / INDEX_FILE).exists():
            self._update({})

    def record_end(self, name: str, *, failed: bool) -> None:
        """Note how a scenario came to its end; RunError if the disk does not take it."""
        if self._dataset.is_dir():
            path = self._dataset / name / MANIFEST_FILE
            text = path.read_bytes() if path.exists() else None
            self._update(
                {name: IndexEntry.from_manifest_text(self._specs[name], text, failed=failed)}
            )

    def _update(self, entries: Mapping[str, IndexEntry]) -> None:
        incoming, held = self._dataset / f".{INDEX_FILE}", self._dataset / ".index.lock"
        with report_disk_errors(self._dataset), lock_file(held, "the index"):
            index = DatasetIndex.load(self._dataset) or DatasetIndex()
            if not self._has_written:
                index = index.with_waiting(self._specs.values())
            write_file(incoming, index.with_entries(entries).to_json())
            move_file(incoming, self._dataset / INDEX_FILE)
            held.unlink()
        self._has_written = True


PUBLISHED_SPLITS = {"train": ("ri", "rsnj", "unj"), "validate": ("rcnj",), "test": ("ui",)}
"""Roads by split, as Adver-City was published."""
SPLITS_FILE = "splits.json"


def link_splits(
    dataset: Path, output: Path, roads: Mapping[str, Sequence[str]] = PUBLISHED_SPLITS
) -> dict[str, list[str]]:
    """Link every scenario into `output/<split>/`, and write an index; scenarios by split.

    Nothing is copied. Calling it again brings the links up to date.

    Raises:
        InputError: A road belongs to no split, or to two.
        RunError: The links cannot be made.
    """
    split_of = _map_roads_to_splits(roads)
    folders = find_scenarios(dataset)
    found: dict[str, list[str]] = {name: [] for name in roads}
    for folder in folders:
        road = Manifest.load(folder).spec.road.id
        if road not in split_of:
            raise InputError(f"{folder}: road '{road}' is in no split; name it in one")
        found[split_of[road]].append(folder.name)
    try:
        _link_folders({folder.name: folder for folder in folders}, found, output)
    except OSError as error:
        raise RunError(
            f"{error.filename or output}: cannot be written: {error.strerror}"
        ) from error
    return found


def _map_roads_to_splits(roads: Mapping[str, Sequence[str]]) -> dict[str, str]:
    names = [road for chosen in roads.values() for road in chosen]
    twice = sorted({road for road in names if names.count(road) > 1})
    if twice:
        raise InputError(f"road '{twice[0]}' is in two splits; leave it in one")
    return {road: name for name, chosen in roads.items() for road in chosen}


def _link_folders(folders: dict[str, Path], found: dict[str, list[str]], output: Path) -> None:
    for name, members in found.items():
        split_folder = output / name
        split_folder.mkdir(parents=True, exist_ok=True)
        for link in split_folder.iterdir():
            if link.is_symlink():
                link.unlink()
        for member in members:
            target = os.path.relpath(folders[member].resolve(), split_folder.resolve())
            (split_folder / member).symlink_to(target)
    (output / SPLITS_FILE).write_text(json.dumps(found, indent=1) + "\n")
