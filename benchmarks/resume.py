"""What running a finished scenario again, and verifying it, take: `python benchmarks/resume.py`.

A run that finds all of its frames done only looks; its time is told in frames of the run that made
them. Verifying reads every file and hashes it; its peer is hashing the same files alone.
"""

import hashlib
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from measurement import Figure, table

from advercity.compiler import read_spec
from advercity.dataset.manifest import Manifest
from advercity.dataset.verification import verify_scenario
from advercity.pipeline import RunOptions, run_scenario

SPEC = Path("compiled/ui_fog_day_sparse.json")


def figures(*, quick: bool) -> list[Figure]:
    """Resuming and verifying."""
    frames, rounds = (6, 3) if quick else (20, 7)
    spec = read_spec(SPEC)
    with tempfile.TemporaryDirectory() as folder:
        options = RunOptions(Path(folder), profile="preview", frames=slice(0, frames))
        made_s = _seconds(lambda: run_scenario(spec, options))
        scenario = Path(folder) / spec.id
        files = [path for path in scenario.rglob("*") if path.is_file()]
        resumed: list[float] = []
        hashed: list[float] = []
        verified: list[float] = []
        for _ in range(rounds):
            resumed.append(_seconds(lambda: run_scenario(spec, options)))
            hashed.append(_seconds(lambda: _hash(files)))
            verified.append(_seconds(lambda: verify_scenario(scenario)))
        length = Manifest.load(scenario).length
    resumed_s, verified_s = statistics.median(resumed), statistics.median(verified)
    ratio = statistics.median(v / h for v, h in zip(verified, hashed, strict=True))
    return [
        Figure("resume a finished run", resumed_s / made_s, "making its frames", at_most=0.5),
        Figure("verify", ratio, "reading and hashing alone", at_most=2.0),
        Figure(f"verify all {length} frames", verified_s * length / frames, "s", at_most=10.0),
    ]


def _hash(files: list[Path]) -> None:
    for path in files:
        hashlib.sha256(path.read_bytes()).hexdigest()


def _seconds(act: Callable[[], object]) -> float:
    begin = time.perf_counter()
    act()
    return time.perf_counter() - begin


if __name__ == "__main__":
    print(table(figures(quick=False)))
