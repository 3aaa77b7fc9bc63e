"""Arguments and options of several commands, and the values that people write in them."""

import re
from pathlib import Path
from typing import Annotated

import typer

from advercity.errors import InputError

LibraryArgument = Annotated[list[Path], typer.Argument(help="Folders of declarations.")]
DEFAULT_LIBRARIES = [Path("library")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON.")]
SpecArgument = Annotated[list[Path], typer.Argument(help="Compiled specs (*.json).")]
DatasetArgument = Annotated[Path, typer.Argument(help="A dataset, or one scenario of it.")]
LayoutOption = Annotated[
    str | None,
    typer.Option(
        help="Layout of a folder of others, without manifests: opv2v (also V2XSet and V2V4Real) or"
        " adver_city."
    ),
]
BackendOption = Annotated[str, typer.Option(help="Rendering backend.")]
AutoBackendOption = Annotated[
    str,
    typer.Option(help="Rendering backend; auto is sapien, or mitsuba for full without a GPU."),
]
ProfileOption = Annotated[str, typer.Option(help="auto, preview or full.")]
ScaleOption = Annotated[
    float | None,
    typer.Option(
        help="Fraction of the rig's image width and height, in place of the profile's"
        " (preview: 0.25, full: 1)."
    ),
]
WeatherLibraryOption = Annotated[
    list[Path] | None,
    typer.Option(
        "--library", help="Folders of the library with the weather (default: the shipped one)."
    ),
]
FramesOption = Annotated[
    str | None, typer.Option(metavar="A:B[:STEP]", help="Recorded frames to make, B not included.")
]
JobsOption = Annotated[
    int | None,
    typer.Option(
        min=1,  # and `MAX_JOBS`, whose module takes too long to load
        max=1000,
        help="Processes at a time (default: as many as suit the machine).",
    ),
]
AllowMissedOption = Annotated[
    bool,
    typer.Option(
        "--allow-missed",
        help="Go on where a staged conflict does not happen as declared, and record it.",
    ),
]
AllowMissingModelsOption = Annotated[
    bool,
    typer.Option(
        "--allow-missing-models", help="Generate bodies in place of models that are not installed."
    ),
]
MapTilesOption = Annotated[
    bool,
    typer.Option("--map-tiles", help="Show receivers on a map, with tiles from the Internet."),
]
CloudColourOption = Annotated[
    str,
    typer.Option(
        "--cloud-colour",
        metavar="intensity|class|kind",
        help="Meaning of the colours of LiDAR points; kind is the source of the return.",
    ),
]


def split_names(text: str) -> list[str]:
    """Split names at commas, without blanks around them; of an empty text there are none."""
    return [name.strip() for name in text.split(",")] if text.strip() else []


def parse_frame_slice(text: str | None) -> slice:
    """Parse `A:B[:STEP]`, where A and B may be left out; None is every frame."""
    from advercity.pipeline.options import check_frames

    if text is None:
        return slice(None)
    match = re.fullmatch(r"([0-9]{0,9}):([0-9]{0,9})(?::([0-9]{1,9}))?", text)
    if match is None:
        raise InputError(f"--frames {text}: not a range; write A:B or A:B:STEP, as 0:30")
    first, last, step = (int(part) if part else None for part in match.groups())
    frames = slice(first, last, step)
    check_frames(frames)
    return frames
