"""How the command line speaks: data on stdout, all else on stderr."""

import sys
from typing import NoReturn

from rich.console import Console

stderr_console = Console(stderr=True, highlight=False, soft_wrap=True, emoji=False)


def print_data(text: str) -> None:
    """Print data."""
    print(text)


def print_note(text: str) -> None:
    """Tell what is going on; quiet when nobody watches."""
    if sys.stderr.isatty():
        stderr_console.print(text, markup=False)


def exit_with_error(error: Exception, *, exit_code: int) -> NoReturn:
    """Print one message and leave; lines that are indented belong to the one above."""
    for line in str(error).splitlines():
        if line.startswith(" "):
            stderr_console.print(line, markup=False)
        else:
            stderr_console.print(f"error: {line}", markup=False, style="red")
    sys.exit(exit_code)
