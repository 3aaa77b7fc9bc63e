"""Times the compiler on the library: `python benchmarks/compile.py [ROUNDS]`.

As a program it adds the example weathers and times each stage. Functions that take most are shown
by `python -m cProfile -s tottime .venv/bin/advercity compile library`.
"""

import shutil
import sys
import tempfile
from pathlib import Path

from measurement import Measurement, measure_command_cpu_s, measure_median_cpu_s

from advercity.compiler import load_library, write_specs
from advercity.compiler.crossing import compile_library

ROOT = Path(__file__).parent.parent
ADVERCITY = str(Path(sys.executable).parent / "advercity")
BASELINE_IMPORTS = "import yaml, pydantic, typer"
"""Imports of any program of this kind: the part of the start-up that is not ours."""


def run_benchmark(*, quick: bool) -> list[Measurement]:
    """Measure the whole library, and the start of the program."""
    rounds = 3 if quick else 7
    baseline_s = measure_command_cpu_s(rounds, sys.executable, "-c", BASELINE_IMPORTS)
    with tempfile.TemporaryDirectory() as folder:
        compile_s = measure_command_cpu_s(
            rounds, ADVERCITY, "compile", str(ROOT / "library"), "--output", folder
        )
    help_s = measure_command_cpu_s(rounds, ADVERCITY, "--help")
    against = "importing yaml, pydantic and typer"
    return [
        Measurement("`advercity --help`, processor time", help_s / baseline_s, against, 2.0),
        Measurement("`advercity compile`, processor time", compile_s / baseline_s, against, 12.0),
    ]


def main() -> None:
    """Print the processor time of commands and of the stages of compiling."""
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 5
    with tempfile.TemporaryDirectory() as folder:
        library, output = Path(folder, "library"), Path(folder, "specs")
        shutil.copytree(ROOT / "library", library)
        for example in (ROOT / "library" / "examples").glob("*.yaml"):
            shutil.copy(example, library / "nhtsa" / "weather")
        specs = compile_library(library, suite="adver_city")
        suite = "--suite", "adver_city"
        commands = {
            "`advercity --help`": (ADVERCITY, "--help"),
            f"python -c '{BASELINE_IMPORTS}'": (sys.executable, "-c", BASELINE_IMPORTS),
            "`advercity compile`, the whole process": (
                *(ADVERCITY, "compile", str(library), "--output", str(output)),
                *suite,
            ),
        }
        stages = {
            "reading the library": lambda: load_library(library),
            "reading and crossing": lambda: compile_library(library, suite="adver_city"),
            "writing": lambda: write_specs(specs, output),
        }
        times = {name: measure_command_cpu_s(rounds, *item) for name, item in commands.items()}
        times |= {name: measure_median_cpu_s(work, rounds) for name, work in stages.items()}
    print(f"{len(specs)} specs, median of {rounds}\n\n| stage | CPU, s |\n|---|---|")
    for name, seconds in times.items():
        print(f"| {name} | {seconds:.2f} |")


if __name__ == "__main__":
    main()
