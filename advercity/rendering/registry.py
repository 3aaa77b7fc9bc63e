"""Finds rendering backends by name; plugins register under the entry point `advercity.backends`."""

import difflib
from importlib.metadata import EntryPoint, entry_points

from advercity.errors import BackendError, InputError
from advercity.rendering.backend import Backend

GROUP = "advercity.backends"


def backend_names() -> list[str]:
    """Names of all installed backends; imports none of them."""
    return sorted({entry.name for entry in entry_points(group=GROUP)})


def load_backend(name: str) -> Backend:
    """The backend called `name`.

    Raises:
        InputError: No backend has that name.
        BackendError: It does not import, or two distributions claim the name.
    """
    found = [entry for entry in entry_points(group=GROUP) if entry.name == name]
    if not found:
        raise InputError(_unknown(name))
    if len({entry.value for entry in found}) > 1:
        claims = ", ".join(sorted(entry.value for entry in found))
        raise BackendError(f"backend '{name}' is claimed by {claims}; uninstall all but one")
    return _instance(found[0])


def _instance(entry: EntryPoint) -> Backend:
    try:
        return entry.load()()
    except ImportError as error:
        message = f"backend '{entry.name}' ({entry.value}) does not import: {error}"
        raise BackendError(message) from error


def _unknown(name: str) -> str:
    installed = backend_names()
    close = difflib.get_close_matches(name, installed, n=1)
    if close:
        return f"no backend '{name}'; did you mean '{close[0]}'?"
    if not installed:
        return f"no backend '{name}'; none is installed; try: pip install advercity-sapien"
    return f"no backend '{name}'; installed: {', '.join(installed)}"
