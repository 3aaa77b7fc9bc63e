"""Times the compiler on the library with the example weathers in it: `python benchmarks/compile.py`.

Where the time goes is seen best by `python -m cProfile -s tottime -m advercity compile library`.
"""

import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from measurement import Measurement, cpu_with_children_s, measure_median_cpu_s

from advercity.compiler import load_library, write_specs
from advercity.compiler.crossing import compile_library

ROOT = Path(__file__).parent.parent
ADVERCITY = str(Path(sys.executable).parent / "advercity")
BASELINE_IMPORTS = "import yaml, pydantic, typer"
"""Imports of any program of this kind: the part of the start-up that is not ours."""


def run_benchmark(*, quick: bool) -> list[Measurement]:
    """Measure the whole library, and the start of the program."""
    rounds = 3 if quick else 7
    baseline_s = _median_s(_subprocess_call(sys.executable, "-c", BASELINE_IMPORTS), rounds)
    with tempfile.TemporaryDirectory() as folder:
        compiling = _subprocess_call(
            ADVERCITY, "compile", str(ROOT / "library"), "--output", folder
        )
        compile_s = _median_s(compiling, rounds)
    help_s = _median_s(_subprocess_call(ADVERCITY, "--help"), rounds)
    against = "importing yaml, pydantic and typer"
    return [
        Measurement("`advercity --help`, processor time", help_s / baseline_s, against, 2.0),
        Measurement("`advercity compile`, processor time", compile_s / baseline_s, against, 12.0),
    ]


def _median_s(work: Callable[[], object], rounds: int) -> float:
    return measure_median_cpu_s(work, rounds, clock=cpu_with_children_s)


def _subprocess_call(*command: str) -> Callable[[], object]:
    return lambda: subprocess.run(command, check=True, capture_output=True)


def main() -> None:
    """Print seconds of each stage of compiling."""
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 5
    with tempfile.TemporaryDirectory() as folder:
        library, output = Path(folder, "library"), Path(folder, "specs")
        shutil.copytree(ROOT / "library", library)
        for example in (ROOT / "library" / "examples").glob("*.yaml"):
            shutil.copy(example, library / "nhtsa" / "weather")
        specs = compile_library(library, suite="adver_city")
        rows = {
            "`advercity --help`": _subprocess_call(ADVERCITY, "--help"),
            f"python -c '{BASELINE_IMPORTS}'": _subprocess_call(
                sys.executable, "-c", BASELINE_IMPORTS
            ),
            "`advercity compile`, the whole process": _subprocess_call(
                *(ADVERCITY, "compile", str(library), "--output", str(output)),
                *("--suite", "adver_city"),
            ),
            "reading the library": lambda: load_library(library),
            "reading and crossing": lambda: compile_library(library, suite="adver_city"),
            "writing": lambda: write_specs(specs, output),
        }
        print(f"{len(specs)} specs, median of {rounds}\n\n| stage | CPU, s |\n|---|---|")
        for name, work in rows.items():
            print(f"| {name} | {_median_s(work, rounds):.2f} |")


if __name__ == "__main__":
    main()
