"""Processes that make frames of a scenario beside the one that has it open."""

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from dataclasses import replace
from threading import Event as Flag
from types import TracebackType
from typing import Self

from advercity_dsl import Spec

from advercity.runner.gpus import seen_by, visible_gpus
from advercity.runner.job import Job
from advercity.runner.limits import Limits
from advercity.runner.options import Options
from advercity.runner.progress import Progress
from advercity.runner.supervision import Outcome, supervise


class Companions:
    """Some processes that make frames which nobody has claimed; a context manager.

    Each sees a graphics card of its own as far as there are any. A failure of one is raised by
    `check`, or at the end; an error of ours ends them all.

    Args:
        spec: What they make frames of.
        options: How.
        count: How many.
        lock: File descriptor that they hold open, so that nobody else takes the scenario over as
            long as one of them is alive.
        changed: Called from their threads whenever one has got on.
    """

    def __init__(
        self, spec: Spec, options: Options, count: int, *, lock: int, changed: Callable[[], None]
    ) -> None:
        self._spec, self._options, self._lock, self._changed = spec, options, lock, changed
        self._count = count
        self._gpus = visible_gpus() if count else ()
        self._pool = ThreadPoolExecutor(max(1, count))
        self._stop = Flag()
        self._last: dict[int, Progress] = {}
        self._runs: list[Future[Outcome]] = []

    @property
    def frames(self) -> int:
        """That they have made so far."""
        return sum(last.done for last in list(self._last.values()))

    @property
    def size_bytes(self) -> int:
        """Of files that they have written so far."""
        return sum(last.size_bytes for last in list(self._last.values()))

    def check(self) -> None:
        """Raise what one of them has failed of."""
        for run in self._runs:
            if run.done():
                error = run.result().error
                if error is not None:
                    raise error

    def __enter__(self) -> Self:
        self._runs = [self._pool.submit(self._run, number) for number in range(1, self._count + 1)]
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        try:
            if error is None:
                for _ in as_completed(self._runs):
                    self.check()
        finally:
            self._stop.set()
            self._pool.shutdown()

    def _run(self, number: int) -> Outcome:
        def report(progress: Progress) -> None:
            self._last[number] = progress
            self._changed()

        outcome = supervise(
            Job(self._spec, self._options, process=number),
            Limits(),
            report,
            environment=seen_by([number], self._gpus),
            stop=self._stop,
            keep_open=[self._lock],
            is_companion=True,
        )
        if outcome.error is None:
            return outcome
        who = f"process {number + 1} of {self._count + 1}"
        return replace(outcome, error=type(outcome.error)(f"{who}: {outcome.error}"))
