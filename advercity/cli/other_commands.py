"""Commands of other distributions, each an entry point of the group `advercity.commands`."""

from dataclasses import dataclass
from functools import cache

import typer
from advercity_dsl.registry import Registered, load_registered

from advercity.errors import InputError

COMMANDS_OF_DISTRIBUTIONS = {
    "benchmark": "advercity-benchmark",
    "report": "advercity-report",
    "study": "advercity-benchmark",
}
"""Distributions that add commands, by command."""


@dataclass(frozen=True)
class CommandSet:
    """A command, or a group of commands.

    Attributes:
        name: Its name on the command line.
        commands: Its commands; a single one is the command itself.
        panel: Head of the list of commands that it is in.
    """

    name: str
    commands: typer.Typer
    panel: str = "Dataset"


@cache
def load_command_sets() -> Registered[CommandSet]:
    """Load the commands that other distributions of this installation register."""
    return load_registered("advercity.commands", {}, CommandSet)


def check_other_command(name: str) -> None:
    """Raise an InputError if the command of another distribution is broken or not installed."""
    others = load_command_sets()
    if name in others.broken:
        raise InputError(f"{name}: cannot be used: {others.broken[name]}")
    if name in COMMANDS_OF_DISTRIBUTIONS and name not in others.found:
        raise InputError(
            f"{name}: is not installed; try: pip install {COMMANDS_OF_DISTRIBUTIONS[name]}"
        )
