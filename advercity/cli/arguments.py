"""Arguments and options of several commands, and the values that people write in them."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import typer

from advercity.errors import InputError

LibraryArgument = Annotated[list[Path], typer.Argument(help="Folders of declarations.")]
DEFAULT_LIBRARIES = [Path("library")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON.")]
SpecArgument = Annotated[list[Path], typer.Argument(help="Compiled specs (*.json).")]
DatasetArgument = Annotated[Path, typer.Argument(help="A dataset, or one scenario of it.")]
BackendOption = Annotated[str, typer.Option(help="Rendering backend.")]
ProfileOption = Annotated[str, typer.Option(help="auto, preview or full.")]
ScaleOption = Annotated[float | None, typer.Option(help="Image scale in place of the profile's.")]
FramesOption = Annotated[
    str | None, typer.Option(metavar="A:B[:STEP]", help="Recorded frames to make, B not included.")
]
JobsOption = Annotated[
    int | None,
    typer.Option(min=1, help="Processes at a time (default: as many as suit the machine)."),
]
CloudColourOption = Annotated[
    str,
    typer.Option(
        "--cloud-colour",
        metavar="intensity|class|kind",
        help="What the colours of LiDAR points show; kind is what returned the light.",
    ),
]

BYTES_PER_UNIT = {
    **{"B": 1, "kB": 10**3, "MB": 10**6, "GB": 10**9, "TB": 10**12},
    **{"KiB": 2**10, "MiB": 2**20, "GiB": 2**30, "TiB": 2**40},
}
SECONDS_PER_UNIT = {"s": 1, "min": 60, "h": 3600, "d": 86_400}


def parse_frame_slice(text: str | None) -> slice:
    """Parse `A:B[:STEP]`, where A and B may be left out; None is every frame."""
    if text is None:
        return slice(None)
    match = re.fullmatch(r"(\d*):(\d*)(?::(\d+))?", text)
    if match is None:
        raise InputError(f"--frames {text}: not a range; write A:B or A:B:STEP, as 0:30")
    first, last, step = (int(part) if part else None for part in match.groups())
    return slice(first, last, step)


def parse_byte_size(option: str, text: str) -> int:
    """Parse a text such as `4 GB` as bytes; InputError names the option if it is none."""
    return int(_parse_quantity(option, text, BYTES_PER_UNIT, "4 GB"))


def parse_duration(option: str, text: str) -> float:
    """Parse a text such as `90 min` as seconds; InputError names the option if it is none."""
    return _parse_quantity(option, text, SECONDS_PER_UNIT, "90 min")


def _parse_quantity(option: str, text: str, units: Mapping[str, int], example: str) -> float:
    match = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*([A-Za-z]+)\s*", text)
    if match is None or match[2] not in units or not float(match[1]):
        raise InputError(
            f"{option} {text}: not a positive number with a unit"
            f" ({', '.join(units)}); write {example}"
        )
    return float(match[1]) * units[match[2]]
