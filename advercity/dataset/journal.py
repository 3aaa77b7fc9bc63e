"""Staging beside a scenario, and in it the journal of frames done since the last manifest.

`OUTPUT/.staging/<spec id>` lies outside the scenario because readers of OPV2V take every folder
in a scenario for a viewpoint.
"""

import errno
import hashlib
import os
from collections.abc import Mapping
from pathlib import Path

from advercity_dsl import Model
from pydantic import TypeAdapter, ValidationError


class FileRecord(Model):
    """A file as it was written; `frame` is None for files that belong to the whole scenario."""

    size: int
    sha256: str
    frame: int | None = None

    @staticmethod
    def of(content: bytes, *, frame: int | None = None) -> "FileRecord":
        """Record of a file with this content."""
        return FileRecord(
            size=len(content), sha256=hashlib.sha256(content).hexdigest(), frame=frame
        )


_RECORDS = TypeAdapter(dict[str, FileRecord])


def staging_of(scenario: Path) -> Path:
    """Where a scenario's files are before they are whole."""
    return scenario.parent / ".staging" / scenario.name


def append_to_journal(scenario: Path, records: Mapping[str, FileRecord]) -> None:
    """Note that these files, by path, are in place.

    It is one write: if the process is killed the line is whole, or torn and the last.
    """
    line = _RECORDS.dump_json(dict(records), exclude_none=True) + b"\n"
    path = _journal(scenario)
    with path.open("ab", buffering=0) as stream:
        if stream.write(line) != len(line):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))


def read_journal(scenario: Path) -> dict[str, FileRecord]:
    """Records of all whole lines, by path; empty if there is no journal."""
    path = _journal(scenario)
    if not path.exists():
        return {}
    records: dict[str, FileRecord] = {}
    for line in path.read_bytes().splitlines():
        try:
            records |= _RECORDS.validate_json(line)
        except ValidationError:
            break
    return records


def remove_journal(scenario: Path) -> None:
    """Forget what has been noted."""
    _journal(scenario).unlink(missing_ok=True)


def _journal(scenario: Path) -> Path:
    return staging_of(scenario) / "journal.jsonl"
