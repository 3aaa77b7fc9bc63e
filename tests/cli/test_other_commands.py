"""Other distributions add commands; errors of theirs name them."""

from pathlib import Path

import pytest

from advercity.cli import other_commands
from tests.command_line import Command
from tests.dsl.test_sensor_kinds import install, run

GREETS = """
import typer
from advercity.cli.other_commands import CommandSet

commands = typer.Typer()
GREET = CommandSet("greet", commands, panel="Run")

@commands.command()
def greet(name: str) -> None:
    \"\"\"Greet by name.\"\"\"
    print(f"good morning, {name}")
"""


def run_command(site: Path, *arguments: str) -> str:
    return run(
        site, f"sys.argv = ['advercity', *{arguments!r}]; from advercity.cli import main; main()"
    )


def test_a_command_of_another_distribution_is_listed_and_run(tmp_path: Path) -> None:
    install(
        tmp_path,
        name="greetings",
        module=GREETS,
        group="advercity.commands",
        greet="greetings:GREET",
    )
    assert run_command(tmp_path, "greet", "Ada") == "good morning, Ada"
    run_panel = run_command(tmp_path, "--help").partition("Run:")[2].partition("Dataset:")[0]
    assert "greet " in run_panel
    assert "Greet by name." in run_panel
    assert "greet of greetings" in run_command(tmp_path, "doctor")


def test_a_command_that_is_not_installed_names_its_distribution(
    advercity: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(other_commands.COMMANDS_OF_DISTRIBUTIONS, "drive", "advercity-drive")
    ran = advercity("drive")
    assert ran.code == 2
    assert "drive: is not installed; try: pip install advercity-drive" in ran.err


def test_a_broken_command_says_why(tmp_path: Path) -> None:
    install(
        tmp_path,
        name="greetings",
        module=GREETS,
        group="advercity.commands",
        greet="greetings:GREETING",
    )
    with pytest.raises(AssertionError, match=r"greet: cannot be used: .*GREETING"):
        run_command(tmp_path, "greet", "Ada")
