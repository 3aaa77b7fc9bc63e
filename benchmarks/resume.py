"""What running a finished scenario again, and verifying it, take: `python benchmarks/resume.py`.

A run that finds all of its frames finished only checks them; its time is given relative to the run
that made them. Verifying reads and hashes every file; its baseline is hashing the same files alone.
"""

import hashlib
import statistics
import tempfile
from collections.abc import Callable
from pathlib import Path

from measurement import Measurement, format_table, measure_run_time

from advercity.compiler import read_spec
from advercity.dataset.manifest import Manifest
from advercity.dataset.verification import verify_scenario
from advercity.pipeline import RunOptions, run_scenario

SPEC = Path("compiled/ui_fog_day_sparse.json")


def run_benchmark(*, quick: bool) -> list[Measurement]:
    """Measure resuming and verifying."""
    frames, rounds = (6, 3) if quick else (20, 7)
    spec = read_spec(SPEC)
    with tempfile.TemporaryDirectory() as folder:
        options = RunOptions(Path(folder), profile="preview", frames=slice(0, frames))
        made_s = _measure_s(lambda: run_scenario(spec, options))
        scenario = Path(folder) / spec.id
        files = [path for path in scenario.rglob("*") if path.is_file()]
        # In turns, so that each round of both has the same load of the machine.
        times = [
            (
                _measure_s(lambda: run_scenario(spec, options)),
                _measure_s(lambda: _hash_files(files)),
                _measure_s(lambda: verify_scenario(scenario)),
            )
            for _ in range(rounds)
        ]
        length = Manifest.load(scenario).length
    resumed_s, _, verified_s = map(statistics.median, zip(*times, strict=True))
    ratio = statistics.median(verified / hashed for _, hashed, verified in times)
    return [
        Measurement("resume a finished run", resumed_s / made_s, "making its frames", at_most=0.5),
        Measurement("verify", ratio, "reading and hashing alone", at_most=2.0),
        Measurement(f"verify all {length} frames", verified_s * length / frames, "s", at_most=10.0),
    ]


def _hash_files(files: list[Path]) -> None:
    for path in files:
        hashlib.sha256(path.read_bytes()).hexdigest()


def _measure_s(work: Callable[[], object]) -> float:
    return measure_run_time(work).wall_s


if __name__ == "__main__":
    print(format_table(run_benchmark(quick=False)))
