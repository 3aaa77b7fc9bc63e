"""Work in a thread behind the one that renders: encoding and writing cost no time of their own."""

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from types import TracebackType
from typing import Self


class Behind:
    """Does jobs one after the other in a thread of its own; a context manager.

    One job is at work at most, so that memory holds two frames at most. An error of a job is
    raised by the next call, or at the end.
    """

    def __init__(self) -> None:
        self._pool = ThreadPoolExecutor(1)
        self._running: Future[None] | None = None

    def run(self, job: Callable[[], None]) -> None:
        """Wait for the job before, and start this one."""
        self._wait()
        self._running = self._pool.submit(job)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        with self._pool:
            if error is None:
                self._wait()

    def _wait(self) -> None:
        if self._running is not None:
            self._running.result()
