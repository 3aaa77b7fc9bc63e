"""Many scenarios, some at a time, each in a process of its own or in several.

Where scenarios are run: on this machine, or on a cluster.
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, replace
from itertools import pairwise
from queue import SimpleQueue
from threading import Event as Flag
from typing import Protocol

from advercity_dsl import Spec

from advercity.dataset.index import IndexWriter
from advercity.errors import InputError, RunError
from advercity.pipeline.machine import build_gpu_environment, find_visible_gpus
from advercity.pipeline.options import Progress, ResourceLimits, RunOptions, WorkerJob
from advercity.pipeline.workers import ScenarioResult, run_worker
from advercity.rendering.backend import load_backend


class RunListener(Protocol):
    """Somebody who watches; called from several threads."""

    def on_progress(self, progress: Progress) -> None:
        """A scenario has got so far."""
        ...

    def on_result(self, outcome: ScenarioResult) -> None:
        """A scenario has come to its end, good or bad."""
        ...


class SilentListener:
    """Ignores progress and results."""

    def on_progress(self, progress: Progress) -> None:
        """Do nothing."""

    def on_result(self, outcome: ScenarioResult) -> None:
        """Do nothing."""


def run_scenarios(
    specs: Sequence[Spec],
    options: RunOptions,
    *,
    listener: RunListener,
    jobs: int = 1,
    limits: ResourceLimits | None = None,
) -> list[ScenarioResult]:
    """Run every spec; how each ended, in the order of `specs`.

    One that fails, dies or is killed does not stop the others. If there are fewer scenarios than
    jobs, several processes make the frames of one, unless they are to be seen live. Graphics cards
    are shared out among the processes that run at a time. When this call is interrupted, the
    processes are ended first. The index of the folder tells how every one ended.

    Args:
        specs: What to run, all with different ids.
        options: How to run them.
        listener: Told of progress and ends.
        jobs: Processes at a time.
        limits: For each scenario.

    Raises:
        InputError: Two specs have the same id, or an option does not fit.
    """
    validate_batch(specs, options)
    gpus, stop, index = find_visible_gpus(), Flag(), IndexWriter(options.output, specs)
    free: SimpleQueue[range] = SimpleQueue()
    shares = divide_slots(jobs, len(specs))
    for share in shares:
        free.put(share)

    def one(spec: Spec) -> ScenarioResult:
        places = free.get()
        try:
            outcome = run_worker(
                WorkerJob(
                    spec, options, worker_count=1 if options.viewer.is_enabled else len(places)
                ),
                limits or ResourceLimits(),
                listener.on_progress,
                environment=build_gpu_environment(places, gpus),
                cancelled=stop,
            )
        finally:
            free.put(places)
        try:
            index.record_end(spec.id, failed=outcome.error is not None)
        except RunError as error:
            outcome = replace(outcome, error=outcome.error or error)
        listener.on_result(outcome)
        return outcome

    with ThreadPoolExecutor(len(shares)) as pool:
        try:
            runs = [pool.submit(one, spec) for spec in specs]
            for run in as_completed(runs):
                run.result()
        finally:
            stop.set()
            pool.shutdown(cancel_futures=True)
    return [run.result() for run in runs]


def divide_slots(jobs: int, scenarios: int) -> list[range]:
    """Places of processes, a range of them for each scenario that runs at a time."""
    count = max(1, min(jobs, scenarios))
    ends = [jobs * number // count for number in range(count + 1)]
    return [range(first, end) for first, end in pairwise(ends)]


def validate_batch(specs: Sequence[Spec], options: RunOptions) -> None:
    """Find out before anything is run what would go wrong with every spec.

    Raises:
        InputError: Two specs have the same id, or an option does not fit.
    """
    for name, count in Counter(spec.id for spec in specs).items():
        if count > 1:
            raise InputError(f"{name} is given {count} times; each may run once into an output")
    if len(specs) > 1 and options.viewer.is_enabled:
        raise InputError("--rrd, --stream and --connect show one scenario; run them one by one")
    load_backend(options.backend)


def raise_failures(outcomes: Iterable[ScenarioResult]) -> None:
    """Raise what failed: the error itself if one scenario was run, else a list of them.

    Raises:
        AdvercityError: The only scenario failed.
        RunError: Some of several failed; the text says which and why.
    """
    every = list(outcomes)
    failed = [(item.scenario, item.error) for item in every if item.error is not None]
    if len(every) == 1 and failed:
        raise failed[0][1]
    if failed:
        lines = [f"{name}: {error}" for name, error in failed]
        raise RunError("\n".join([*lines, f"{len(failed)} of {len(every)} scenarios failed"]))


class Executor(Protocol):
    """Runs scenarios somewhere."""

    def run(
        self,
        specs: Sequence[Spec],
        options: RunOptions,
        *,
        listener: RunListener,
        limits: ResourceLimits,
    ) -> list[ScenarioResult]:
        """Run every spec; how each ended, in the order of `specs`."""
        ...


@dataclass(frozen=True)
class LocalExecutor:
    """Scenarios in so many processes at a time on this machine."""

    jobs: int

    def run(
        self,
        specs: Sequence[Spec],
        options: RunOptions,
        *,
        listener: RunListener,
        limits: ResourceLimits,
    ) -> list[ScenarioResult]:
        """Run every spec; how each ended, in the order of `specs`."""
        return run_scenarios(specs, options, listener=listener, jobs=self.jobs, limits=limits)


def create_executor(name: str, *, output: str, address: str | None, jobs: int) -> Executor:
    """The executor of that name.

    Args:
        name: `local` or `ray`.
        output: Folder for the dataset; for Ray also the URL of a store.
        address: Of a Ray cluster; None is one on this machine alone.
        jobs: Processes at a time, on this machine; a cluster knows itself how many it takes.

    Raises:
        InputError: There is no such executor, or the rest does not fit it.
    """
    if name == "ray":
        from advercity.pipeline.cluster import RayExecutor, resolve_output

        return RayExecutor(resolve_output(output), address)
    if name != "local":
        raise InputError(f"--executor {name}: no such executor; local or ray")
    if address is not None:
        raise InputError("--address goes with --executor ray")
    if "://" in output:
        raise InputError(f"--output {output}: a store is reached with --executor ray")
    return LocalExecutor(jobs)
