"""Commands for the shipped library."""

from pathlib import Path
from typing import Annotated

import typer

from advercity.cli.output import print_data

library = typer.Typer(
    name="library",
    help="The shipped library of declarations.",
    no_args_is_help=True,
    rich_markup_mode=None,
)


@library.command()
def copy(
    folder: Annotated[Path, typer.Argument(help="Folder to make, for a library of your own.")],
) -> None:
    """Copy the shipped library, to change it."""
    from advercity.compiler.shipped_library import copy_shipped_library

    print_data(str(copy_shipped_library(folder)))


@library.command()
def path() -> None:
    """Print the folder of the shipped library."""
    from advercity.compiler import find_shipped_library

    print_data(str(find_shipped_library()))
