"""Child processes that do not outlive their parent."""

import ctypes
import os
import resource
import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from types import FrameType

PR_SET_PDEATHSIG = 1
"""From `linux/prctl.h`."""
LIMITS = (
    (
        resource.RLIMIT_AS,
        (signal.SIGSEGV, signal.SIGBUS, signal.SIGABRT),
        "-v",
        1e9,
        "GB of addresses",
    ),
    (resource.RLIMIT_FSIZE, (signal.SIGBUS, signal.SIGXFSZ), "-f", 1e6, "MB for a file"),
)
"""Limits, signals that end native code at them, options of `ulimit`, and units to tell them in.

Drivers of Vulkan map files into memory.
"""
MISSING_PROGRAM = 127
"""Exit code of a command whose program does not start."""


def ignore_signal(number: int, frame: FrameType | None) -> None:
    """Handle a signal without any effect; child processes do not inherit it, unlike `SIG_IGN`."""


def end_with_parent(parent_pid: int) -> None:
    """Have the kernel kill this process as soon as its parent ends, however it ends.

    Unlike a waiting thread, it does not need the interpreter, which native code may keep busy. On
    systems other than Linux it does nothing.

    Args:
        parent_pid: The parent; it may have ended meanwhile.
    """
    if sys.platform != "linux":
        return
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    if os.getppid() != parent_pid:
        os.kill(os.getpid(), signal.SIGKILL)


def bind_to_this_process(command: Sequence[str]) -> list[str]:
    """Return a command to run another one, with its exit code, until this process ends.

    For programs that cannot call `end_with_parent` themselves. The first word is a path; without a
    program there, the exit code is 127, as in shells.
    """
    # Isolated: neither the working folder nor the user's settings choose the imports.
    return [sys.executable, "-I", str(Path(__file__).resolve()), str(os.getpid()), *command]


def describe_end(exit_code: int) -> str:
    """Describe the end of a child process, and the limits that may be its cause.

    Args:
        exit_code: Negative: the number of the killing signal.
    """
    if exit_code >= 0:
        return f"exit code {exit_code}"
    text = f"killed by {signal.Signals(-exit_code).name}"
    for limit, signals, option, unit, name in LIMITS:
        bound, _ = resource.getrlimit(limit)
        if -exit_code in signals and bound != resource.RLIM_INFINITY:
            text += f" where `ulimit {option}` leaves {bound / unit:.1f} {name}; allow more"
    return text


def _main(parent_pid: str, *command: str) -> None:
    end_with_parent(int(parent_pid))
    try:
        os.execv(command[0], command)  # noqa: S606 - there is no shell on purpose
    except OSError as error:
        print(f"{command[0]}: {error.strerror}", file=sys.stderr)
        sys.exit(MISSING_PROGRAM)


if __name__ == "__main__":
    _main(*sys.argv[1:])
