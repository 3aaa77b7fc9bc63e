"""Many scenarios, some at a time, each in a process of its own or in several."""

from collections import Counter
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import replace
from itertools import pairwise
from queue import SimpleQueue
from threading import Event as Flag
from typing import Protocol

from advercity_dsl import Spec

from advercity.dataset.index import FolderIndex
from advercity.errors import InputError, RunError
from advercity.rendering.registry import load_backend
from advercity.runner.gpus import seen_by, visible_gpus
from advercity.runner.job import Job
from advercity.runner.limits import Limits
from advercity.runner.options import Options
from advercity.runner.progress import Progress
from advercity.runner.supervision import Outcome, supervise


class Watcher(Protocol):
    """Somebody who watches; called from several threads."""

    def advanced(self, progress: Progress) -> None:
        """A scenario has got so far."""
        ...

    def finished(self, outcome: Outcome) -> None:
        """A scenario has come to its end, good or bad."""
        ...


def run_all(
    specs: Sequence[Spec],
    options: Options,
    *,
    watcher: Watcher,
    jobs: int = 1,
    limits: Limits | None = None,
) -> list[Outcome]:
    """Run every spec; how each ended, in the order of `specs`.

    One that fails, dies or is killed does not stop the others. If there are fewer scenarios than
    jobs, several processes make the frames of one, unless they are to be seen live. Graphics cards
    are shared out among the processes that run at a time. When this call is interrupted, the
    processes are ended first. The index of the folder tells how every one ended.

    Args:
        specs: What to run, all with different ids.
        options: How to run them.
        watcher: Told of progress and ends.
        jobs: Processes at a time.
        limits: For each scenario.

    Raises:
        InputError: Two specs have the same id, or an option does not fit.
    """
    check_together(specs, options)
    gpus, stop, index = visible_gpus(), Flag(), FolderIndex(options.output, specs)
    free: SimpleQueue[range] = SimpleQueue()
    shares = shared_out(jobs, len(specs))
    for share in shares:
        free.put(share)

    def one(spec: Spec) -> Outcome:
        places = free.get()
        try:
            outcome = supervise(
                Job(spec, options, processes=1 if options.viewer.is_asked_for else len(places)),
                limits or Limits(),
                watcher.advanced,
                environment=seen_by(places, gpus),
                stop=stop,
            )
        finally:
            free.put(places)
        try:
            index.ended(spec.id, failed=outcome.error is not None)
        except RunError as error:
            outcome = replace(outcome, error=outcome.error or error)
        watcher.finished(outcome)
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


def shared_out(jobs: int, scenarios: int) -> list[range]:
    """Places of processes, a range of them for each scenario that runs at a time."""
    count = max(1, min(jobs, scenarios))
    ends = [jobs * number // count for number in range(count + 1)]
    return [range(first, end) for first, end in pairwise(ends)]


def check_together(specs: Sequence[Spec], options: Options) -> None:
    """Find out before anything is run what would go wrong with every spec.

    Raises:
        InputError: Two specs have the same id, or an option does not fit.
    """
    for name, count in Counter(spec.id for spec in specs).items():
        if count > 1:
            raise InputError(f"{name} is given {count} times; each may run once into an output")
    if len(specs) > 1 and options.viewer.is_asked_for:
        raise InputError("--rrd, --stream and --connect show one scenario; run them one by one")
    load_backend(options.backend)


def raise_failures(outcomes: Iterable[Outcome]) -> None:
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
