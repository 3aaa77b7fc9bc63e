"""advercity: adverse-weather V2X driving data, compiled from YAML."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from advercity.dataset.reader import open_dataset

__version__ = "0.1.0"


def __getattr__(name: str) -> object:
    """`open_dataset`, imported when it is wanted: the command line starts faster without."""
    if name == "open_dataset":
        from advercity.dataset.reader import open_dataset

        return open_dataset
    raise AttributeError(f"module 'advercity' has no attribute {name!r}")


__all__ = ["__version__", "open_dataset"]
