"""The command line itself and all its commands."""

from typing import Annotated

import typer

from advercity.cli import authoring, datasets, running
from advercity.cli.assets import assets
from advercity.cli.output import print_data

app = typer.Typer(
    name="advercity",
    help="Adverse-weather V2X driving data, compiled from YAML.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
for part in (authoring, running, datasets):
    app.registered_commands += part.commands.registered_commands
app.add_typer(assets)


@app.command()
def doctor() -> None:
    """Tell what this machine has and what is missing."""
    from advercity.cli.doctor import check_machine

    text, healthy = check_machine()
    print_data(text)
    if not healthy:
        raise typer.Exit(1)


@app.callback(invoke_without_command=True)
def version(
    show_version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False,
) -> None:
    """Adverse-weather V2X driving data, compiled from YAML."""
    if show_version:
        from advercity import __version__

        print_data(__version__)
        raise typer.Exit
