"""The folder of an export; a piece in it is whole or absent, whatever interrupts the export."""

import math
from collections.abc import Callable, Collection, Iterable, Mapping
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Self

from advercity_dsl import Model
from pydantic import ValidationError

from advercity.atomic_files import (
    is_partial_folder,
    move_file,
    open_partial_folder,
    open_without_links,
    remove_abandoned_partials,
    sync_files,
    write_file,
)
from advercity.dataset.partial_files import (
    NO_FILE_ERRORS,
    FileRecord,
    is_locked,
    list_matching_files,
    lock_file,
    report_disk_errors,
    set_aside,
)
from advercity.dataset.scenario_folders import (
    EXPORT_FILE,
    STAGING_FOLDER,
    check_is_outside_datasets,
    check_is_outside_exports,
    check_is_readable,
)
from advercity.dataset.verification import (
    FileProblem,
    compare_with_records,
    list_files,
    matches_record,
)
from advercity.documents import MAX_JSON_BYTES, parse_json, read_bytes
from advercity.errors import InputError, RunError
from advercity.exports.export_manifest import (
    ExportManifest,
    ExportPath,
    ExportRecord,
)
from advercity.exports.pieces import FrameListener, Piece, PieceFiles

LOCK_FILE = f"{STAGING_FOLDER}/lock"
JOURNAL_FILE = f"{STAGING_FOLDER}/journal.jsonl"


class _JournalEntry(Model):
    """A piece whose files are to be moved into place, or have been."""

    piece: str
    inputs: str
    moved: bool
    files: dict[ExportPath, FileRecord]

    def list_records(self) -> dict[str, ExportRecord]:
        return {
            path: ExportRecord(size=record.size, sha256=record.sha256, piece=self.piece)
            for path, record in self.files.items()
        }


