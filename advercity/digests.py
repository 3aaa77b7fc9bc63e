"""Digests of data and of source code, which distinguish programs of the same version."""

import functools
import hashlib
import json
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np


def compute_json_digest(data: Any, *, sort_keys: bool = True) -> str:
    """Compute the SHA-256 of plain data as canonical JSON; `sort_keys` ignores their order."""
    text = json.dumps(data, sort_keys=sort_keys, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


@functools.cache
def compute_rounding_digest() -> str:
    """Compute the SHA-256 of fixed products and functions, whose last bits differ by machine.

    OpenBLAS, NumPy and glibc select their loops by the processor. Loops with the same results have
    the same digest. Products are too small for OpenBLAS to share them among threads.
    """
    digest = hashlib.sha256()
    for kind in (np.float64, np.float32):
        table = (np.arange(1, 1025).reshape(32, 32) ** 0.5 / 10).astype(kind)
        products = (
            *(table @ table.T, table[:, :3] @ table[:3, :3], table[:4, :4] @ table[:4, :4]),
            *(table @ table[0], table[0] @ table[1], np.linalg.solve(table[:3, :3], table[:3, 0])),
        )
        functions = np.exp, np.log, np.sin, np.cos, np.tan, np.tanh, np.arctan, np.cbrt
        pairs = np.arctan2(table, table.T), table**table.T, np.abs(table + 1j * table.T)
        for result in (*products, *(function(table) for function in functions), *pairs):
            digest.update(result.tobytes())
    return digest.hexdigest()


EXCLUDED_NAMES = {"__pycache__", "_library"}
"""Byte code, and the library of a wheel, whose declarations each spec records itself."""


@functools.cache
def compute_source_digest(*modules: str) -> str:
    """Compute the SHA-256 of all files of packages or single-file modules, given by name.

    It is the same for an installation and for a checkout.
    """
    digest = hashlib.sha256()
    for name in modules:
        for path, inside in _list_module_files(name):
            digest.update(f"{inside}\0".encode())
            digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()


def _list_module_files(name: str) -> list[tuple[Path, str]]:
    """Return the sorted files of a module, each with its path relative to the module's parent."""
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
