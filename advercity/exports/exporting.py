"""Exports a dataset: missing pieces are written one by one."""

import logging
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from advercity.dataset.manifest import Manifest, list_kinds_of_others
from advercity.dataset.partial_files import is_being_written
from advercity.dataset.reader import Dataset, Scenario
from advercity.dataset.scenario_folders import EXPORT_FILE, no_frames_error
from advercity.dataset.verification import compare_with_index
from advercity.digests import compute_json_digest
from advercity.errors import InputError, RunError, escape_control_characters
from advercity.exports.export_folder import ExportFolder, check_export_folder
from advercity.exports.export_manifest import ExportManifest
from advercity.exports.pieces import NAME_PATTERN, Piece
from advercity.exports.registry import find_export_format
from advercity.exports.verified_files import VerifiedFiles
from advercity.pipeline.progress import Progress, ProgressCallback, ignore_progress

_logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class ExportResult:
    """The outcome of an export.

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
    """Write a dataset in another format; an interrupted export continues where it ended.

    Args:
        format: Name of the format.
        dataset: Folder of the dataset, or of one scenario.
        output: Folder of the export.
        options: Options of the format by name; None stands for the default.
        fresh: Remove files of earlier exports and start over.
        allow_edited: Export files changed after their run with these changes, and record it.
        report: Called with the progress.

    Raises:
        InputError: There is no such format, the dataset lacks its inputs or is damaged, or the
            output holds something else.
        RunError: A run is or was writing the dataset meanwhile, the output has another export, or
            the disk refuses.
    """
    target = find_export_format(format)
    chosen = target.complete_options(options or {})
    check_export_folder(output)
    opened = _open_whole_dataset(dataset)
    target.check_sensors(opened)
    listed = target.load()(opened, chosen)
    manifest = ExportManifest.for_dataset(opened, format, chosen)
    view = _FrameCounter(opened, report)
    with ExportFolder(output, manifest, fresh=fresh) as folder:
        # Before anything of a former export is removed, and also if it is complete.
        verified = VerifiedFiles.of_dataset(opened, report, allow_edited=allow_edited)
        pieces = [_with_edits(piece, verified.edited) for piece in listed]
        folder.start(pieces, verified.edited)
        for piece in pieces:
            if folder.is_done(piece):
                view.skip(piece)
            else:
                folder.write_piece(piece, view.count, verified.check_unchanged)
        _check_is_unchanged(opened)
        view.finish()
    return ExportResult(
        output, len(opened.scenarios), len(opened), folder.file_count, folder.size_bytes
    )


class _FrameCounter:
    """Reports progress by frames; a second pass through them begins again at 1."""

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
    """Open a dataset whose runs have ended, and warn of scenarios with frames left.

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
        _check_name(scenario.path)
        if names[scenario.path.name] > 1:
            raise InputError(
                f"{path}: has {names[scenario.path.name]} scenarios called {scenario.path.name};"
                " export them one by one"
            )
        if is_being_written(scenario.path):
            raise RunError(
                f"{scenario.path}: a run is writing it; export it when the run has ended"
            )
        _warn_of_missing_frames(scenario)
        if others := list_kinds_of_others(scenario.spec):
            _logger.warning("%s: %s left out", scenario.path, ", ".join(sorted(others)))
    if not len(dataset):
        raise no_frames_error(path)
    return dataset


def _check_name(scenario: Path) -> None:
    """Check whether a scenario's name can name files of an export, as most formats need it."""
    reason = None
    if not NAME_PATTERN.fullmatch(scenario.name):
        reason = "is hidden, has a backslash, or is not UTF-8"
    elif scenario.name == Path(EXPORT_FILE).stem:
        reason = f"is reserved for {EXPORT_FILE}, a file of every export"
    if reason is not None:
        raise InputError(
            f"{escape_control_characters(str(scenario))}: no scenario of this name can be exported,"
            f" since it {reason}; rename the folder"
        )


def _with_edits(piece: Piece, edited: Mapping[str, str]) -> Piece:
    """Add edits of its scenario's files to a piece's inputs: new edits, new export."""
    own = {
        path: digest
        for path, digest in edited.items()
        if piece.scenario in (None, path.partition("/")[0])
    }
    inputs = compute_json_digest({"inputs": piece.inputs, "edited": own})
    return replace(piece, inputs=inputs) if own else piece


def _check_is_unchanged(dataset: Dataset) -> None:
    """Raise a RunError if a run has written into a scenario since the dataset was opened."""
    for scenario in dataset.scenarios:
        if is_being_written(scenario.path) or Manifest.load(scenario.path) != scenario.manifest:
            raise RunError(
                f"{scenario.path}: a run wrote it during the export; export it again when the run"
                " has ended"
            )


def _warn_of_missing_frames(scenario: Scenario) -> None:
    length, found = scenario.manifest.length, len(scenario)
    if not found:
        _logger.warning("%s: has no frames yet, and is left out", scenario.path)
    elif found < length:
        _logger.warning("%s: %d of %d frames are there", scenario.path, found, length)
