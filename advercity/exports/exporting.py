"""Exports a dataset: what is missing of it is written, piece by piece."""

import hashlib
import logging
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from advercity.dataset.agent_view import MAX_IMAGE_BYTES, report_read_errors
from advercity.dataset.manifest import Manifest
from advercity.dataset.partial_files import is_being_written
from advercity.dataset.reader import Dataset, Scenario
from advercity.dataset.scenario_folders import no_frames_error
from advercity.dataset.verification import compare_with_index, verify_scenario
from advercity.digests import compute_json_digest
from advercity.documents import read_bytes
from advercity.errors import InputError, RunError
from advercity.exports.export_folder import ExportFolder, check_export_folder
from advercity.exports.export_manifest import ExportManifest
from advercity.exports.pieces import Piece
from advercity.exports.registry import find_export_format
from advercity.pipeline.progress import Progress, ProgressCallback, ignore_progress

_logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class ExportResult:
    """What an export has made.

    Attributes:
        output: Its folder.
        scenarios: Number of scenarios.
        frames: Number of frames.
        files: Number of files, without the manifest.
        size_bytes: Their size.
    """

    output: Path
    scenarios: int
    frames: int
    files: int
    size_bytes: int


def export_dataset(
    format: str,
    dataset: Path,
    output: Path,
    *,
    options: Mapping[str, str | None] | None = None,
    fresh: bool = False,
    allow_edited: bool = False,
    report: ProgressCallback = ignore_progress,
) -> ExportResult:
    """Write a dataset in another format; an export that was cut short goes on where it ended.

    Args:
        format: Name of the format.
        dataset: Folder of the dataset, or of one scenario.
        output: Folder of the export.
        options: Options of the format by name, without those that are None.
        fresh: Remove what exports have written there and start over.
        allow_edited: Export files that were changed after their run as they are, and record it.
        report: Called with the progress.

    Raises:
        InputError: There is no such format, the dataset lacks what it needs or is damaged, or the
            output holds something else.
        RunError: A run is or was writing the dataset meanwhile, the output has another export, or
            the disk refuses.
    """
    target = find_export_format(format)
    chosen = target.complete_options(options or {})
    check_export_folder(output)
    opened = _open_whole_dataset(dataset)
    edited = _find_edited_files(opened, report) if allow_edited else {}
    pieces = [_with_edits(piece, edited) for piece in target.load()(opened, chosen)]
    manifest = ExportManifest.for_dataset(opened, format, chosen, edited)
    view = _FrameCounter(opened, report)
    # With `allow_edited`, all are verified by now.
    unverified = {} if allow_edited else {one.path.name: one.path for one in opened.scenarios}
    with ExportFolder(output, manifest, pieces, fresh=fresh) as folder:
        for piece in pieces:
            if folder.is_done(piece):
                view.skip(piece)
            else:
                for name in [piece.scenario] if piece.scenario is not None else [*unverified]:
                    if name in unverified:
                        report(Progress(name, "verify"))
                        _check_is_as_recorded(unverified.pop(name))
                folder.write_piece(piece, view.count)
        _check_is_unchanged(opened)
        view.finish()
    return ExportResult(
        output, len(opened.scenarios), len(opened), folder.file_count, folder.size_bytes
    )


class _FrameCounter:
    """Reports progress by frames; a format that goes through them twice begins again at 1."""

    def __init__(self, dataset: Dataset, report: ProgressCallback) -> None:
        self._report = report
        self._totals = {one.path.name: len(one) for one in dataset.scenarios}
        self._done: Counter[str] = Counter()

    def count(self, scenario: str) -> None:
        self._add(scenario, 1)

    def skip(self, piece: Piece) -> None:
        if piece.scenario is not None and piece.frames:
            self._add(piece.scenario, piece.frames)

    def finish(self) -> None:
        for name, total in self._totals.items():
            self._report(Progress(name, "done", done=total, total=total))

    def _add(self, scenario: str, frames: int) -> None:
        total = self._totals[scenario]
        self._done[scenario] += frames
        done = (self._done[scenario] - 1) % total + 1
        self._report(Progress(scenario, "done" if done == total else "export", done, total))


