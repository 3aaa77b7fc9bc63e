"""The verified files of an export's dataset; they must not change until it is finished."""

import hashlib
import logging
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from advercity.dataset.agent_view import MAX_IMAGE_BYTES, report_read_errors
from advercity.dataset.reader import Dataset, Scenario
from advercity.dataset.verification import verify_scenario
from advercity.documents import read_bytes
from advercity.errors import InputError, RunError
from advercity.exports.pieces import Piece
from advercity.pipeline.progress import Progress, ProgressCallback

_logger = logging.getLogger(__name__)

_FileState = tuple[int, int, int, int] | None


@dataclass(frozen=True)
class VerifiedFiles:
    """The files of a dataset, as they were when they were compared with its manifests.

    Attributes:
        edited: Checksums of files with differences to the manifests, by scenario and path.
    """

    edited: Mapping[str, str]
    _scenarios: Mapping[str, Scenario]
    _states: Mapping[str, Mapping[str, _FileState]]

    @staticmethod
    def of_dataset(
        dataset: Dataset, report: ProgressCallback, *, allow_edited: bool
    ) -> "VerifiedFiles":
        """Compare all files with the manifests, and report the number of allowed changes.

        Raises:
            InputError: Files are missing, unfinished, or changed without being allowed to.
            RunError: A file cannot be read.
        """
        edited: dict[str, str] = {}
        states: dict[str, Mapping[str, _FileState]] = {}
        for scenario in dataset.scenarios:
            name = scenario.path.name
            report(Progress(name, "verify"))
            # Before the contents are read: any later change of a file shows in its state.
            states[name] = {
                path: _read_state(scenario.path / path) for path in scenario.manifest.files
            }
            digests = _verify(scenario.path, allow_edited=allow_edited)
            edited |= {f"{name}/{path}": digest for path, digest in digests.items()}
        return VerifiedFiles(edited, {one.path.name: one for one in dataset.scenarios}, states)

    def check_unchanged(self, piece: Piece) -> None:
        """Raise a RunError if a possible input of a piece was written meanwhile."""
        for name in self._scenarios if piece.scenario is None else [piece.scenario]:
            scenario = self._scenarios[name]
            for path, record in scenario.manifest.files.items():
                if piece.frame is not None and record.frame not in (None, piece.frame):
                    continue
                if _read_state(scenario.path / path) != self._states[name][path]:
                    raise RunError(
                        f"{scenario.path / path}: was changed during the export; export again;"
                        " finished pieces are kept"
                    )


def _read_state(path: Path) -> _FileState:
    """Read numbers by which a written or replaced file shows; None if it cannot be read.

    The time of change, unlike the time of modification, is set by the system alone.
    """
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_ino, found.st_size, found.st_mtime_ns, found.st_ctime_ns


def _verify(scenario: Path, *, allow_edited: bool) -> dict[str, str]:
    """Return the checksums of changed files by path, and say how many there are."""
    damage = [problem for problem in verify_scenario(scenario) if problem.is_damage]
    for problem in damage:
        if problem.kind != "changed" or not allow_edited:
            edited = (
                "; `allow_edited` exports them as they are" if problem.kind == "changed" else ""
            )
            raise InputError(
                f"{problem}; `advercity verify` lists all such files, `advercity repair` restores"
                f" them{edited}"
            )
    if damage:
        noun = "file was" if len(damage) == 1 else "files were"
        text = "%s: %d %s changed since the run, and exported as they are"
        _logger.warning(text, scenario, len(damage), noun)
    return {problem.path: _hash_file(scenario / problem.path) for problem in damage}


def _hash_file(path: Path) -> str:
    with report_read_errors(path):
        return hashlib.sha256(read_bytes(path, max_bytes=MAX_IMAGE_BYTES)).hexdigest()