class ExportFolder:
    """Opens the folder of an export, writes pieces, and keeps the manifest; a context manager.

    Only `start` changes files there. Leaving it after that, also by an error, writes the manifest.

    Args:
        path: The folder.
        manifest: The manifest of the export, without files.
        fresh: Remove files of earlier exports and start over.

    Raises:
        InputError: The folder was not written by an export.
        RunError: It has another export, another process is writing it, or the disk refuses.
    """

    def __init__(self, path: Path, manifest: ExportManifest, *, fresh: bool = False) -> None:
        self.path = path
        self._manifest = manifest
        self._wanted: dict[str, str] = {}
        self._fresh = fresh
        self._is_new = not path.exists()
        self._is_started = False
        self._is_moving = False
        self._done: dict[str, str] = {}
        self._files: dict[str, ExportRecord] = {}

    @property
    def size_bytes(self) -> int:
        """Size of all files without the manifest."""
        return sum(record.size for record in self._files.values())

    @property
    def file_count(self) -> int:
        """Number of files without the manifest."""
        return len(self._files)

    def is_done(self, piece: Piece) -> bool:
        """Return whether a piece is written."""
        return piece.name in self._done

    def __enter__(self) -> Self:
        check_export_folder(self.path)
        with report_disk_errors(self.path):
            self._check_no_links([LOCK_FILE])
            self._lock = lock_file(self.path / LOCK_FILE, "this export")
            with ExitStack() as on_error:
                on_error.callback(self._close)
                self._former = ExportManifest.load(self.path)
                if self._former is not None and not self._fresh:
                    self._manifest.check_continues(self._former, self.path)
                on_error.pop_all()
        return self

    def start(self, pieces: Iterable[Piece], edited: Mapping[str, str]) -> None:
        """Find the finished pieces, and remove pieces no longer given by the dataset.

        Args:
            pieces: All pieces of the export.
            edited: Checksums of edited files, as in the manifest.

        Raises:
            RunError: A folder of the export is a link, or the disk refuses.
        """
        self._wanted = {piece.name: piece.inputs for piece in pieces}
        self._manifest = self._manifest.model_copy(update={"edited": dict(edited)})
        with report_disk_errors(self.path):
            remove_abandoned_partials(self.path / STAGING_FOLDER, max_age_s=math.inf)
            if self._former is not None:
                self._adopt(self._former, _read_journal(self.path))
            self._save(complete=False)
        self._is_started = True

    def __exit__(self, kind: object, error: BaseException | None, traceback: object) -> None:
        try:
            if self._is_started:
                with report_disk_errors(self.path):
                    is_complete = error is None and self._done.keys() == self._wanted.keys()
                    self._save(complete=is_complete)
                    if error is not None and not self._has_begun:
                        (self.path / EXPORT_FILE).unlink()  # nothing was exported
        finally:
            self._close()

    @property
    def _has_begun(self) -> bool:
        return self._former is not None or bool(self._done) or self._is_moving

    def write_piece(
        self, piece: Piece, on_frame: FrameListener, check_inputs: Callable[[Piece], None]
    ) -> None:
        """Write a piece.

        Args:
            piece: The piece.
            on_frame: Called for each frame of it.
            check_inputs: Raises an error if the inputs of the piece have changed.

        Raises:
            InputError: A file of the dataset is missing or damaged; the piece is absent then.
            RunError: The disk is full or not writable, or a path is taken; the piece is absent.
        """
        with (
            report_disk_errors(self.path),
            open_partial_folder(self.path / STAGING_FOLDER) as partial,
        ):
            files = PieceFiles(partial, on_frame)
            piece.write(files)
            check_inputs(piece)
            records = files.records
            assert self._files.keys().isdisjoint(records), f"{piece.name}: a file of another piece"
            self._check_no_links(records)
            self._check_places(records)
            # Whatever interrupts the moves, the next export knows this one's files.
            self._is_moving = True
            journal = self._append_to_journal(piece, records, moved=False)
            sync_files([*(partial / path for path in records), journal, journal.parent])
            set_aside(self.path, records)
            for path in records:
                move_file(partial / path, self.path / path)
            sync_files({(self.path / path).parent for path in records})
            entry = self._append_to_journal(piece, records, moved=True)
            sync_files([entry])
        self._done[piece.name] = piece.inputs
        self._files |= _name_piece(records, piece.name)
        self._is_moving = False

    def _append_to_journal(
        self, piece: Piece, records: Mapping[str, FileRecord], *, moved: bool
    ) -> Path:
        entry = _JournalEntry(
            piece=piece.name, inputs=piece.inputs, moved=moved, files=dict(records)
        )
        path = self.path / JOURNAL_FILE
        # One write without a buffer: if the process is killed the line is whole, or the last.
        with open(path, "ab", buffering=0, opener=open_without_links) as stream:
            stream.write(entry.model_dump_json(exclude_none=True).encode() + b"\n")
        return path

    def _adopt(self, former: ExportManifest, entries: list[_JournalEntry]) -> None:
        """Keep whole pieces still wanted, and remove the other files of former exports."""
        pieces, records = _merge(former, entries)
        unmoved = {path: record for entry in entries for path, record in entry.files.items()}
        self._check_no_links({**unmoved, **records})
        journaled = {path for entry in entries for path in entry.files}
        damaged = {
            record.piece
            for path, record in records.items()
            if not self._is_as_recorded(path, record, by_content=path in journaled)
        }
        self._done = {
            name: inputs
            for name, inputs in pieces.items()
            if not self._fresh and self._wanted.get(name) == inputs and name not in damaged
        }
        self._files = {
            path: record for path, record in records.items() if record.piece in self._done
        }
        obsolete = {
            path: record
            for path, record in ({**unmoved, **records}).items()
            if path not in self._files
        }
        for path in list_matching_files(self.path, obsolete, obsolete):
            (self.path / path).unlink()
        self._remove_empty_folders(obsolete)

    def _is_as_recorded(self, path: str, record: FileRecord, *, by_content: bool) -> bool:
        check = record.matches if by_content else record.has_size_of
        try:
            return check(self.path / path)
        except NO_FILE_ERRORS:
            return False

    def _remove_empty_folders(self, paths: Iterable[str]) -> None:
        for folder in sorted(_list_folders(paths), reverse=True):  # inner folders come first
            with suppress(OSError):  # not empty, or gone
                (self.path / folder).rmdir()

    def _check_no_links(self, paths: Iterable[str]) -> None:
        """Refuse to write or delete through a link to a folder; the export's own may be one."""
        for folder in _list_folders(paths):
            if (self.path / folder).is_symlink():
                raise RunError(
                    f"{self.path / folder}: is a link; an export is written in real folders only"
                )

    def _check_places(self, paths: Collection[str]) -> None:
        """Refuse to write a file in place of a foreign folder, or the reverse."""
        for path in map(self.path.joinpath, paths):
            if path.is_dir() and not path.is_symlink():
                raise RunError(
                    f"{path}: is a folder where the export has a file; rename the folder, or choose"
                    " another `output`"
                )
        for folder in map(self.path.joinpath, _list_folders(paths)):
            if folder.exists() and not folder.is_dir():
                raise RunError(
                    f"{folder}: is a file where the export has a folder; rename the file, or choose"
                    " another `output`"
                )

    def _save(self, *, complete: bool) -> None:
        manifest = self._manifest.model_copy(
            update={
                "complete": complete,
                # In the order of the dataset and of paths, whenever they were written.
                "pieces": {
                    name: inputs for name, inputs in self._wanted.items() if name in self._done
                },
                "files": {path: self._files[path] for path in sorted(self._files)},
            }
        )
        # The remains of a killed process are recognised by its folder.
        with open_partial_folder(self.path / STAGING_FOLDER) as folder:
            partial = folder / EXPORT_FILE
            write_file(partial, manifest.to_json())
            sync_files([partial])
            move_file(partial, self.path / EXPORT_FILE)
        # Only now: the journal is the record until the manifest has its pieces, and of the files of
        # a piece whose moving was cut short it alone says whose they are.
        if not self._is_moving:
            (self.path / JOURNAL_FILE).unlink(missing_ok=True)

    def _close(self) -> None:
        with suppress(OSError):  # the folder stays if anything else is in it
            (self.path / LOCK_FILE).unlink(missing_ok=True)
            (self.path / STAGING_FOLDER).rmdir()
            if self._is_new:  # and still empty, or it stays
                self.path.rmdir()
        self._lock.close()


