"""How busy one run keeps the cores, and what sharing its frames among processes gains.

    python benchmarks/cores.py [compiled/ui_fog_day_sparse.json] [--frames 96] [--jobs N]

Runs of the command line, starting and closing included, once traffic and world are known: in so
many processes, without --jobs in as many as suit the machine, and in one.
"""

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from measurement import Figure

from advercity.compiler import read_spec
from advercity.pipeline.machine import count_usable_cores
from advercity.pipeline.preparation import load_or_build_world, load_or_simulate_traffic

SPEC = Path("compiled/ui_fog_day_sparse.json")
GOAL = 0.85


@dataclass(frozen=True)
class Taken:
    """What a run took from its begin to its end."""

    wall_s: float
    cpu_s: float

    @property
    def busy(self) -> float:
        """Share of the cores' time."""
        return self.cpu_s / self.wall_s / count_usable_cores()


def taken(spec: Path, frames: int, *options: str) -> Taken:
    """By a run of the first frames, its traffic and world in the cache."""
    scenario = read_spec(spec)
    load_or_build_world(scenario, load_or_simulate_traffic(scenario).network_path)
    with tempfile.TemporaryDirectory() as folder:
        command = [
            *(sys.executable, "-c", "from advercity.cli import main; main()"),
            *("run", str(spec), "--profile", "preview", *options),
            *("--frames", f"0:{frames}", "--output", folder),
        ]
        began_s, before_s = time.perf_counter(), _of_children_s()
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        return Taken(time.perf_counter() - began_s, _of_children_s() - before_s)


def figures(*, quick: bool) -> list[Figure]:
    """A run of a scenario, all of it unless quick."""
    frames = 48 if quick else 1000
    shared, alone = taken(SPEC, frames), taken(SPEC, frames, "--jobs", "1")
    ratio = shared.wall_s / alone.wall_s
    return [
        Figure("preview run, cores busy", shared.busy, "all cores", at_least=GOAL),
        Figure("preview run, wall", ratio, "the same in one process"),
    ]


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
    for name, options in (("shared", jobs), ("alone", ["--jobs", "1"])):
        found = taken(arguments.spec, arguments.frames, *options)
        print(f"{name}: cores busy {found.busy:.1%}, {found.wall_s:.0f} s by the clock")


if __name__ == "__main__":
    main()
