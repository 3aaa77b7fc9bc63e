"""Verifying a dataset that lies in a store."""

import hashlib
from pathlib import Path

from advercity.dataset.index import INDEX, Index
from advercity.dataset.journal import FileRecord
from advercity.dataset.manifest import MANIFEST, Manifest
from advercity.dataset.store import Store
from advercity.dataset.verification import Problem, compare
from advercity.errors import InputError


def verify_store(url: str) -> list[Problem]:
    """What `verify_dataset` tells of a folder; every file is fetched.

    Raises:
        InputError: Nothing reaches the store, or it holds no dataset.
        RunError: A manifest or the index is none.
    """
    store = Store(url)
    text = store.read(INDEX)
    index = Index() if text is None else Index.parse(text, where=f"{url}/{INDEX}")
    paths = store.paths("")
    names = [path.removesuffix(f"/{MANIFEST}") for path in paths if path.endswith(f"/{MANIFEST}")]
    if not names and not index.made:
        raise InputError(f"{url}: no {MANIFEST} in its folders, so not a dataset")
    gone = sorted(index.made - set(names))
    problems = [Problem(Path(name), MANIFEST, "missing") for name in gone]
    for name in names:
        problems += _of_scenario(store, index, name, paths)
    return problems


def _of_scenario(store: Store, index: Index, name: str, paths: list[str]) -> list[Problem]:
    text = store.read(f"{name}/{MANIFEST}") or b""
    own = [path.removeprefix(f"{name}/") for path in paths if path.startswith(f"{name}/")]

    def matches(path: str, record: FileRecord) -> bool:
        content = store.read(f"{name}/{path}") or b""
        return hashlib.sha256(content).hexdigest() == record.sha256

    changed = [] if index.agrees(name, text) else [Problem(Path(name), MANIFEST, "changed")]
    manifest = Manifest.parse(text, where=f"{name}/{MANIFEST}")
    return [*changed, *compare(Path(name), manifest, own, matches)]
