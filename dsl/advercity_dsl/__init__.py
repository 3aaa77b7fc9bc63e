"""Models of the declaration language and of the compiled spec.

The package depends on pydantic alone; it imports neither simulator nor renderer.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from advercity_dsl.language import *  # noqa: F403


def __getattr__(name: str) -> Any:
    """Return a name of `language`, loaded at the first use.

    Rigs load the kinds of sensors of other distributions. The module of such a kind may be the
    first to import this package.
    """
    return getattr(import_module("advercity_dsl.language"), name)
