"""Third-party libraries for writing formats, installed by `advercity[export]`."""

from importlib import import_module
from typing import Any

from advercity.errors import InputError


def load_library(name: str, format: str) -> Any:
    """Import a module; if it is missing, an InputError explains its installation."""
    try:
        return import_module(name)
    except ImportError:
        raise InputError(
            f"{format} is written with {name.partition('.')[0]}, which is not installed;"
            " `pip install advercity[export]`"
        ) from None
