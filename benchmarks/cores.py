"""How busy one run keeps the cores.

    python benchmarks/cores.py [compiled/ui_fog_day_sparse.json] [--frames 96] [--jobs N]

A run of the command line, starting and closing included, once its traffic is known; without --jobs
in as many processes as suit the machine.
"""

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from figures import Figure

from advercity.compiler import read_spec
from advercity.runner.machine import cores
from advercity.runner.stage import set_stage

SPEC = Path("compiled/ui_fog_day_sparse.json")
GOAL = 0.85


def busy(spec: Path, frames: int, *options: str) -> float:
    """Share of the cores' time that a run of the first frames took, from its begin to its end."""
    set_stage(read_spec(spec))
    with tempfile.TemporaryDirectory() as folder:
        command = [
            *(sys.executable, "-c", "from advercity.cli import main; main()"),
            *("run", str(spec), "--profile", "preview", *options),
            *("--frames", f"0:{frames}", "--output", folder),
        ]
        began_s, before_s = time.perf_counter(), _of_children_s()
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        wall_s, cpu_s = time.perf_counter() - began_s, _of_children_s() - before_s
    return cpu_s / wall_s / cores()


def figures(*, quick: bool) -> list[Figure]:
    """A run of a scenario, all of it unless quick."""
    value = busy(SPEC, 48 if quick else 1000)
    return [Figure("preview run, cores busy", value, "all cores", at_least=GOAL)]


def _of_children_s() -> float:
    """Processor time of all that were started and have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("spec", type=Path, nargs="?", default=SPEC)
    parser.add_argument("--frames", type=int, default=96)
    parser.add_argument("--jobs", type=int)
    arguments = parser.parse_args()
    jobs = [] if arguments.jobs is None else ["--jobs", str(arguments.jobs)]
    print(f"cores busy: {busy(arguments.spec, arguments.frames, *jobs):.1%}")


if __name__ == "__main__":
    main()