def _open_whole_dataset(path: Path) -> Dataset:
    """Open a dataset whose runs have ended, and say which scenarios have frames left.

    Raises:
        InputError: It has no frames, or a scenario is missing.
        RunError: A run is writing it.
    """
    damage = [
        f"{problem}; `advercity run` with its spec makes it again, or export the other scenarios"
        " one by one"
        for problem in compare_with_index(path)
        if problem.is_damage
    ]
    if damage:
        raise InputError(*damage)
    dataset = Dataset(path)
    names = Counter(one.path.name for one in dataset.scenarios)
    for scenario in dataset.scenarios:
        if names[scenario.path.name] > 1:
            raise InputError(
                f"{path}: has {names[scenario.path.name]} scenarios called {scenario.path.name};"
                " export them one by one"
            )
        if is_being_written(scenario.path):
            raise RunError(f"{scenario.path}: a run is writing it; export it when that has ended")
        _warn_of_missing_frames(scenario)
    if not len(dataset):
        raise no_frames_error(path)
    return dataset


def _find_edited_files(dataset: Dataset, report: ProgressCallback) -> dict[str, str]:
    """Return the checksums of changed files by scenario and path, and say how many there are."""
    edited: dict[str, str] = {}
    for scenario in dataset.scenarios:
        name = scenario.path.name
        report(Progress(name, "verify"))
        changed = _check_is_as_recorded(scenario.path, allow_edited=True)
        if changed:
            noun = "file was" if len(changed) == 1 else "files were"
            text = "%s: %d %s changed since the run, and exported as they are"
            _logger.warning(text, scenario.path, len(changed), noun)
        for path in changed:
            with report_read_errors(scenario.path / path):
                content = read_bytes(scenario.path / path, max_bytes=MAX_IMAGE_BYTES)
            edited[f"{name}/{path}"] = hashlib.sha256(content).hexdigest()
    return edited


def _with_edits(piece: Piece, edited: Mapping[str, str]) -> Piece:
    """Let a piece be made again when files of its scenario were edited since, or no longer are."""
    own = {
        path: digest
        for path, digest in edited.items()
        if piece.scenario in (None, path.partition("/")[0])
    }
    inputs = compute_json_digest({"inputs": piece.inputs, "edited": own})
    return replace(piece, inputs=inputs) if own else piece


def _check_is_as_recorded(scenario: Path, *, allow_edited: bool = False) -> list[str]:
    """Check that files are as the manifest, which the export names, says.

    Returns:
        The paths of those that were changed, if that is allowed.

    Raises:
        InputError: Files are missing, unfinished, or changed without being allowed to.
    """
    damage = [problem for problem in verify_scenario(scenario) if problem.is_damage]
    changed = [problem.path for problem in damage if problem.kind == "changed" and allow_edited]
    for problem in damage:
        if problem.path not in changed:
            edited = (
                "; `allow_edited` exports them as they are" if problem.kind == "changed" else ""
            )
            raise InputError(
                f"{problem}; `advercity verify` lists all such files, `advercity repair` restores"
                f" them{edited}"
            )
    return changed


def _check_is_unchanged(dataset: Dataset) -> None:
    """Raise a RunError if a run has written into a scenario since the dataset was opened."""
    for scenario in dataset.scenarios:
        if is_being_written(scenario.path) or Manifest.load(scenario.path) != scenario.manifest:
            raise RunError(
                f"{scenario.path}: a run wrote it during the export; export it again when that has"
                " ended"
            )


def _warn_of_missing_frames(scenario: Scenario) -> None:
    length, found = scenario.manifest.length, len(scenario)
    if not found:
        _logger.warning("%s: has no frames yet, and is left out", scenario.path)
    elif found < length:
        _logger.warning("%s: %d of %d frames are there", scenario.path, found, length)
