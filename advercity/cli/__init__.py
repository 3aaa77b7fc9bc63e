"""The command line: each command parses options, calls the library and prints the result."""

import logging
import os
import signal
import sys
from contextlib import suppress
from io import TextIOWrapper
from types import FrameType

from advercity.cli.app import app
from advercity.cli.output import EndedBySignal, StderrHandler, exit_with_error
from advercity.errors import InputError, RunError, explain_system_error


def main() -> None:
    """Run the command line; 0 done, 1 failed while running, 2 bad input, 130 interrupted.

    An interrupt is reported by `RootGroup`, since typer ends the process without a word. Signals
    that ask the process to end have the exit codes that shells give them, such as 143 for SIGTERM.
    """
    _open_closed_streams()
    # They unwind the stack like an exception, so that child processes and partial files go.
    for number in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) != signal.SIG_IGN:  # as `nohup` leaves SIGHUP
            signal.signal(number, _end_by_signal)
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # names that the encoding lacks
    notices = StderrHandler()
    logging.getLogger("advercity").addHandler(notices)
    try:
        app()
    except EndedBySignal as ended:
        with suppress(OSError):  # of SIGHUP the terminal is gone
            exit_with_error(RunError(str(ended)), exit_code=128 + ended.number)
        sys.exit(128 + ended.number)
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


def _open_closed_streams() -> None:
    """Open standard streams that are closed, as by `2>&-`, on nothing.

    Else the next files that are opened have their numbers, and messages of libraries go into them.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            opened = os.open(os.devnull, os.O_RDWR)  # it takes the lowest number that is free
            os.set_inheritable(opened, True)  # processes that are started open files as well
    # Python has None for those.
    sys.stdout = sys.stdout or os.fdopen(1, "w", closefd=False)
    sys.stderr = sys.stderr or os.fdopen(2, "w", closefd=False)


def _end_by_signal(number: int, frame: FrameType | None) -> None:
    # What is being closed is not to be interrupted by a second one.
    signal.signal(number, _ignore_signal)
    raise EndedBySignal(number)


def _ignore_signal(number: int, frame: FrameType | None) -> None:
    """Do nothing; unlike `SIG_IGN`, child processes that start meanwhile do not inherit it."""


__all__ = ["app", "main"]
