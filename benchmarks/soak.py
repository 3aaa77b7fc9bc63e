"""Runs every compiled spec at a tiny scale in one go, and tells whether memory grows meanwhile.

    python benchmarks/soak.py [compiled] [--output DIR] [--jobs 2] [--frames 1] [--scale 0.05]

Memory is that of the process which runs them all, and the most that each scenario's own took, less
what those of its road and density take in the mean; in the order in which scenarios ended, by least
squares. Exit code 1 if a scenario fails,
a file is missing or changed, or a slope is above 1 MB a scenario. The same command with the same
--output goes on where it was interrupted.
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import psutil

from advercity.compiler import read_spec
from advercity.dataset.manifest import Manifest
from advercity.dataset.verification import verify_dataset
from advercity.pipeline import Progress, RunOptions, RunResources, ScenarioResult, run_scenarios
from advercity.pipeline.options import format_byte_size, format_duration

MOST_MB = 1.0
"""That memory may grow with every scenario."""


class Log:
    """Prints and keeps how scenarios end, and what memory this process has then."""

    def __init__(self) -> None:
        self.own_mb: list[float] = []
        self.peaks_mb: list[float] = []
        self.alike: list[str] = []

    def on_progress(self, progress: Progress) -> None:
        """Nothing to print."""

    def on_result(self, result: ScenarioResult) -> None:
        """One line."""
        self.own_mb.append(psutil.Process().memory_info().rss / 1e6)
        self.peaks_mb.append(result.peak_memory_bytes / 1e6)
        road, *_, density = result.scenario.split("_")
        self.alike.append(f"{road} {density}")
        told = f"FAILED: {result.error}" if result.error else f"{result.time_s:.1f} s"
        print(
            f"{len(self.own_mb):3} {result.scenario}: {told}, peak {self.peaks_mb[-1]:.0f} MB,"
            f" here {self.own_mb[-1]:.1f} MB",
            flush=True,
        )


def main() -> int:
    """Run, verify, fit; 1 if anything is not as it should be."""
    arguments = _arguments()
    specs = [read_spec(path) for path in sorted(arguments.folder.glob("*.json"))]
    with tempfile.TemporaryDirectory() as folder:
        output = arguments.output or Path(folder)
        options = RunOptions(
            output,
            profile="preview",
            scale=arguments.scale,
            frames=slice(0, arguments.frames),
        )
        log, began_s = Log(), time.perf_counter()
        results = run_scenarios(
            specs, options, listener=log, resources=RunResources(arguments.jobs)
        )
        took_s = time.perf_counter() - began_s
        manifests = [Manifest.load(output / spec.id) for spec in specs]
        whole = sum(manifest.frames == tuple(range(arguments.frames)) for manifest in manifests)
        problems = verify_dataset(output)
    failed = sum(result.error is not None for result in results)
    slopes = [_slope(log.own_mb), _slope(_less_the_mean(log.peaks_mb, log.alike))]
    print(f"{len(specs)} scenarios in {format_duration(took_s)}, {failed} failed; {whole} whole")
    print(f"{sum(len(manifest.files) for manifest in manifests)} files,", end=" ")
    print(f"{format_byte_size(sum(result.size_bytes for result in results))},", end=" ")
    print(f"{len(problems)} not as their manifests say")
    print(f"memory here {slopes[0]:+.3f} MB a scenario, in their processes {slopes[1]:+.3f}")
    return int(bool(failed or problems or whole < len(specs) or max(slopes) > MOST_MB))


def _less_the_mean(values: Sequence[float], alike: Sequence[str]) -> list[float]:
    """Of those that are alike."""
    _, members = np.unique(alike, return_inverse=True)
    means = np.bincount(members, values) / np.bincount(members)
    return (np.asarray(values) - means[members]).tolist()


def _slope(values: Sequence[float]) -> float:
    """MB a scenario."""
    return float(np.polynomial.Polynomial.fit(range(len(values)), values, 1).convert().coef[1])


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=Path("compiled"))
    parser.add_argument("--output", type=Path)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--frames", type=int, default=1)
    parser.add_argument("--scale", type=float, default=0.05)
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
