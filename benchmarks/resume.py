"""What durable files, running a finished scenario again, and verifying it take.

    python benchmarks/resume.py

Frames are synced to the disk before a journal lists them; the baseline is the same run without
that.

A run that finds all of its frames finished only checks them; its time is given relative to the run
that made them. A run in two parts, the second of which goes on after the first, is compared by
processor time with one that makes all frames at once, with the fake backend. Verifying reads and
hashes every file; its baseline is hashing the same files alone.
"""

import hashlib
import statistics
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

from advercity_dsl import Spec
from measurement import Measurement, cpu_with_children_s, format_table, measure_run_time

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
        durable = [_measure_durability(spec, options, Path(folder)) for _ in range(rounds)]
        halves = 20 if quick else 200
        in_parts = _measure_parts(spec, Path(folder), halves)
    resumed_s, _, verified_s = map(statistics.median, zip(*times, strict=True))
    ratio = statistics.median(verified / hashed for _, hashed, verified in times)
    return [
        Measurement(
            "frames synced to the disk", statistics.median(durable), "not synced", at_most=1.1
        ),
        Measurement(f"{halves} frames in two runs", in_parts, "in one", at_most=1.5),
        Measurement("resume a finished run", resumed_s / made_s, "making its frames", at_most=0.5),
        Measurement("verify", ratio, "reading and hashing alone", at_most=2.0),
        Measurement(f"verify all {length} frames", verified_s * length / frames, "s", at_most=10.0),
    ]


def _measure_durability(spec: Spec, options: RunOptions, folder: Path) -> float:
    """Measure the time of a run relative to one that leaves the disk to the system."""
    synced = _measure_fresh_run_s(spec, options, folder)
    with patch("advercity.dataset.writer.sync_files"):
        return synced / _measure_fresh_run_s(spec, options, folder)


def _measure_fresh_run_s(spec: Spec, options: RunOptions, folder: Path) -> float:
    with tempfile.TemporaryDirectory(dir=folder) as output:
        return _measure_s(lambda: run_scenario(spec, replace(options, output=Path(output))))


def _measure_parts(spec: Spec, folder: Path, frames: int) -> float:
    """Measure the processor time of a run in two halves relative to one at once."""
    options = RunOptions(folder / "warm-up", backend="fake", profile="preview", scale=0.05)
    run_scenario(spec, replace(options, frames=slice(0, 1)))
    times_s: list[float] = []
    for name, ends in (("halves", (frames // 2, frames)), ("whole", (frames,))):
        before_s = cpu_with_children_s()
        for end in ends:
            run_scenario(spec, replace(options, output=folder / name, frames=slice(0, end)))
        times_s.append(cpu_with_children_s() - before_s)
    if Manifest.load(folder / "halves" / spec.id) != Manifest.load(folder / "whole" / spec.id):
        raise RuntimeError("a run in two parts has other bytes than one at once")
    halves_s, whole_s = times_s
    return halves_s / whole_s


def _hash_files(files: list[Path]) -> None:
    for path in files:
        hashlib.sha256(path.read_bytes()).hexdigest()


def _measure_s(work: Callable[[], object]) -> float:
    return measure_run_time(work).wall_s


if __name__ == "__main__":
    print(format_table(run_benchmark(quick=False)))
