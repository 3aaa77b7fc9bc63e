"""The common form of what benchmarks measure: values against a baseline or a goal, and clocks.

Each benchmark has `run_benchmark(quick=...)`; `python benchmarks/bench.py` runs them all. A value
that misses its goal is a finding, not a failure: the table shows it, and the exit code stays 0.
"""

import os
import statistics
import subprocess
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Generator, Iterable, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Any
from unittest.mock import patch


@dataclass(frozen=True)
class Measurement:
    """A median of several rounds.

    Attributes:
        what: The quantity.
        value: Usually a ratio, which holds on any machine and under any load.
        against: Baseline of a ratio, or the unit.
        at_most: Goal.
        at_least: Goal.
    """

    what: str
    value: float
    against: str
    at_most: float | None = None
    at_least: float | None = None

    @property
    def meets_goal(self) -> bool:
        """Whether the value is within its goals; True if it has none."""
        low, high = self.at_least, self.at_most
        return (low is None or self.value >= low) and (high is None or self.value <= high)

    @property
    def goal(self) -> str:
        """The goals in words, empty if there are none."""
        limits = ("at least", self.at_least), ("at most", self.at_most)
        return ", ".join(f"{word} {limit:g}" for word, limit in limits if limit is not None)


def format_table(measurements: Iterable[Measurement]) -> str:
    """Format measurements as a table in Markdown."""
    rows = ["| measurement | value | baseline | goal | |", "|---|---|---|---|---|"]
    for one in measurements:
        verdict = ("met" if one.meets_goal else "MISSED") if one.goal else ""
        rows.append(f"| {one.what} | {one.value:.3g} | {one.against} | {one.goal} | {verdict} |")
    return "\n".join(rows)


@dataclass
class RunTime:
    """Seconds that something took, by the clock and of processors."""

    wall_s: float = 0.0
    cpu_s: float = 0.0


def cpu_with_children_s() -> float:
    """Read the processor time of this process and of all children that have ended."""
    return sum(os.times()[:4])


def measure_run_time(
    work: Callable[[], object], cpu_clock: Callable[[], float] = time.process_time
) -> RunTime:
    """Measure one call."""
    wall_s, cpu_s = time.perf_counter(), cpu_clock()
    work()
    return RunTime(time.perf_counter() - wall_s, cpu_clock() - cpu_s)


def measure_median_cpu_s(
    work: Callable[[], object],
    rounds: int,
    *,
    warm_up: int = 0,
    clock: Callable[[], float] = time.process_time,
) -> float:
    """Measure the median of processor time; the calls of the warm-up do not count."""
    times = [measure_run_time(work, clock).cpu_s for _ in range(warm_up + rounds)]
    return statistics.median(times[warm_up:])


def measure_command_cpu_s(rounds: int, *command: str) -> float:
    """Measure the median of a command's processor time."""
    return measure_median_cpu_s(
        lambda: subprocess.run(command, check=True, capture_output=True),
        rounds,
        clock=cpu_with_children_s,
    )


class Stopwatch:
    """Adds up the time of calls by stage, over all threads.

    Attributes:
        stages: Time by stage.
    """

    def __init__(self) -> None:
        self.stages: defaultdict[str, RunTime] = defaultdict(RunTime)
        self._lock = threading.Lock()

    def wrap(self, stage: str, call: Callable[..., Any]) -> Callable[..., Any]:
        """Return the same call, timed as part of a stage."""

        def timed(*arguments: Any, **keywords: Any) -> Any:
            wall_s, cpu_s = time.perf_counter(), time.thread_time()
            result = call(*arguments, **keywords)
            wall_s, cpu_s = time.perf_counter() - wall_s, time.thread_time() - cpu_s
            with self._lock:
                self.stages[stage].wall_s += wall_s
                self.stages[stage].cpu_s += cpu_s
            return result

        return timed

    @contextmanager
    def instrument(
        self, stages: Mapping[str, Iterable[tuple[object, str]]]
    ) -> Generator["Stopwatch", None, None]:
        """Time the calls of each stage, given as owners and attribute names, within a block."""
        with ExitStack() as stack:
            for stage, calls in stages.items():
                for owner, name in calls:
                    timed = self.wrap(stage, getattr(owner, name))
                    stack.enter_context(patch.object(owner, name, timed))
            yield self
