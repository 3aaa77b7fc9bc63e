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
from advercity.processes import ignore_signal


def main() -> None:
    """Run the command line; 0 done, 1 failed while running, 2 bad input, 130 interrupted.

    `RootGroup` reports interrupts, since typer ends the process silently. Termination signals have
    the exit codes of shells, such as 143 for SIGTERM.
    """
    _open_closed_streams()
    # The handler raises, so child processes end and partial files are removed.
    for number in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) != signal.SIG_IGN:  # `nohup` ignores SIGHUP
            signal.signal(number, _end_by_signal)
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # for names in other encodings
    notices = StderrHandler()
    logging.getLogger("advercity").addHandler(notices)
    try:
        app()
    except EndedBySignal as ended:
        with suppress(OSError):  # after SIGHUP the terminal is gone
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
    """Open closed standard streams, as after `2>&-`, on the null device.

    Else the next opened files get their numbers, and libraries write messages into them.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            opened = os.open(os.devnull, os.O_RDWR)  # takes the lowest free number
            os.set_inheritable(opened, True)  # child processes open files as well
    # Python sets closed streams to None.
    sys.stdout = sys.stdout or os.fdopen(1, "w", closefd=False)
    sys.stderr = sys.stderr or os.fdopen(2, "w", closefd=False)


def _end_by_signal(number: int, frame: FrameType | None) -> None:
    # A second signal must not interrupt the cleanup.
    signal.signal(number, ignore_signal)
    raise EndedBySignal(number)


__all__ = ["app", "main"]
