"""Scenarios in a shared store: made in parts by several machines, and verified there.

A part is a number of frames and a manifest of them. The manifests of parts are in the staging
folder until the scenario is complete, so finished parts are known however a machine ended, and the
scenario ends with the same bytes as on a single machine.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from advercity_dsl import Spec

from advercity.dataset.formats import FrameFileNames
from advercity.dataset.index import EMPTY_INDEX, INDEX_FILE, DatasetIndex
from advercity.dataset.manifest import Identity, Manifest
from advercity.dataset.partial_files import FileRecord
from advercity.dataset.scenario_folders import MANIFEST_FILE, no_dataset_to_replace_error
from advercity.dataset.store import DatasetStore
from advercity.dataset.verification import FileProblem, compare_with_records
from advercity.dataset.writer import SCENARIO_FILES, encode_scenario_files
from advercity.errors import InputError, RunError

BEGUN_SUFFIX = ".begun"
"""End of the name of a part's manifest while its frames are uploaded."""


def upload_part(store: DatasetStore, scenario: Path) -> None:
    """Upload the frames in a scenario's folder, and then the manifest listing them."""
    manifest = Manifest.load(scenario)
    first, last = manifest.frames[0], manifest.frames[-1]
    name = f"{_format_parts_folder(scenario.name)}/{first:06d}_{last:06d}.json"
    text = manifest.to_json().encode()
    # If the machine stops before the end, these identify its own files.
    store.write(f"{name}{BEGUN_SUFFIX}", text)
    for path, record in manifest.files.items():
        if record.frame is not None:
            store.write(f"{scenario.name}/{path}", (scenario / path).read_bytes())
    store.write(name, text)
    store.remove(f"{name}{BEGUN_SUFFIX}")


@dataclass(frozen=True)
class SharedScenario:
    """A scenario in a store, written by several machines.

    Attributes:
        store: The store of the dataset.
        spec: The spec.
        identity: The inputs of the bytes.
        length: Number of frames of the whole scenario.
    """

    store: DatasetStore
    spec: Spec
    identity: Identity
    length: int

    def begin(self, *, fresh: bool) -> dict[str, FileRecord]:
        """Write the manifest of the finished frames, and return their records by path.

        Raises:
            RunError: The frames are of another identity, or the folder holds something else.
        """
        name = self.spec.id
        found = self._read_manifests()
        if not found and self.store.list_files(name):
            raise no_dataset_to_replace_error(name)
        merged = {} if fresh else self._merge_records(found)
        records = self._select_whole_frames(merged)
        self._remove_recorded({path: merged[path] for path in merged.keys() - records.keys()})
        self._remove_unfinished(records)
        if fresh:
            self._clear(found)
        own = encode_scenario_files(self.spec, self.identity)
        self._check_places_are_free(records, [manifest.files for manifest in found], own)
        # The manifest first: a folder with files but without one counts as a user's.
        self._save(records, own)
        for path, content in own.items():
            self.store.write(f"{name}/{path}", content)
        return records

    def finish(self, made: Iterable[int] = ()) -> Manifest:
        """Write the manifest of all parts, and delete unlisted files of frames.

        Args:
            made: Frames made here.

        Raises:
            RunError: A part differs in code or device, or files of a frame in `made` are gone.
        """
        own = encode_scenario_files(self.spec, self.identity)
        records = self._select_whole_frames(self._merge_records(self._read_manifests()))
        for path in own.keys() - set(self._list_files()):
            self.store.write(f"{self.spec.id}/{path}", own[path])
        manifest = self._save(records, own)
        self._remove_unfinished(manifest.files)
        self._remove_parts()
        gone = set(made) - set(manifest.frames)
        if gone:
            raise RunError(
                f"{self.spec.id}: files of {len(gone)} frames are gone from the output since they"
                " were written; stop the program deleting them, and run again"
            )
        return manifest

    def _select_whole_frames(self, records: dict[str, FileRecord]) -> dict[str, FileRecord]:
        """Select the records of the frames whose files are all there."""
        there = set(self._list_files())
        torn = {record.frame for path, record in records.items() if path not in there}
        return {path: record for path, record in records.items() if record.frame not in torn}

    def _remove_unfinished(self, finished: Mapping[str, FileRecord]) -> None:
        """Delete parts uploaded by machines before they stopped, by their content."""
        begun = filter(_is_begun, _list_parts(self.store, self.spec.id))
        for manifest in _read_manifests(self.store, begun):
            numbered = _select_frame_records(manifest)
            left = {path: record for path, record in numbered.items() if path not in finished}
            self._remove_recorded(left)

    def _remove_recorded(self, records: Mapping[str, FileRecord]) -> list[str]:
        """Delete files with their recorded content, and return the paths of all others."""
        others: list[str] = []
        for path in sorted(records.keys() & set(self._list_files())):
            place = f"{self.spec.id}/{path}"
            content = self.store.read(place)
            if content is not None and records[path].has_content(content):
                self.store.remove(place)
            elif content is not None:
                others.append(path)
        return others

    def _check_places_are_free(
        self,
        finished: Mapping[str, FileRecord],
        found: Iterable[Mapping[str, FileRecord]],
        own: Mapping[str, bytes],
    ) -> None:
        """Raise a RunError if a foreign file has the path of a file of the run."""
        names = FrameFileNames(self.spec, self.identity.format, self.length)
        known = [*found, _record_contents(own)]
        for inside in self._list_files():
            is_of_frame = inside not in finished and names.find_frame(inside) is not None
            if is_of_frame or (inside in own and not self._is_recorded(inside, known)):
                raise self._file_of_others_error(inside)

    def _is_recorded(self, path: str, known: Iterable[Mapping[str, FileRecord]]) -> bool:
        content = self.store.read(f"{self.spec.id}/{path}") or b""
        return any(path in records and records[path].has_content(content) for records in known)

    def _file_of_others_error(self, path: str) -> RunError:
        return RunError(
            f"{self.spec.id}/{path}: is of no run, in the place of a file of one; rename or"
            " delete it"
        )

    def _clear(self, found: Iterable[Manifest]) -> None:
        """Delete files written by runs, by content; the new manifest replaces theirs."""
        for manifest in found:
            own = {
                path: record
                for path, record in manifest.files.items()
                if record.frame is not None or path in SCENARIO_FILES
            }
            for path in self._remove_recorded(own):
                raise self._file_of_others_error(path)
        self._remove_parts()

    def _remove_parts(self) -> None:
        """Delete the manifests of parts, and their folder unless it has foreign files."""
        for path in _list_parts(self.store, self.spec.id):
            self.store.remove(path)
        folder = _format_parts_folder(self.spec.id)
        if not self.store.list_files(folder):
            self.store.remove(folder)

    def _list_files(self) -> list[str]:
        name = self.spec.id
        return [path.removeprefix(f"{name}/") for path in self.store.list_files(name)]

    def _save(self, frames: Mapping[str, FileRecord], own: Mapping[str, bytes]) -> Manifest:
        """Write the manifest of these frames and the scenario's own files."""
        files = {**frames, **_record_contents(own)}
        manifest = Manifest.from_files(self.identity, self.spec, length=self.length, files=files)
        self.store.write(f"{self.spec.id}/{MANIFEST_FILE}", manifest.to_json().encode())
        return manifest

    def _read_manifests(self) -> list[Manifest]:
        """Read the manifests of the scenario, if there is one, and of its parts."""
        parts = [part for part in _list_parts(self.store, self.spec.id) if not _is_begun(part)]
        return _read_manifests(self.store, [f"{self.spec.id}/{MANIFEST_FILE}", *parts])

    def _merge_records(self, found: Iterable[Manifest]) -> dict[str, FileRecord]:
        files: dict[str, FileRecord] = {}
        for manifest in found:
            manifest.identity.check_same(
                self.identity,
                self.spec.id,
                remedy="`fresh` starts over; machines sharing a scenario need the same versions"
                " and devices",
            )
            files |= _select_frame_records(manifest)
        return files


