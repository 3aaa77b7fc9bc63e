"""The formats of exports, by name."""

import difflib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any

from advercity.dataset.reader import Dataset
from advercity.errors import InputError
from advercity.exports.pieces import Piece

Options = Mapping[str, str]
"""Values of all options of a format, by name."""
PieceLister = Callable[[Dataset, Options], list[Piece]]
"""Splits a dataset into pieces; InputError if it lacks data for the format."""


@dataclass(frozen=True)
class ExportFormat:
    """A format.

    Attributes:
        name: Its name on the command line.
        module: Module of the package `advercity.exports` with its `list_pieces`; it is imported
            when the format is used, with its libraries.
        options: Possible values of its options by name; the first is taken unless another is named.
    """

    name: str
    module: str
    options: Mapping[str, tuple[str, ...]] = field(default_factory=dict[str, tuple[str, ...]])

    def load(self) -> PieceLister:
        """Load the function for splitting a dataset into pieces."""
        module: Any = import_module(f"advercity.exports.{self.module}")
        return module.list_pieces

    def complete_options(self, given: Mapping[str, str | None]) -> dict[str, str]:
        """Complete options by their defaults, also in place of None.

        Raises:
            InputError: The format has no such option, or it has no such value.
        """
        chosen = {name: values[0] for name, values in self.options.items()}
        for name, value in given.items():
            if value is None:
                continue
            if name not in self.options:
                raise InputError(f"`{name}` {value}: {self.name} has no such option")
            if value not in self.options[name]:
                raise InputError(f"`{name}` {value}: {' or '.join(self.options[name])}")
            chosen[name] = value
        return chosen


EXPORT_FORMATS = {
    one.name: one
    for one in (
        ExportFormat("adver_city", "adver_city"),
        ExportFormat("calibration", "calibration"),
        ExportFormat("coco", "coco"),
        ExportFormat("croissant", "croissant"),
        ExportFormat("kitti", "kitti"),
        ExportFormat("mcap", "mcap_recording", {"schemas": ("foxglove", "ros2")}),
        ExportFormat("nuscenes", "nuscenes", {"key_frames": ("all", "2hz")}),
        ExportFormat("openlabel", "openlabel"),
        ExportFormat("openscenario", "openscenario"),
        ExportFormat("osi", "osi_trace"),
        ExportFormat("v2xr", "v2xr"),
        ExportFormat("webdataset", "webdataset_shards"),
    )
}


def find_export_format(name: str) -> ExportFormat:
    """Return the format of a name; InputError with the nearest names if there is none."""
    if name in EXPORT_FORMATS:
        return EXPORT_FORMATS[name]
    close = difflib.get_close_matches(name.lower(), EXPORT_FORMATS, n=2, cutoff=0.5)
    hint = f"did you mean {' or '.join(close)}?" if close else f"{', '.join(EXPORT_FORMATS)}"
    raise InputError(f"{name}: no such format to export to; {hint}")
