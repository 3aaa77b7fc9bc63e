"""What a scenario's folder holds, with checksums; and whether it still does."""

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from advercity_dsl import Model, Spec
from pydantic import ValidationError

from advercity import __version__
from advercity.dataset.journal import FileRecord, read_journal
from advercity.errors import InputError, RunError

MANIFEST = "manifest.json"
RendererIdentity = dict[str, str | int | float | bool]


class Identity(Model):
    """What decides every byte of a scenario's data."""

    spec: str
    spec_sha256: str
    trace_sha256: str
    renderer: RendererIdentity
    """Backend, profile, image scale, device class: whatever changes pictures."""
    advercity: str = __version__

    @staticmethod
    def of(spec: Spec, *, trace_sha256: str, renderer: RendererIdentity) -> "Identity":
        """Identity of the data of `spec`."""
        digest = hashlib.sha256(spec.model_dump_json().encode()).hexdigest()
        return Identity(
            spec=spec.id, spec_sha256=digest, trace_sha256=trace_sha256, renderer=renderer
        )

    def differences(self, other: "Identity") -> list[str]:
        """What is not the same in `other`, as `name: value here, value there`, both shortened."""
        mine, others = self._flat(), other._flat()
        return [
            f"{key}: {mine.get(key)!s:.20}, {others.get(key)!s:.20}"
            for key in sorted(mine | others)
            if mine.get(key) != others.get(key)
        ]

    def _flat(self) -> RendererIdentity:
        return self.model_dump(exclude={"renderer"}) | self.renderer


class Manifest(Model):
    """What has been written of a scenario; the same data give the same text."""

    manifest_version: Literal[1] = 1
    identity: Identity
    length: int
    """Frames of the whole scenario."""
    complete: bool
    """Whether all of them are done."""
    frames: tuple[int, ...]
    """Those that are done."""
    files: dict[str, FileRecord]
    """By path within the scenario."""

    @staticmethod
    def of(identity: Identity, *, length: int, files: Mapping[str, FileRecord]) -> "Manifest":
        """Manifest of these files."""
        frames = sorted({file.frame for file in files.values() if file.frame is not None})
        return Manifest(
            identity=identity,
            length=length,
            complete=len(frames) == length,
            frames=tuple(frames),
            files={path: files[path] for path in sorted(files)},
        )

    def to_json(self) -> str:
        """Sorted, without times and places, ending in a newline."""
        return self.model_dump_json(indent=1, exclude_none=True) + "\n"

    @staticmethod
    def load(scenario: Path) -> "Manifest":
        """What is done of a scenario: its manifest, and the journal of a run that was cut short.

        Raises:
            InputError: The folder has no manifest.
            RunError: It cannot be read.
        """
        path = scenario / MANIFEST
        try:
            written = Manifest.model_validate_json(path.read_bytes())
            files = written.files | read_journal(scenario)
            return Manifest.of(written.identity, length=written.length, files=files)
        except FileNotFoundError as error:
            raise InputError(f"{scenario}: no {MANIFEST} in it, so not a dataset") from error
        except (OSError, ValidationError) as error:
            raise RunError(
                f"{path}: not a manifest of this version; --fresh starts over: {error}"
            ) from error


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


def verify(scenario: Path) -> list[Problem]:
    """Compare every file of a scenario with its manifest, by size and checksum.

    Raises:
        InputError: The folder has no manifest.
        RunError: A file cannot be read.
    """
    recorded = Manifest.load(scenario).files
    found = set(_paths(scenario)) - {MANIFEST}
    problems = [Problem(scenario, path, "extra") for path in found - recorded.keys()]
    for path, record in recorded.items():
        if path not in found:
            problems.append(Problem(scenario, path, "missing", record.frame))
        elif not _matches(scenario / path, record):
            problems.append(Problem(scenario, path, "changed", record.frame))
    return sorted(problems, key=lambda problem: problem.path)


def verify_dataset(dataset: Path) -> list[Problem]:
    """Problems of every scenario of a dataset, or of the one scenario that it is."""
    return [problem for scenario in scenarios(dataset) for problem in verify(scenario)]


def scenarios(dataset: Path) -> list[Path]:
    """Folders of scenarios in a dataset, or the folder itself if it is one.

    Raises:
        InputError: There are none.
    """
    if (dataset / MANIFEST).is_file():
        return [dataset]
    found = sorted(path.parent for path in dataset.glob(f"*/{MANIFEST}"))
    if not found:
        raise InputError(f"{dataset}: no {MANIFEST} in it or in its folders, so not a dataset")
    return found


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