def check_export_folder(path: Path) -> None:
    """Check whether a folder is free for an export, or has one.

    Raises:
        InputError: It is a file, holds other things, or is in a dataset or another export.
    """
    if path.is_symlink() and not path.exists():
        raise InputError(f"`output` {path}: is a link to {path.readlink()}, which is not there")
    if path.exists() and not path.is_dir():
        raise InputError(f"`output` {path}: is a file; name a folder")
    check_is_outside_datasets(path)
    check_is_outside_exports(path, may_be_one=True)
    if path.is_dir() and not is_export(path):
        own = path / STAGING_FOLDER
        if any(
            item != own or not _has_only_what_precedes_a_manifest(own) for item in path.iterdir()
        ):
            raise InputError(
                f"`output` {path}: holds files but no {EXPORT_FILE}, so not an export; delete it,"
                " or choose another folder"
            )


def _has_only_what_precedes_a_manifest(staging: Path) -> bool:
    """Return whether a folder has only the first files of an export without a manifest."""
    if staging.is_symlink() or not staging.is_dir():
        return False
    lock = staging.parent / LOCK_FILE
    return all(
        is_partial_folder(item) or (item == lock and _is_empty_file(item))
        for item in staging.iterdir()
    )


def _is_empty_file(path: Path) -> bool:
    return not path.is_symlink() and path.is_file() and path.stat().st_size == 0


def is_export(path: Path) -> bool:
    """Return whether a folder is an export's; RunError if it may not be read."""
    check_is_readable(path)
    return (path / EXPORT_FILE).is_file()


def verify_export(path: Path) -> tuple[list[FileProblem], ExportManifest]:
    """Compare every file of an export with its manifest, by size and checksum.

    Returns:
        The problems, and the manifest.

    Raises:
        InputError: The folder is no export.
        RunError: A file cannot be read.
    """
    manifest = ExportManifest.load(path)
    if manifest is None:
        raise InputError(f"{path}: no {EXPORT_FILE} in it, so not an export")
    if is_locked(path / LOCK_FILE):
        return [FileProblem(path, "", "being written")], manifest
    entries = _read_journal(path)
    _, records = _merge(manifest, entries)
    unmoved = {name: record for entry in entries for name, record in entry.files.items()}
    found = {
        name
        for name in list_files(path, map(str, _list_folders([*records, *unmoved])))
        if name != EXPORT_FILE and not name.startswith(f"{STAGING_FOLDER}/")
    }
    problems = compare_with_records(
        path,
        records,
        found,
        lambda name, record: matches_record(path / name, record),
        unfinished=list_matching_files(path, found - records.keys(), unmoved),
    )
    return problems, manifest


def _list_folders(paths: Iterable[str]) -> set[Path]:
    """List the folders with files within an export, and their parents."""
    return {folder for path in paths for folder in Path(path).parents} - {Path()}


def _read_journal(folder: Path) -> list[_JournalEntry]:
    """Read all whole lines of the journal; the last may be torn."""
    path, raw = folder / JOURNAL_FILE, b""
    with suppress(*NO_FILE_ERRORS):
        raw = read_bytes(path, max_bytes=MAX_JSON_BYTES)
    entries: list[_JournalEntry] = []
    with suppress(InputError, ValidationError):
        for line in raw.splitlines():
            entries.append(_JournalEntry.model_validate(parse_json(line, path)))
    return entries


def _merge(
    manifest: ExportManifest, entries: Iterable[_JournalEntry]
) -> tuple[dict[str, str], dict[str, ExportRecord]]:
    """Merge the journal into the manifest: inputs by piece, and records by path."""
    moved = [entry for entry in entries if entry.moved]
    pieces = manifest.pieces | {entry.piece: entry.inputs for entry in moved}
    files: dict[str, ExportRecord] = dict(manifest.files)
    for entry in moved:
        files |= entry.list_records()
    return pieces, files


def _name_piece(records: Mapping[str, FileRecord], piece: str) -> dict[str, ExportRecord]:
    return {
        path: ExportRecord(size=record.size, sha256=record.sha256, piece=piece)
        for path, record in records.items()
    }
