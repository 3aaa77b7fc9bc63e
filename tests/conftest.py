"""Fixtures that many tests share."""

from pathlib import Path

import pytest
from advercity_dsl import Spec

from advercity.compiler import compile_library

ROOT = Path(__file__).parent.parent


@pytest.fixture(scope="session")
def library() -> Path:
    """The library that ships with the project."""
    return ROOT / "library"


@pytest.fixture(scope="session")
def specs(library: Path) -> dict[str, Spec]:
    """Every spec of the shipped library, by id."""
    return {spec.id: spec for spec in compile_library(library)}
