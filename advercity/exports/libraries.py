"""Libraries of others that formats are written with, which `advercity[export]` installs."""

from importlib import import_module
from typing import Any

from advercity.errors import InputError


def load_library(name: str, format: str) -> Any:
    """Import a module; InputError that says how to install it if it is missing."""
    try:
        return import_module(name)
    except ImportError:
        raise InputError(
            f"{format} is written with {name.partition('.')[0]}, which is not installed;"
            " `pip install advercity[export]`"
        ) from None
