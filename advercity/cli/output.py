"""Output of the command line: data on stdout, everything else on stderr."""

import logging
import re
import signal
import sys
from collections.abc import Generator, Iterable
from contextlib import contextmanager
from typing import TYPE_CHECKING, NoReturn

from rich.console import Console

from advercity.errors import escape_control_characters

if TYPE_CHECKING:
    from pathlib import Path

    from advercity_dsl import Spec

stderr_console = Console(stderr=True, highlight=False, soft_wrap=True, emoji=False)
_status = stderr_console.status("")


class EndedBySignal(SystemExit):
    """A termination signal; as a `SystemExit` it passes handlers of errors."""

    def __init__(self, number: int, *remarks: str) -> None:
        """Keep the signal's number, and remarks on kept files."""
        super().__init__("; ".join([f"ended by {signal.Signals(number).name}", *remarks]))
        self.number = number


@contextmanager
def show_status(text: str) -> Generator[None]:
    """Show a status at a terminal, until the first output or the end."""
    if sys.stderr.isatty():
        _status.update(text)
        _status.start()
    try:
        yield
    finally:
        end_status()


def update_status(text: str) -> None:
    """Change the text of the status."""
    _status.update(text)


def end_status() -> None:
    """Remove the status, before anything else is shown."""
    _status.stop()


def print_data(text: str) -> None:
    """Print data."""
    end_status()
    print(text)


def print_remark(text: str) -> None:
    """Print a remark on stderr."""
    end_status()
    lines = map(escape_control_characters, text.split("\n"))
    stderr_console.print("\n".join(lines), markup=False)


def print_left_out(specs: "Iterable[Spec]") -> None:
    """Print the parts of maps and recordings left out of the specs' roads."""
    from advercity.foreign.ledger import describe_left_out

    roads = {spec.road.id: spec.road for spec in specs}
    for road in roads.values():
        if road.left_out:
            print_remark(f"road '{road.id}': left out: {describe_left_out(road.left_out)}")


def print_unread(dataset: "Path", layout: str | None) -> None:
    """Print the data missing in a foreign folder, and its unread parts."""
    if layout is None:
        return
    from advercity.dataset.foreign_folders import NOT_HELD, open_foreign_scenarios
    from advercity.foreign.ledger import describe_left_out, merge_left_out

    print_remark(f"{dataset}: not in these files: {', '.join(NOT_HELD)}")
    scenarios = open_foreign_scenarios(dataset, layout)
    found = merge_left_out(*(scenario.left_out for scenario in scenarios))
    if found:
        print_remark(f"{dataset}: left out: {describe_left_out(found)}")


OTHER_PARAMETERS = (
    *("connected", "ego", "from", "key_frames", "kind", "library", "map", "name", "offset"),
    *("origin", "rig", "schemas", "suite", "to", "turn", "weather", "web"),
)
"""Parameters of commands outside `RunOptions`."""


def format_options(text: str) -> str:
    """Replace parameters quoted by the library, such as `max_time_s`, by options: --max-time."""
    # Imported here, since only messages need it.
    from advercity.cli.arguments import OPTIONS, name_option

    flags = {name: f"--{name.replace('_', '-')}" for name in OTHER_PARAMETERS}
    flags |= {name: name_option(name, option) for name, (_, option) in OPTIONS.items()}
    return re.sub(f"`({'|'.join(flags)})`", lambda match: flags[match[1]], text)


class StderrHandler(logging.Handler):
    """Prints the log of the library on stderr, a line per record."""

    def emit(self, record: logging.LogRecord) -> None:
        """Print a record."""
        stderr_console.print(format_options(record.getMessage()), markup=False)


def exit_with_error(error: Exception, *, exit_code: int) -> NoReturn:
    """Print one message and exit; indented lines belong to the line above them."""
    # Imported here, since only errors need it and every command imports this module.
    from advercity.diagnostics import DiagnosticsError

    # Diagnostics quote the author's text, which may contain the name of a parameter.
    text = str(error) if isinstance(error, DiagnosticsError) else format_options(str(error))
    for line in text.splitlines():
        if line.startswith(" "):
            stderr_console.print(line, markup=False)
        else:
            stderr_console.print(f"error: {line}", markup=False, style="red")
    sys.exit(exit_code)
