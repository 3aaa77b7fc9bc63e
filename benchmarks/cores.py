"""How busy one run keeps the cores, and what sharing its frames among processes gains.

    python benchmarks/cores.py [compiled/ui_fog_day_sparse.json] [--frames 96] [--jobs N]

Runs of the command line, start and end included, with traffic and world in the cache: in `--jobs`
processes, by default as many as suit the machine, and in one.
"""

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

from measurement import Measurement, RunTime, cpu_with_children_s, measure_run_time

from advercity.compiler import read_spec
from advercity.pipeline.machine import count_usable_cores
from advercity.pipeline.preparation import load_or_build_world, load_or_simulate_traffic

SPEC = Path("compiled/ui_fog_day_sparse.json")
GOAL = 0.85


def run_benchmark(*, quick: bool) -> list[Measurement]:
    """Measure a run of a scenario, all of it unless quick."""
    frames = 48 if quick else 1000
    shared, alone = measure_run(SPEC, frames), measure_run(SPEC, frames, "--jobs", "1")
    ratio = shared.wall_s / alone.wall_s
    return [
        Measurement("preview run, cores busy", busy_fraction(shared), "all cores", at_least=GOAL),
        Measurement("preview run, wall", ratio, "the same in one process"),
    ]


def measure_run(spec_path: Path, frames: int, *options: str) -> RunTime:
    """Measure a run of the first frames, its traffic and world in the cache."""
    spec = read_spec(spec_path)
    load_or_build_world(spec, load_or_simulate_traffic(spec).network_path)
    with tempfile.TemporaryDirectory() as folder:
        command = [
            *(sys.executable, "-c", "from advercity.cli import main; main()"),
            *("run", str(spec_path), "--profile", "preview", *options),
            *("--frames", f"0:{frames}", "--output", folder),
        ]
        return measure_run_time(
            lambda: subprocess.run(command, check=True, stdout=subprocess.DEVNULL),
            cpu_with_children_s,
        )


def busy_fraction(run: RunTime) -> float:
    """Compute the fraction of the cores' time that a run used."""
    return run.cpu_s / run.wall_s / count_usable_cores()


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("spec", type=Path, nargs="?", default=SPEC)
    parser.add_argument("--frames", type=int, default=96)
    parser.add_argument("--jobs", type=int)
    arguments = parser.parse_args()
    jobs = [] if arguments.jobs is None else ["--jobs", str(arguments.jobs)]
    for name, options in (("shared", jobs), ("alone", ["--jobs", "1"])):
        run = measure_run(arguments.spec, arguments.frames, *options)
        print(f"{name}: cores busy {busy_fraction(run):.1%}, {run.wall_s:.0f} s wall")


if __name__ == "__main__":
    main()
