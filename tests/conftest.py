"""Fixtures that many tests share."""

from pathlib import Path

import pytest
from hypothesis import settings

pytest_plugins = ["tests.bend_network", "tests.builders"]

ROOT = Path(__file__).parent.parent

# How long an example takes says more about the machine than about the result.
settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")


@pytest.fixture(scope="session")
def library() -> Path:
    """The library that ships with the project."""
    return ROOT / "library"
