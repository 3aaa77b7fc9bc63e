"""Child processes that do not outlive the process that started them."""

import ctypes
import os
import signal
import sys

PR_SET_PDEATHSIG = 1
"""From `linux/prctl.h`."""


def end_with_parent(parent_pid: int) -> None:
    """Have the kernel kill this process as soon as its parent ends, however it ends.

    Unlike a thread that waits for that, it needs nothing of an interpreter that native code keeps
    busy. On systems other than Linux it does nothing.

    Args:
        parent_pid: The process that started this one; it may have ended meanwhile.
    """
    if sys.platform != "linux":
        return
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    if os.getppid() != parent_pid:
        os.kill(os.getpid(), signal.SIGKILL)
