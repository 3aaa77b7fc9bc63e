"""Digests of code: what tells whether two programs of one version number are the same."""

import functools
import hashlib
import json
from importlib import import_module
from pathlib import Path
from typing import Any


def compute_json_digest(data: Any) -> str:
    """SHA-256 of plain data in canonical JSON."""
    text = json.dumps(data, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


EXCLUDED_NAMES = {"__pycache__", "_library"}
"""Byte code, and declarations that come with a wheel: what of them counts stands in each spec."""


@functools.cache
def compute_source_digest(*modules: str) -> str:
    """SHA-256 of all files of packages, or of modules that are one file, by their names.

    The same whether they are installed or lie in a checkout.
    """
    digest = hashlib.sha256()
    for name in modules:
        for path, inside in _module_files(name):
            digest.update(f"{inside}\0".encode())
            digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()


def _module_files(name: str) -> list[tuple[Path, str]]:
    """Files of a module, sorted, each with its path below where the module lies."""
    module = import_module(name)
    folders = [Path(folder) for folder in getattr(module, "__path__", ())]
    if not folders and module.__file__ is not None:
        return [(Path(module.__file__), name)]
    return [
        (path, f"{name}/{path.relative_to(folder).as_posix()}")
        for folder in folders
        for path in sorted(folder.rglob("*"))
        if path.is_file() and EXCLUDED_NAMES.isdisjoint(path.relative_to(folder).parts)
    ]
