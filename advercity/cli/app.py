"""The command line with all its commands, and where renamed commands and options are found now."""

from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from advercity.cli import authoring, datasets, running
from advercity.cli.assets import assets
from advercity.cli.cache import cache
from advercity.cli.output import exit_with_error, print_data
from advercity.errors import InputError, RunError

RENAMED_COMMANDS = {"plan": "estimate"}
RENAMED_OPTIONS = {
    ("run", "--address"): "--ray-address",
    ("run", "--colour-clouds"): "--cloud-colour",
    ("view", "--colour-clouds"): "--cloud-colour",
    ("simulate", "--film"): "--video",
    ("simulate", "--no-film"): "--no-video",
    ("simulate", "--table"): "--markdown",
    ("install", "--optional"): "--allow-failure",
}
"""New names of options, by command and old name."""


class RenamingGroup(TyperGroup):
    """Answers an old name with the new one, as bad input."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find the command that the arguments name."""
        if args[0] in RENAMED_COMMANDS:
            raise InputError(f"{args[0]} is now {RENAMED_COMMANDS[args[0]]}")
        return super().resolve_command(ctx, args)

    def invoke(self, ctx: Any) -> Any:
        """Run the command."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as interrupt:
            exit_with_error(RunError("; ".join(["interrupted", *interrupt.args])), exit_code=130)
        except Exception as error:
            # Typer does not export the error for an unknown option, which has these attributes.
            command = str(getattr(getattr(error, "ctx", None), "info_name", ""))
            option = str(getattr(error, "option_name", ""))
            new = RENAMED_OPTIONS.get((command, option))
            if new is not None:
                raise InputError(f"{command} {option} is now {new}") from error
            raise


app = typer.Typer(
    name="advercity",
    cls=RenamingGroup,
    help="Adverse-weather V2X driving data, compiled from YAML.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
for part in (authoring, running, datasets):
    app.registered_commands += part.commands.registered_commands
app.add_typer(assets)
app.add_typer(cache)


@app.command()
def doctor() -> None:
    """Report what this machine has and what is missing."""
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
