"""The index of a set: every scenario that was asked for, what it is made from, how far it is.

It lies beside the scenarios' folders, where loaders, which look for folders, pass it by.
"""

import hashlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Literal

from advercity_dsl import Model, Spec
from pydantic import Field, ValidationError

from advercity.dataset.manifest import MANIFEST, Manifest, spec_digest
from advercity.dataset.staging import failures_named, lock, move, write
from advercity.errors import InputError, RunError

INDEX = "index.json"


class Entry(Model):
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
    def of(spec: Spec, text: bytes | None, *, failed: bool = False) -> "Entry":
        """Of a scenario with the manifest `text`, or of one that has none."""
        if text is None:
            state = "failed" if failed else "waiting"
            return Entry(spec_sha256=spec_digest(spec), state=state)
        manifest = Manifest.parse(text, where=f"{spec.id}/{MANIFEST}")
        return Entry(
            spec_sha256=manifest.identity.spec_sha256,
            state="failed" if failed else "whole" if manifest.complete else "partial",
            frames=len(manifest.frames),
            length=manifest.length,
            files=len(manifest.files),
            size_bytes=sum(record.size for record in manifest.files.values()),
            manifest_sha256=hashlib.sha256(text).hexdigest(),
        )


class Index(Model):
    """What a set consists of; the same set gives the same text."""

    index_version: Literal[1] = 1
    scenarios: dict[str, Entry] = Field(default_factory=dict[str, Entry])
    """By folder."""

    @property
    def made(self) -> set[str]:
        """Scenarios that are there, wholly or in part."""
        return {name for name, entry in self.scenarios.items() if entry.manifest_sha256}

    def agrees(self, name: str, manifest: bytes) -> bool:
        """Whether the manifest of a scenario is the one that is known, if one is."""
        entry = self.scenarios.get(name)
        known = None if entry is None else entry.manifest_sha256
        return known in (None, hashlib.sha256(manifest).hexdigest())

    def with_entries(self, entries: Mapping[str, Entry]) -> "Index":
        """The same but for these."""
        every = {**self.scenarios, **entries}
        return Index(scenarios={name: every[name] for name in sorted(every)})

    def waiting_for(self, specs: Iterable[Spec]) -> "Index":
        """The same, with these scenarios under way: nothing is known of them but their specs."""
        return self.with_entries({spec.id: Entry.of(spec, None) for spec in specs})

    def told(self) -> str:
        """How many scenarios are how far, in words."""
        states = [entry.state for entry in self.scenarios.values()]
        counts = {state: states.count(state) for state in ("whole", "partial", "failed", "waiting")}
        parts = [f"{count} {state}" for state, count in counts.items() if count]
        return f"{len(states)} scenario{'' if len(states) == 1 else 's'}: {', '.join(parts)}"

    def to_json(self) -> bytes:
        """Sorted, without times and places, ending in a newline."""
        return self.model_dump_json(indent=1).encode() + b"\n"

    @staticmethod
    def parse(text: bytes, *, where: str) -> "Index":
        """Read what `to_json` gave; RunError if it is something else."""
        try:
            return Index.model_validate_json(text)
        except ValidationError as error:
            raise RunError(
                f"{where}: not an index of this version; delete it, and the next run starts another"
            ) from error

    @staticmethod
    def of_folder(dataset: Path) -> "Index | None":
        """That of a dataset; None if it has none. RunError if it cannot be read."""
        path = dataset / INDEX
        try:
            return Index.parse(path.read_bytes(), where=str(path))
        except (FileNotFoundError, NotADirectoryError):
            return None
        except OSError as error:
            raise RunError(f"{path}: cannot be read: {error.strerror}") from error


class FolderIndex:
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
        self._noted = False
        if (dataset / INDEX).exists():
            self._note({})

    def ended(self, name: str, *, failed: bool) -> None:
        """Note how a scenario came to its end; RunError if the disk does not take it."""
        if self._dataset.is_dir():
            path = self._dataset / name / MANIFEST
            text = path.read_bytes() if path.exists() else None
            self._note({name: Entry.of(self._specs[name], text, failed=failed)})

    def _note(self, entries: Mapping[str, Entry]) -> None:
        incoming, held = self._dataset / f".{INDEX}", self._dataset / ".index.lock"
        with failures_named(self._dataset), lock(held, "the index"):
            index = Index.of_folder(self._dataset) or Index()
            if not self._noted:
                index = index.waiting_for(self._specs.values())
            write(incoming, index.with_entries(entries).to_json())
            move(incoming, self._dataset / INDEX)
            held.unlink()
        self._noted = True
