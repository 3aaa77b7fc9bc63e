"""Runs every compiled spec at a tiny scale in one batch, verifies it, and measures memory growth.

    python benchmarks/soak.py [compiled] [--output DIR] [--jobs 2] [--frames 1] [--scale 0.05]

Memory is that of the process which runs the batch, and the peak of each scenario's own processes
relative to the mean of its road and density; growth is a least-squares slope in the order in which
scenarios ended. Exit code 1 if a scenario fails, a file is missing or changed, or memory grows by
more than 1 MB per scenario. The same command with the same --output resumes an interrupted batch.
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
from advercity.run_options import format_byte_size, format_duration

MAX_GROWTH_MB = 1.0
"""Largest growth of memory per scenario."""


class MemoryLog:
    """Prints and keeps the memory at the end of each scenario.

    Attributes:
        own_mb: Memory of this process.
        peaks_mb: Peak memory of the scenario's processes.
        groups: Road and density of the scenario.
    """

    def __init__(self) -> None:
        self.own_mb: list[float] = []
        self.peaks_mb: list[float] = []
        self.groups: list[str] = []

    def on_progress(self, progress: Progress) -> None:
        """Print nothing."""

    def on_result(self, result: ScenarioResult) -> None:
        """Print one line."""
        self.own_mb.append(psutil.Process().memory_info().rss / 1e6)
        self.peaks_mb.append(result.peak_memory_bytes / 1e6)
        road, *_, density = result.scenario.split("_")
        self.groups.append(f"{road} {density}")
        outcome = f"FAILED: {result.error}" if result.error else f"{result.time_s:.1f} s"
        print(
            f"{len(self.own_mb):3} {result.scenario}: {outcome}, peak {self.peaks_mb[-1]:.0f} MB,"
            f" this process {self.own_mb[-1]:.1f} MB",
            flush=True,
        )


def main() -> int:
    """Run, verify, fit; 1 if anything is wrong."""
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
        log, start_s = MemoryLog(), time.perf_counter()
        results = run_scenarios(
            specs, options, listener=log, resources=RunResources(arguments.jobs)
        )
        wall_s = time.perf_counter() - start_s
        manifests = [Manifest.load(output / spec.id) for spec in specs]
        whole = sum(manifest.frames == tuple(range(arguments.frames)) for manifest in manifests)
        problems = verify_dataset(output)
    failed = sum(result.error is not None for result in results)
    slopes = [_fit_slope(log.own_mb), _fit_slope(_subtract_group_means(log.peaks_mb, log.groups))]
    print(f"{len(specs)} scenarios in {format_duration(wall_s)}, {failed} failed; {whole} complete")
    print(f"{sum(len(manifest.files) for manifest in manifests)} files,", end=" ")
    print(f"{format_byte_size(sum(result.size_bytes for result in results))},", end=" ")
    print(f"{len(problems)} differing from their manifests")
    print(f"memory growth per scenario: {slopes[0]:+.3f} MB here, {slopes[1]:+.3f} MB in scenarios")
    return int(bool(failed or problems or whole < len(specs) or max(slopes) > MAX_GROWTH_MB))


def _subtract_group_means(values: Sequence[float], groups: Sequence[str]) -> list[float]:
    """Subtract the mean of its group from each value."""
    _, members = np.unique(groups, return_inverse=True)
    means = np.bincount(members, values) / np.bincount(members)
    return (np.asarray(values) - means[members]).tolist()


def _fit_slope(values: Sequence[float]) -> float:
    """Fit the growth per scenario."""
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
