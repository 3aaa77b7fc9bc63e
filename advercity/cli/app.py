"""The command line with all its commands, and the new names of commands and options."""

from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from advercity.cli import authoring, datasets, running
from advercity.cli.assets import assets
from advercity.cli.cache import cache
from advercity.cli.importing import imports
from advercity.cli.library import library
from advercity.cli.other_commands import check_other_command, load_command_sets
from advercity.cli.output import exit_with_error, print_data, show_status
from advercity.errors import InputError, RunError

RENAMED_COMMANDS = {"plan": "estimate"}
RENAMED_OPTIONS = {
    ("run", "--address"): "--cluster-address",
    ("run", "--ray-address"): "--cluster-address",
    ("run", "--colour-clouds"): "--cloud-colour",
    ("view", "--colour-clouds"): "--cloud-colour",
    ("simulate", "--film"): "--video",
    ("simulate", "--no-film"): "--no-video",
    ("simulate", "--table"): "--markdown",
    ("install", "--optional"): "--allow-failure",
}
"""New names of options, by command and old name."""


class StatusCommand(TyperCommand):
    """Shows its name at a terminal while it runs: imports and loading may take seconds."""

    def invoke(self, ctx: Any) -> Any:
        """Run the command."""
        with show_status(str(self.name)):
            return super().invoke(ctx)


def set_status_commands(group: typer.Typer) -> None:
    """Make the commands of a group show their names while they run."""
    for command in group.registered_commands:
        command.cls = StatusCommand


class RootGroup(TyperGroup):
    """Lists commands by purpose, and answers an old name with the new one."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the commands below the heads of their panels."""
        self._add_other_commands()
        width = max(map(len, self.commands))
        panels: dict[str, list[tuple[str, str]]] = {}
        for name, command in self.commands.items():
            text = command.get_short_help_str(formatter.width - width - 6)
            panel = getattr(command, "rich_help_panel", None) or "Commands"
            panels.setdefault(panel, []).append((name.ljust(width), text))
        for panel, rows in panels.items():
            with formatter.section(panel):
                formatter.write_dl(rows)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find the command named by the arguments."""
        if args[0] in RENAMED_COMMANDS:
            raise InputError(f"{args[0]} is now {RENAMED_COMMANDS[args[0]]}")
        if args[0] not in self.commands:
            self._add_other_commands()
            check_other_command(args[0])
        return super().resolve_command(ctx, args)

    def _add_other_commands(self) -> None:
        """Add commands of other distributions; to look for them takes a while."""
        for one in load_command_sets().found.values():
            if one.name not in self.commands:
                set_status_commands(one.commands)
                command = typer.main.get_command(one.commands)
                vars(command)["rich_help_panel"] = one.panel
                self.commands[one.name] = command

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
    cls=RootGroup,
    help="Adverse-weather V2X driving data, compiled from YAML.",
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
machine = typer.Typer()
PANELS = {
    "Author": authoring.commands,
    "Run": running.commands,
    "Dataset": datasets.commands,
    "Machine": machine,
}
"""Commands by purpose."""


@machine.command()
def doctor() -> None:
    """Report the abilities of this machine and missing parts."""
    from advercity.cli.doctor import check_machine

    text, healthy = check_machine()
    print_data(text)
    if not healthy:
        raise typer.Exit(1)


for panel, part in PANELS.items():
    for command in part.registered_commands:
        command.rich_help_panel, command.cls = panel, StatusCommand
    app.registered_commands += part.registered_commands
GROUPS = (
    (imports, "Author"),
    (library, "Author"),
    (assets, "Machine"),
    (cache, "Machine"),
)
for group, panel in GROUPS:
    set_status_commands(group)
    app.add_typer(group, rich_help_panel=panel)


@app.callback(invoke_without_command=True)
def version(
    show_version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False,
) -> None:
    """Adverse-weather V2X driving data, compiled from YAML."""
    if show_version:
        from advercity import __version__

        print_data(__version__)
        raise typer.Exit
