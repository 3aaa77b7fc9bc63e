"""Packages that some tests need."""

from typing import Any

import pytest


def require(module: str) -> Any:
    """Import a module, or skip the test and say what installs it."""
    return pytest.importorskip(module, reason=f"needs {module}; `make setup` installs it")
