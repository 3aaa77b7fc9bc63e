"""A scenario that is made in parts, by several machines, in a store that they share.

A part is frames and a manifest of them; parts lie beside the scenario until it is whole. So what is
done is known however its makers ended, and the scenario ends with the bytes that one machine alone
would have written.

Verifying a dataset that lies in a store.
"""

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from advercity_dsl import Spec

from advercity.dataset.formats import is_frame_file
from advercity.dataset.index import INDEX_FILE, DatasetIndex
from advercity.dataset.manifest import Identity, Manifest
from advercity.dataset.partial_files import FileRecord
from advercity.dataset.scenario_folders import MANIFEST_FILE
from advercity.dataset.store import DatasetStore
from advercity.dataset.verification import FileProblem, compare_with_manifest
from advercity.dataset.writer import encode_scenario_files
from advercity.errors import InputError, RunError


def upload_part(store: DatasetStore, scenario: Path) -> None:
    """Add what a folder holds of a scenario: its files, and then that they are there."""
    manifest = Manifest.load(scenario)
    for path, record in manifest.files.items():
        if record.frame is not None:
            store.upload(scenario, path, scenario.name)
    first, last = manifest.frames[0], manifest.frames[-1]
    name = f"{_parts_folder(scenario.name)}/{first:06d}_{last:06d}.json"
    store.write(name, manifest.to_json().encode())


@dataclass(frozen=True)
class SharedScenario:
    """A scenario as it grows in a store.

    Attributes:
        store: Where.
        spec: What it is made from.
        identity: What decides its bytes.
        length: Frames of the whole scenario.
    """

    store: DatasetStore
    spec: Spec
    identity: Identity
    length: int

    def begin(self, *, fresh: bool) -> dict[str, FileRecord]:
        """Records of the frames that are done, by path.

        Raises:
            RunError: They are of another identity, or the folder holds something else.
        """
        name = self.spec.id
        found = self._read_manifests()
        if not found and self.store.list_files(name):
            raise RunError(
                f"{name}: holds files but no {MANIFEST_FILE}, so not a dataset; delete"
                " it, or choose another --output"
            )
        if fresh:
            self.store.remove(name)
            self.store.remove(_parts_folder(name))
            found = []
        records = self._merge_records(found)
        self._save(records)
        return records

    def finish(self) -> Manifest:
        """Write the manifest of all parts, and remove what no frame needs.

        Raises:
            RunError: A part was made by other code or on another device.
        """
        name = self.spec.id
        manifest = self._save(self._merge_records(self._read_manifests()))
        for path in self.store.list_files(name):
            _, _, inside = path.partition("/")
            if inside not in manifest.files and is_frame_file(inside):
                self.store.remove(path)
        self.store.remove(_parts_folder(name))
        return manifest

    def _save(self, frames: dict[str, FileRecord]) -> Manifest:
        beside = encode_scenario_files(self.spec, self.identity)
        for path, content in beside.items():
            self.store.write(f"{self.spec.id}/{path}", content)
        files = frames | {
            path: FileRecord.from_content(content) for path, content in beside.items()
        }
        manifest = Manifest.from_files(self.identity, self.spec, length=self.length, files=files)
        self.store.write(f"{self.spec.id}/{MANIFEST_FILE}", manifest.to_json().encode())
        return manifest

    def _read_manifests(self) -> list[Manifest]:
        """The manifest, if there is one, and those of parts."""
        paths = [
            f"{self.spec.id}/{MANIFEST_FILE}",
            *self.store.list_files(_parts_folder(self.spec.id)),
        ]
        texts = [(path, self.store.read(path)) for path in paths]
        return [Manifest.parse(text, where=path) for path, text in texts if text is not None]

    def _merge_records(self, found: Iterable[Manifest]) -> dict[str, FileRecord]:
        files: dict[str, FileRecord] = {}
        for manifest in found:
            differences = manifest.identity.find_differences(self.identity)
            if differences:
                raise RunError(
                    f"{self.spec.id}: made from something else ({'; '.join(differences)});"
                    " --fresh starts over; machines that share a scenario have the same versions"
                    " and devices"
                )
            files |= {p: record for p, record in manifest.files.items() if record.frame is not None}
        return files


def _parts_folder(name: str) -> str:
    return f".staging/{name}"


def verify_store(url: str) -> list[FileProblem]:
    """What `verify_dataset` tells of a folder; every file is fetched.

    Raises:
        InputError: Nothing reaches the store, or it holds no dataset.
        RunError: A manifest or the index is none.
    """
    store = DatasetStore(url)
    text = store.read(INDEX_FILE)
    index = (
        DatasetIndex() if text is None else DatasetIndex.parse(text, where=f"{url}/{INDEX_FILE}")
    )
    paths = store.list_files("")
    names = [
        path.removesuffix(f"/{MANIFEST_FILE}")
        for path in paths
        if path.endswith(f"/{MANIFEST_FILE}")
    ]
    if not names and not index.present_scenarios:
        raise InputError(f"{url}: no {MANIFEST_FILE} in its folders, so not a dataset")
    gone = sorted(index.present_scenarios - set(names))
    problems = [FileProblem(Path(name), MANIFEST_FILE, "missing") for name in gone]
    for name in names:
        problems += _verify_stored_scenario(store, index, name, paths)
    return problems


def _verify_stored_scenario(
    store: DatasetStore, index: DatasetIndex, name: str, paths: list[str]
) -> list[FileProblem]:
    text = store.read(f"{name}/{MANIFEST_FILE}") or b""
    own = [path.removeprefix(f"{name}/") for path in paths if path.startswith(f"{name}/")]

    def matches(path: str, record: FileRecord) -> bool:
        content = store.read(f"{name}/{path}") or b""
        return hashlib.sha256(content).hexdigest() == record.sha256

    changed = (
        []
        if index.matches_manifest(name, text)
        else [FileProblem(Path(name), MANIFEST_FILE, "changed")]
    )
    manifest = Manifest.parse(text, where=f"{name}/{MANIFEST_FILE}")
    return [*changed, *compare_with_manifest(Path(name), manifest, own, matches)]
