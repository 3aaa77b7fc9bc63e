"""A scenario that is made in parts, by several machines, in a store that they share.

A part is frames and a manifest of them; parts lie beside the scenario until it is whole. So what is
done is known however its makers ended, and the scenario ends with the bytes that one machine alone
would have written.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from advercity_dsl import Spec

from advercity.dataset.beside_frames import beside_frames
from advercity.dataset.journal import FileRecord
from advercity.dataset.manifest import MANIFEST, Identity, Manifest
from advercity.dataset.store import Store
from advercity.errors import RunError


def add_part(store: Store, scenario: Path) -> None:
    """Add what a folder holds of a scenario: its files, and then that they are there."""
    manifest = Manifest.load(scenario)
    for path, record in manifest.files.items():
        if record.frame is not None:
            store.upload(scenario, path, scenario.name)
    first, last = manifest.frames[0], manifest.frames[-1]
    name = f"{_parts_of(scenario.name)}/{first:06d}_{last:06d}.json"
    store.write(name, manifest.to_json().encode())


@dataclass(frozen=True)
class Parts:
    """A scenario as it grows in a store.

    Attributes:
        store: Where.
        spec: What it is made from.
        identity: What decides its bytes.
        length: Frames of the whole scenario.
    """

    store: Store
    spec: Spec
    identity: Identity
    length: int

    def begin(self, *, fresh: bool) -> dict[str, FileRecord]:
        """Records of the frames that are done, by path.

        Raises:
            RunError: They are of another identity, or the folder holds something else.
        """
        name = self.spec.id
        found = self._found()
        if not found and self.store.paths(name):
            raise RunError(
                f"{name}: holds files but no {MANIFEST}, so not a dataset; delete"
                " it, or choose another --output"
            )
        if fresh:
            self.store.remove(name)
            self.store.remove(_parts_of(name))
            found = []
        records = self._records(found)
        self._save(records)
        return records

    def finish(self) -> Manifest:
        """Write the manifest of all parts, and remove what no frame needs.

        Raises:
            RunError: A part was made by other code or on another device.
        """
        name = self.spec.id
        manifest = self._save(self._records(self._found()))
        for path in self.store.paths(name):
            _, _, inside = path.partition("/")
            if inside not in manifest.files and _is_of_a_frame(inside):
                self.store.remove(path)
        self.store.remove(_parts_of(name))
        return manifest

    def _save(self, frames: dict[str, FileRecord]) -> Manifest:
        beside = beside_frames(self.spec, self.identity)
        for path, content in beside.items():
            self.store.write(f"{self.spec.id}/{path}", content)
        files = frames | {path: FileRecord.of(content) for path, content in beside.items()}
        manifest = Manifest.of(self.identity, self.spec, length=self.length, files=files)
        self.store.write(f"{self.spec.id}/{MANIFEST}", manifest.to_json().encode())
        return manifest

    def _found(self) -> list[Manifest]:
        """The manifest, if there is one, and those of parts."""
        paths = [f"{self.spec.id}/{MANIFEST}", *self.store.paths(_parts_of(self.spec.id))]
        texts = [(path, self.store.read(path)) for path in paths]
        return [Manifest.parse(text, where=path) for path, text in texts if text is not None]

    def _records(self, found: Iterable[Manifest]) -> dict[str, FileRecord]:
        files: dict[str, FileRecord] = {}
        for manifest in found:
            differences = manifest.identity.differences(self.identity)
            if differences:
                raise RunError(
                    f"{self.spec.id}: made from something else ({'; '.join(differences)});"
                    " --fresh starts over; machines that share a scenario have the same versions"
                    " and devices"
                )
            files |= {p: record for p, record in manifest.files.items() if record.frame is not None}
        return files


def _parts_of(name: str) -> str:
    return f".staging/{name}"


def _is_of_a_frame(path: str) -> bool:
    """As `<agent>/<six digits>...`; other files may be precious."""
    _, _, name = path.rpartition("/")
    return "/" in path and name[:6].isdigit()
