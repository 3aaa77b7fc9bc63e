"""Fixtures of the compiler's tests: the small library of `base`, written or compiled."""

import shutil
from pathlib import Path

import pytest
from advercity_dsl import Spec

from advercity.compiler.crossing import compile_library
from tests.builders import Compile, Write, write_small_library


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """Writes the small library with more files, or others in place of its own."""

    def write_library(**files: str) -> Path:
        folder = tmp_path / "library"
        shutil.rmtree(folder, ignore_errors=True)
        return write_small_library(folder, **files)

    return write_library


@pytest.fixture
def compile_small(write: Write) -> Compile:
    """Compiles the small library with more files, or others in place of its own."""

    def compile_library_with(**files: str) -> dict[str, Spec]:
        return {spec.id: spec for spec in compile_library(write(**files))}

    return compile_library_with
