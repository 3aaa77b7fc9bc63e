"""Cores, memory and GPUs usable by this process, also within a container's limits."""

import math
import os
import shutil
import subprocess
from pathlib import Path

import psutil

VISIBLE_DEVICES_VARIABLE = "CUDA_VISIBLE_DEVICES"
DRIVER_THREADS_VARIABLE = "LP_NUM_THREADS"
"""Drawing threads of Mesa's software driver, for which sorted triangles wait in memory. At 0 the
sorting thread draws, too. Images are the same."""
HEAPS_VARIABLE = "MALLOC_ARENA_MAX"
"""Largest number of heaps of the GNU C library; each keeps its freed memory."""
CGROUP_FOLDER = Path("/sys/fs/cgroup")
"""Root of the control groups (version 2), which hold the limits of a container."""


def count_usable_cores(cgroup: Path = CGROUP_FOLDER) -> int:
    """Count the usable processor cores, at least one."""
    quota, _, period = _read_text(cgroup / "cpu.max").partition(" ")
    quota_cores = float(quota) / float(period) if quota.isdigit() and period else math.inf
    return max(1, int(min(len(os.sched_getaffinity(0)), quota_cores)))


def total_memory_bytes(cgroup: Path = CGROUP_FOLDER) -> int:
    """Read the memory of the machine or the container."""
    limit = _read_text(cgroup / "memory.max")
    total = psutil.virtual_memory().total
    return min(total, int(limit)) if limit.isdigit() else total


def free_memory_bytes(cgroup: Path = CGROUP_FOLDER) -> int:
    """Read the memory available without swapping; the page cache counts as free."""
    free = psutil.virtual_memory().available
    limit, used = _read_text(cgroup / "memory.max"), _read_text(cgroup / "memory.current")
    if not (limit.isdigit() and used.isdigit()):
        return free
    # The kernel counts inactive pages of files as used, but gives them up first.
    stat = dict(line.split() for line in _read_text(cgroup / "memory.stat").splitlines())
    return max(0, min(free, int(limit) - int(used) + int(stat.get("inactive_file", 0))))


def _read_text(path: Path) -> str:
    try:
        return path.read_text().strip()
    except OSError:
        return ""


def find_visible_gpus() -> tuple[str, ...]:
    """List the GPUs visible to this process, by their names in `CUDA_VISIBLE_DEVICES`."""
    chosen = os.environ.get(VISIBLE_DEVICES_VARIABLE)
    if chosen is not None:
        return tuple(name.strip() for name in chosen.split(",") if name.strip())
    program = shutil.which("nvidia-smi")
    if program is None:
        return ()
    command = [program, "--query-gpu=index", "--format=csv,noheader"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603
    return tuple(done.stdout.split()) if done.returncode == 0 else ()


def build_worker_environment(
    slot: int, gpus: tuple[str, ...], cores_per_worker: int
) -> dict[str, str]:
    """Build the variables of the worker in a slot: one GPU, shared in turn, and threads.

    Mesa's driver gets one thread per core of the worker, but none for a single core, where it would
    only take memory. All threads share one heap: they allocate little.
    """
    threads = cores_per_worker if cores_per_worker > 1 else 0
    environment = {DRIVER_THREADS_VARIABLE: str(threads), HEAPS_VARIABLE: "1"}
    if gpus:
        environment[VISIBLE_DEVICES_VARIABLE] = gpus[slot % len(gpus)]
    return environment
