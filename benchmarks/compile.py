"""Times the compiler on the library with the example weathers in it, and says where time goes.

python benchmarks/compile.py [ROUNDS]
"""

import cProfile
import os
import pstats
import shutil
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

from measurement import Figure

from advercity.compiler import load_library, write_specs
from advercity.compiler.crossing import compile_library

ROOT = Path(__file__).parent.parent
PEER = "import yaml, pydantic, typer"
"""What any program of this kind imports; the start-up that is not ours."""


def figures(*, quick: bool) -> list[Figure]:
    """The whole library, and the start of the program."""
    rounds = 3 if quick else 7
    peer_s = median_s(process(sys.executable, "-c", PEER), rounds)
    advercity = str(Path(sys.executable).parent / "advercity")
    with tempfile.TemporaryDirectory() as scratch:
        compiling = process(advercity, "compile", str(ROOT / "library"), "--output", scratch)
        whole_s = median_s(compiling, rounds)
    help_s = median_s(process(advercity, "--help"), rounds)
    against = "importing yaml, pydantic and typer"
    return [
        Figure("`advercity --help`, processor time", help_s / peer_s, against, at_most=2.0),
        Figure("`advercity compile`, processor time", whole_s / peer_s, against, at_most=12.0),
    ]


def median_s(work: Callable[[], object], rounds: int) -> float:
    """Median of the processor time that `work` takes in this process and its children."""
    taken: list[float] = []
    for _ in range(rounds):
        begin = sum(os.times()[:4])
        work()
        taken.append(sum(os.times()[:4]) - begin)
    return statistics.median(taken)


def process(*command: str) -> Callable[[], object]:
    """Work that is a process of its own."""
    return lambda: subprocess.run(command, check=True, capture_output=True)


def main() -> None:
    """Print a table, then the functions that took most."""
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 5
    advercity = str(Path(sys.executable).parent / "advercity")
    with tempfile.TemporaryDirectory() as scratch:
        library, output = Path(scratch, "library"), Path(scratch, "specs")
        shutil.copytree(ROOT / "library", library)
        for example in (ROOT / "library" / "examples").glob("*.yaml"):
            shutil.copy(example, library / "nhtsa" / "weather")
        specs = compile_library(library, suite="adver_city")
        rows = {
            "`advercity --help`": process(advercity, "--help"),
            f"python -c '{PEER}'": process(sys.executable, "-c", PEER),
            "`advercity compile`, the whole process": process(
                *(advercity, "compile", str(library), "--output", str(output)),
                *("--suite", "adver_city"),
            ),
            "reading the library": lambda: load_library(library),
            "reading and crossing": lambda: compile_library(library, suite="adver_city"),
            "writing": lambda: write_specs(specs, output),
        }
        print(f"{len(specs)} specs, median of {rounds}\n\n| what | s |\n|---|---|")
        for name, work in rows.items():
            print(f"| {name} | {median_s(work, rounds):.2f} |")
        _print_profile(lambda: write_specs(compile_library(library, suite="adver_city"), output))


def _print_profile(work: Callable[[], object], shown: int = 12) -> None:
    profile = cProfile.Profile()
    profile.runcall(work)
    stats = pstats.Stats(profile)
    rows: Sequence[tuple[tuple[str, int, str], tuple[int, int, float, float, object]]]
    rows = sorted(stats.stats.items(), key=lambda item: -item[1][2])  # pyright: ignore
    total = sum(row[1][2] for row in rows)
    print("\n| function | calls | share of the time, its own |\n|---|---|---|")
    for (file, _, name), (_, calls, own, _, _) in rows[:shown]:
        print(f"| {Path(file).name}: {name} | {calls} | {own / total:.0%} |")


if __name__ == "__main__":
    main()
