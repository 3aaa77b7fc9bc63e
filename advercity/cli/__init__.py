"""The command line: each command parses options, calls the library and prints the result."""

import logging
import signal
import sys
from io import TextIOWrapper
from types import FrameType

from advercity.cli.app import app
from advercity.cli.output import StderrHandler, exit_with_error
from advercity.errors import InputError, RunError, explain_system_error


def main() -> None:
    """Run the command line; 0 done, 1 failed while running, 2 bad input, 130 interrupted.

    An interrupt is reported by `RootGroup`, since typer ends the process without a word.
    """
    # SIGTERM unwinds the stack like an exception, so that child processes and partial files go.
    signal.signal(signal.SIGTERM, _exit_on_signal)
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # names that the encoding lacks
    notices = StderrHandler()
    logging.getLogger("advercity").addHandler(notices)
    try:
        app()
    except InputError as error:
        exit_with_error(error, exit_code=2)
    except RunError as error:
        exit_with_error(error, exit_code=1)
    except BrokenPipeError:
        # The reader of standard output is gone, as with `| head`.
        sys.stderr.close()
        sys.exit(1)
    except (OSError, MemoryError) as error:
        exit_with_error(explain_system_error(error), exit_code=1)
    finally:
        logging.getLogger("advercity").removeHandler(notices)


def _exit_on_signal(number: int, frame: FrameType | None) -> None:
    sys.exit(128 + number)


__all__ = ["app", "main"]
