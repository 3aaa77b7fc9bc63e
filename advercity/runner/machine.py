"""What of the machine this process may use, in a container, too."""

import math
import os
from pathlib import Path

import psutil

CGROUP = Path("/sys/fs/cgroup")
"""Where version 2 of control groups tells what a container may take."""


def cores(cgroup: Path = CGROUP) -> int:
    """Processor cores that may be used, at least one."""
    quota, _, period = _told(cgroup / "cpu.max").partition(" ")
    share = float(quota) / float(period) if quota.isdigit() and period else math.inf
    return max(1, int(min(len(os.sched_getaffinity(0)), share)))


def memory_bytes(cgroup: Path = CGROUP) -> int:
    """Memory that there is at all."""
    most = _told(cgroup / "memory.max")
    total = psutil.virtual_memory().total
    return min(total, int(most)) if most.isdigit() else total


def free_memory_bytes(cgroup: Path = CGROUP) -> int:
    """Memory that can be had without anything being swapped out; what files are read into can."""
    free = psutil.virtual_memory().available
    most, used = _told(cgroup / "memory.max"), _told(cgroup / "memory.current")
    if not (most.isdigit() and used.isdigit()):
        return free
    kept = dict(line.split() for line in _told(cgroup / "memory.stat").splitlines())
    return max(0, min(free, int(most) - int(used) + int(kept.get("inactive_file", 0))))


def _told(path: Path) -> str:
    try:
        return path.read_text().strip()
    except OSError:
        return ""
