"""What of the machine this process may use, in a container, too.

Which graphics cards there are to share out.
"""

import math
import os
import shutil
import subprocess
from collections.abc import Iterable
from itertools import pairwise
from pathlib import Path

import psutil

CGROUP_FOLDER = Path("/sys/fs/cgroup")
"""Where version 2 of control groups tells what a container may take."""


def count_usable_cores(cgroup: Path = CGROUP_FOLDER) -> int:
    """Processor cores that may be used, at least one."""
    quota, _, period = _read_text(cgroup / "cpu.max").partition(" ")
    share = float(quota) / float(period) if quota.isdigit() and period else math.inf
    return max(1, int(min(len(os.sched_getaffinity(0)), share)))


def total_memory_bytes(cgroup: Path = CGROUP_FOLDER) -> int:
    """Memory that there is at all."""
    most = _read_text(cgroup / "memory.max")
    total = psutil.virtual_memory().total
    return min(total, int(most)) if most.isdigit() else total


def free_memory_bytes(cgroup: Path = CGROUP_FOLDER) -> int:
    """Memory that can be had without anything being swapped out; what files are read into can."""
    free = psutil.virtual_memory().available
    most, used = _read_text(cgroup / "memory.max"), _read_text(cgroup / "memory.current")
    if not (most.isdigit() and used.isdigit()):
        return free
    kept = dict(line.split() for line in _read_text(cgroup / "memory.stat").splitlines())
    return max(0, min(free, int(most) - int(used) + int(kept.get("inactive_file", 0))))


def _read_text(path: Path) -> str:
    try:
        return path.read_text().strip()
    except OSError:
        return ""


VISIBLE_DEVICES_VARIABLE = "CUDA_VISIBLE_DEVICES"


def find_visible_gpus() -> tuple[str, ...]:
    """Names of the cards that a process may see, as `CUDA_VISIBLE_DEVICES` takes them."""
    chosen = os.environ.get(VISIBLE_DEVICES_VARIABLE)
    if chosen is not None:
        return tuple(name.strip() for name in chosen.split(",") if name.strip())
    program = shutil.which("nvidia-smi")
    if program is None:
        return ()
    command = [program, "--query-gpu=index", "--format=csv,noheader"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603
    return tuple(done.stdout.split()) if done.returncode == 0 else ()


def build_gpu_environment(slots: Iterable[int], gpus: tuple[str, ...]) -> dict[str, str]:
    """Variables for one who has some places among all that run side by side: a card for each."""
    if not gpus:
        return {}
    return {
        VISIBLE_DEVICES_VARIABLE: ",".join(
            dict.fromkeys(gpus[place % len(gpus)] for place in slots)
        )
    }


def divide_slots(jobs: int, scenarios: int) -> list[range]:
    """Places of processes, a range of them for each scenario that runs at a time."""
    count = max(1, min(jobs, scenarios))
    ends = [jobs * number // count for number in range(count + 1)]
    return [range(first, end) for first, end in pairwise(ends)]
