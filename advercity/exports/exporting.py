"""Exports a dataset: what is missing of it is written, piece by piece."""

import logging
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from advercity.dataset.partial_files import is_being_written
from advercity.dataset.reader import Dataset, Scenario
from advercity.dataset.scenario_folders import no_frames_error
from advercity.dataset.verification import compare_with_index, verify_scenario
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
    report: ProgressCallback = ignore_progress,
) -> ExportResult:
    """Write a dataset in another format; an export that was cut short goes on where it ended.

    Args:
        format: Name of the format.
        dataset: Folder of the dataset, or of one scenario.
        output: Folder of the export.
        options: Options of the format by name, without those that are None.
        fresh: Remove what exports have written there and start over.
        report: Called with the progress.

    Raises:
        InputError: There is no such format, the dataset lacks what it needs or is damaged, or the
            output holds something else.
        RunError: A run is writing the dataset, the output has another export, or the disk refuses.
    """
    target = find_export_format(format)
    chosen = target.complete_options(options or {})
    check_export_folder(output)
    opened = _open_whole_dataset(dataset)
    pieces = target.load()(opened, chosen)
    manifest = ExportManifest.for_dataset(opened, format, chosen)
    view = _FrameCounter(opened, report)
    unverified = {one.path.name: one.path for one in opened.scenarios}
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


def _check_is_as_recorded(scenario: Path) -> None:
    """Raise an InputError if files are not as the manifest, which the export names, says."""
    damage = [problem for problem in verify_scenario(scenario) if problem.is_damage]
    if damage:
        raise InputError(
            f"{damage[0]}; `advercity verify` lists all such files, `advercity repair` restores"
            " them"
        )


def _warn_of_missing_frames(scenario: Scenario) -> None:
    length, found = scenario.manifest.length, len(scenario)
    if not found:
        _logger.warning("%s: has no frames yet, and is left out", scenario.path)
    elif found < length:
        _logger.warning("%s: %d of %d frames are there", scenario.path, found, length)
