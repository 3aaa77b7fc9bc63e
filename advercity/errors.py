"""Errors for callers to handle.

AdvercityError
├── InputError      the input is not valid: a declaration, a spec, an option (exit code 2)
└── RunError        a run failed: simulator, renderer, disk, machine (exit code 1)
    ├── BackendError    a rendering backend is missing, broken or has no device
    └── StagingError    traffic does not let a staged conflict happen, and never will
"""

import errno
import os
from collections.abc import Generator
from contextlib import contextmanager

DISK_ERRORS = (errno.ENOSPC, errno.EDQUOT, errno.EIO)
"""Errors of the system that are no fault of the path."""


def escape_control_characters(text: str) -> str:
    """Escape line breaks and other characters that would change the state of a terminal."""
    return "".join(
        character if character.isprintable() else character.encode("unicode_escape").decode()
        for character in text
    )


class AdvercityError(Exception):
    """Base of all expected errors; the message is for the user, without a traceback.

    Each argument is a line. Quotes from files and file names cannot break a line.
    """

    def __str__(self) -> str:
        """Return the message; indented lines belong to the line above them."""
        return "\n".join(escape_control_characters(str(line)) for line in self.args)


class InputError(AdvercityError):
    """The input is not valid; the message gives the place and how to correct it."""


class RunError(AdvercityError):
    """A run failed; the message gives the cause and a way out."""


class BackendError(RunError):
    """A rendering backend is missing, does not import, or finds no device."""


class StagingError(RunError):
    """The traffic of a spec does not let a staged conflict happen; another run does not help."""


def describe_cause(error: OSError) -> str:
    """Describe why the system refused something, and the way out where it is not plain.

    Errors of Python's own have no `strerror`.
    """
    if error.errno in (errno.EMFILE, errno.ENFILE):
        return f"{error.strerror}: allow more with `ulimit -n`"
    if error.errno == errno.ENOENT and not _has_working_folder():
        return "the working folder has been deleted; change to one that exists"
    return error.strerror or str(error) or type(error).__name__


def _has_working_folder() -> bool:
    try:
        os.getcwd()  # noqa: PTH109 - the same
    except FileNotFoundError:
        return False
    return True


def explain_system_error(error: OSError | MemoryError) -> RunError:
    """Explain an otherwise unexpected error of the system, in one line."""
    if isinstance(error, MemoryError):
        cause = str(error) or "no memory is left"
        return RunError(f"out of memory: {cause}; allow more, or use fewer `jobs`")
    path = f"{error.filename}: " if error.filename else ""
    return RunError(f"{path}{describe_cause(error)}")


@contextmanager
def report_temporary_errors() -> Generator[None]:
    """Convert an OSError into a RunError about the folder for temporary files."""
    try:
        yield
    except OSError as error:
        folder = os.environ.get("TMPDIR") or "/tmp"  # noqa: S108 - `tempfile` may find none
        raise RunError(
            f"temporary folder {folder}: {describe_cause(error)}; set TMPDIR to one with room"
        ) from error


@contextmanager
def report_write_errors() -> Generator[None]:
    """Convert an OSError into an InputError with the file's name, as the user chose the path.

    If the disk is full or broken, it is a RunError: any other path there would fail, too.
    """
    try:
        yield
    except OSError as error:
        path = error.filename or "the output"
        kind = RunError if error.errno in DISK_ERRORS else InputError
        raise kind(f"{path}: cannot be written: {describe_cause(error)}") from error
