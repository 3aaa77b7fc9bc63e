"""How the command line speaks: data on stdout, all else on stderr."""

import sys
from typing import NoReturn

from rich.console import Console

errors = Console(stderr=True, highlight=False, soft_wrap=True, emoji=False)


def say(text: str) -> None:
    """Print data."""
    print(text)


def note(text: str) -> None:
    """Tell what is going on; quiet when nobody watches."""
    if sys.stderr.isatty():
        errors.print(text, markup=False)


def fail(error: Exception, *, exit_code: int) -> NoReturn:
    """Print one message and leave; lines that are indented belong to the one above."""
    for line in str(error).splitlines():
        if line.startswith(" "):
            errors.print(line, markup=False)
        else:
            errors.print(f"error: {line}", markup=False, style="red")
    sys.exit(exit_code)
