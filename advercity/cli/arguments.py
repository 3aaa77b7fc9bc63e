"""Arguments and options that several commands share."""

from pathlib import Path
from typing import Annotated

import typer

LibraryArgument = Annotated[list[Path], typer.Argument(help="Folders of declarations.")]
DEFAULT_LIBRARIES = [Path("library")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON.")]
SpecArgument = Annotated[list[Path], typer.Argument(help="Compiled specs (*.json).")]
DatasetArgument = Annotated[Path, typer.Argument(help="A dataset, or one scenario of it.")]
BackendOption = Annotated[str, typer.Option(help="Rendering backend.")]
ProfileOption = Annotated[str, typer.Option(help="auto, preview or full.")]
ScaleOption = Annotated[float | None, typer.Option(help="Image scale, over the profile's.")]
FramesOption = Annotated[
    str | None, typer.Option(metavar="A:B[:STEP]", help="Kept frames to make, B not included.")
]
JobsOption = Annotated[
    int | None,
    typer.Option(min=1, help="Processes at a time; as many as suit the machine."),
]
CloudColourOption = Annotated[
    str,
    typer.Option(
        "--colour-clouds", help="What colours of points show: intensity, class or kind of echo."
    ),
]
