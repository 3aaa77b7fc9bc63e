"""Staging beside a scenario, and in it the journals of frames done since the last manifest.

`OUTPUT/.staging/<spec id>` lies outside the scenario because readers of OPV2V take every folder
in a scenario for a viewpoint. Each process that writes frames has a journal of its own.
"""

import errno
import hashlib
import os
from collections.abc import Mapping
from contextlib import suppress
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


def append_to_journal(scenario: Path, process: int, records: Mapping[str, FileRecord]) -> None:
    """Note that these files, by path, are in place.

    It is one write: if the process is killed the line is whole, or torn and the last.

    Args:
        scenario: Whose files they are.
        process: Whose journal it is, by number.
        records: Of the files.
    """
    line = _RECORDS.dump_json(dict(records), exclude_none=True) + b"\n"
    path = staging_of(scenario) / f"journal_{process}.jsonl"
    with path.open("ab", buffering=0) as stream:
        if stream.write(line) != len(line):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))


def read_journal(scenario: Path) -> dict[str, FileRecord]:
    """Records of all whole lines of all processes, by path; empty if nothing is noted."""
    records: dict[str, FileRecord] = {}
    for path in journals(scenario):
        with suppress(FileNotFoundError, ValidationError):  # finished meanwhile; torn at its end
            for line in path.read_bytes().splitlines():
                records |= _RECORDS.validate_json(line)
    return records


def remove_journal(scenario: Path) -> None:
    """Forget what has been noted."""
    for path in journals(scenario):
        path.unlink()


def journals(scenario: Path) -> list[Path]:
    """Files in which something is noted."""
    return sorted(staging_of(scenario).glob("journal_*.jsonl"))