def _record_contents(files: Mapping[str, bytes]) -> dict[str, FileRecord]:
    return {path: FileRecord.from_content(content) for path, content in files.items()}


def _select_frame_records(manifest: Manifest) -> dict[str, FileRecord]:
    return {path: record for path, record in manifest.files.items() if record.frame is not None}


def _list_parts(store: DatasetStore, name: str) -> list[str]:
    """List the manifests of a scenario's parts, finished and begun ones."""
    pattern = rf"[0-9]{{6,}}_[0-9]{{6,}}\.json({re.escape(BEGUN_SUFFIX)})?"
    listed = store.list_files(_format_parts_folder(name))
    return [path for path in listed if re.fullmatch(pattern, path.split("/")[-1])]


def _read_manifests(store: DatasetStore, paths: Iterable[str]) -> list[Manifest]:
    texts = [(path, store.read(path)) for path in paths]
    return [Manifest.parse(text, where=path) for path, text in texts if text is not None]


def _is_begun(part: str) -> bool:
    return part.endswith(BEGUN_SUFFIX)


def _format_parts_folder(name: str) -> str:
    return f".staging/{name}"


def verify_store(url: str) -> list[FileProblem]:
    """Verify a dataset in a store as `verify_dataset` does in a folder; every file is fetched.

    Raises:
        InputError: The store cannot be opened, or holds no dataset.
        RunError: A manifest or the index is damaged.
    """
    store = DatasetStore(url)
    text = store.read(INDEX_FILE)
    index = EMPTY_INDEX if text is None else DatasetIndex.parse(text, where=f"{url}/{INDEX_FILE}")
    paths, suffix = store.list_files(""), f"/{MANIFEST_FILE}"
    names = [path.removesuffix(suffix) for path in paths if path.endswith(suffix)]
    expected = index.list_with_manifest(lambda name: any(p.startswith(f"{name}/") for p in paths))
    if not names and not expected:
        raise InputError(f"{url}: no {MANIFEST_FILE} in its folders, so not a dataset")
    missing = [name for name in expected if name not in names]
    problems = [FileProblem(Path(name), MANIFEST_FILE, "missing") for name in missing]
    for name in names:
        problems += _verify_stored_scenario(store, index, name, paths)
    return problems


def _verify_stored_scenario(
    store: DatasetStore, index: DatasetIndex, name: str, paths: list[str]
) -> list[FileProblem]:
    def matches(path: str, record: FileRecord) -> bool:
        return record.has_content(store.read(f"{name}/{path}") or b"")

    text = store.read(f"{name}/{MANIFEST_FILE}") or b""
    own = [path.removeprefix(f"{name}/") for path in paths if path.startswith(f"{name}/")]
    manifest = Manifest.parse(text, where=f"{name}/{MANIFEST_FILE}")
    unlisted = set(own) - manifest.files.keys()
    unfinished = {
        path
        for part in _read_manifests(store, _list_parts(store, name))
        for path, record in _select_frame_records(part).items()
        if path in unlisted and matches(path, record)
    }
    problems = compare_with_records(
        Path(name), manifest.files, {*own} - {MANIFEST_FILE}, matches, unfinished=unfinished
    )
    if not index.matches_manifest(name, text):
        problems.insert(0, FileProblem(Path(name), MANIFEST_FILE, "changed"))
    return problems
