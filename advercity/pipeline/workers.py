"""Runs a job in a process of its own, and ends that when it takes too much.

Processes that make frames of a scenario beside the one that has it open.
"""

import math
import os
import pickle
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from contextlib import contextmanager, suppress
from dataclasses import replace
from select import select
from threading import Event as Flag
from types import TracebackType
from typing import IO, Self

import psutil
from advercity_dsl import Spec

from advercity.errors import AdvercityError, BackendError, InputError, RunError
from advercity.pipeline.machine import build_gpu_environment, find_visible_gpus
from advercity.pipeline.messages import WORKER_MESSAGE, FailureMessage, WorkerJob
from advercity.pipeline.options import (
    ResourceLimits,
    RunOptions,
    format_byte_size,
    format_duration,
)
from advercity.pipeline.progress import Progress, ProgressCallback, ScenarioResult

POLL_INTERVAL_S = 0.25
TERMINATION_TIMEOUT_S, HELPER_TERMINATION_TIMEOUT_S = 10.0, 4.0
"""For a process that was told to end, before it is killed; it may have companions to end itself."""
LOG_LINES_SHOWN = 12
"""Of what a process said before it died."""
ERROR_CLASSES = {"InputError": InputError, "RunError": RunError, "BackendError": BackendError}


class WorkerCancelled(Exception):
    """Nobody wants the scenario any more."""


def run_worker(
    job: WorkerJob,
    limits: ResourceLimits,
    report: ProgressCallback,
    *,
    environment: Mapping[str, str] | None = None,
    cancelled: Flag | None = None,
    inherited_files: Sequence[int] = (),
    is_helper: bool = False,
) -> ScenarioResult:
    """Run a job in a process of its own, within limits.

    It may die, or be killed; what is finished stays, and the same job goes on from there.

    Args:
        job: What to run.
        limits: Beyond which it is killed.
        report: Told of its progress.
        environment: Variables set for it on top of ours.
        cancelled: When it is set, the process is ended.
        inherited_files: File descriptors of ours that it has open, too.
        is_helper: It belongs to this process, whose own supervisor counts what it takes and ends
            it along with us; so nobody looks here.

    Raises:
        Stopped: By `stop`.
    """
    child = _WorkerProcess(job, limits, report, cancelled or Flag(), is_helper=is_helper)
    error: AdvercityError | None = None
    try:
        child.run({**os.environ, **(environment or {})}, inherited_files)
    except AdvercityError as caught:
        error = caught
    return ScenarioResult(
        scenario=job.spec.id,
        error=error,
        frames=child.last.done,
        size_bytes=child.last.size_bytes,
        time_s=time.monotonic() - child.began_s,
        peak_memory_bytes=child.peak_memory_bytes,
        cpu_s=child.cpu_s,
    )


class _WorkerProcess:
    """The process of one job."""

    def __init__(
        self,
        job: WorkerJob,
        limits: ResourceLimits,
        report: ProgressCallback,
        stop: Flag,
        *,
        is_helper: bool,
    ) -> None:
        self._job, self._limits, self._report, self._stop = job, limits, report, stop
        self._is_companion = is_helper
        self.began_s = time.monotonic()
        self.last = Progress(job.spec.id, "starting")
        self.peak_memory_bytes = 0
        self.cpu_s = 0.0
        self._failure: AdvercityError | None = None

    def run(self, environment: Mapping[str, str], inherited_files: Sequence[int]) -> None:
        """To its end; raises what it failed of."""
        reading, writing = os.pipe()
        with os.fdopen(reading, "rb", buffering=0) as events, tempfile.TemporaryFile() as said:
            command = [sys.executable, "-m", "advercity.pipeline.worker_process", str(writing)]
            try:
                process = subprocess.Popen(  # noqa: S603 - our own module
                    command,
                    stdin=subprocess.PIPE,
                    stdout=said,
                    stderr=said,
                    pass_fds=[writing, *inherited_files],
                    start_new_session=not self._is_companion,
                    env=environment,
                )
            finally:
                os.close(writing)
            with process, self._terminate_on_exit(process):
                self._send_job(process)
                for line in self._read_lines(process, events):
                    self._handle_message(line)
            if self._failure is not None:
                raise self._failure
            if self.last.phase != "done":
                raise RunError(self._describe_death(process.returncode, said))

    def _send_job(self, process: subprocess.Popen[bytes]) -> None:
        """Give it its job; its input stays open, for it ends when that does."""
        assert process.stdin is not None
        try:
            pickle.dump(self._job, process.stdin)
            process.stdin.flush()
        except BrokenPipeError:
            return  # it is dead already, and its exit code tells

    def _handle_message(self, line: bytes) -> None:
        event = WORKER_MESSAGE.validate_json(line)
        if isinstance(event, FailureMessage):
            self._failure = ERROR_CLASSES[event.error](event.text)
        else:
            self.last = event.progress
            self._report(event.progress)

    def _read_lines(self, process: subprocess.Popen[bytes], events: IO[bytes]) -> Iterator[bytes]:
        """What it writes, line by line, until it closes; raises if it takes too much meanwhile."""
        torn = b""
        watched_s = 0.0
        while True:
            if self._stop.is_set():
                raise WorkerCancelled
            if not self._is_companion and time.monotonic() - watched_s > POLL_INTERVAL_S:
                watched_s = time.monotonic()
                self._enforce_limits(process)
            if not select([events], [], [], POLL_INTERVAL_S)[0]:
                continue
            some = events.read(65536)
            if not some:
                return
            *lines, torn = (torn + some).split(b"\n")
            yield from lines

    def _enforce_limits(self, process: subprocess.Popen[bytes]) -> None:
        used, self.cpu_s = _measure_process_tree(process.pid)
        self.peak_memory_bytes = max(self.peak_memory_bytes, used)
        longest_s, count = self._limits.time_s, self._job.worker_count
        most = (self._limits.memory_bytes or math.inf) * count
        if used > most:
            self._send_signal(process, signal.SIGKILL)
            who = "it" if count == 1 else f"its {count} processes together"
            raise RunError(
                f"killed: took {format_byte_size(used)} of memory, more than the"
                f" {format_byte_size(most)} that {who} may; --max-memory allows more"
            )
        if longest_s is not None and time.monotonic() - self.began_s > longest_s:
            raise RunError(
                f"killed: took longer than {format_duration(longest_s)}; run again to go on from"
                " there, or allow more with --max-time"
            )

    @contextmanager
    def _terminate_on_exit(self, process: subprocess.Popen[bytes]) -> Generator[None]:
        """End a process and all that it started; at once if all is well, else after asking.

        Until it is reaped nobody else has its number.
        """
        try:
            yield
        except BaseException:
            self._send_signal(process, signal.SIGTERM)
            raise
        finally:
            patience_s = (
                HELPER_TERMINATION_TIMEOUT_S if self._is_companion else TERMINATION_TIMEOUT_S
            )
            patient_until_s = time.monotonic() + patience_s
            while _is_running(process) and time.monotonic() < patient_until_s:
                time.sleep(0.02)
            self._send_signal(process, signal.SIGKILL)

    def _send_signal(self, process: subprocess.Popen[bytes], number: int) -> None:
        """To the process and all that it started, which a companion shares with us."""
        with suppress(ProcessLookupError, PermissionError):  # only the dead are left
            if self._is_companion:
                os.kill(process.pid, number)
            else:
                os.killpg(process.pid, number)

    def _describe_death(self, code: int, said: IO[bytes]) -> str:
        how = f"exit code {code}"
        if code < 0:
            how = f"killed by {signal.Signals(-code).name}"
        text = f"its process died ({how}) in {self.last.phase} {self.last.done}; run again to go on"
        said.seek(0)
        words = said.read().decode(errors="replace").splitlines()[-LOG_LINES_SHOWN:]
        return "\n".join([text, *(f"  {line}" for line in words)])


def _measure_process_tree(pid: int) -> tuple[int, float]:
    """Bytes resident in a process and all below it, and seconds of processors; 0 when it has gone.

    What the processes below it took counts as long as they live, and once it has waited for them.
    """
    try:
        process = psutil.Process(pid)
        family = [process, *process.children(recursive=True)]
    except psutil.NoSuchProcess:
        return 0, 0.0
    taken = [_measure_process(member) for member in family]
    return sum(memory for memory, _ in taken), sum(cpu for _, cpu in taken)


def _measure_process(process: psutil.Process) -> tuple[int, float]:
    try:
        times = process.cpu_times()
        return process.memory_info().rss, sum(times[:4])
    except psutil.Error:
        return 0, 0.0


def _is_running(process: subprocess.Popen[bytes]) -> bool:
    return psutil.Process(process.pid).status() != psutil.STATUS_ZOMBIE


class WorkerGroup:
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
        self,
        spec: Spec,
        options: RunOptions,
        worker_count: int,
        *,
        lock: int,
        on_change: Callable[[], None],
    ) -> None:
        self._spec, self._options, self._lock, self._changed = spec, options, lock, on_change
        self._count = worker_count
        self._gpus = find_visible_gpus() if worker_count else ()
        self._pool = ThreadPoolExecutor(max(1, worker_count))
        self._stop = Flag()
        self._last: dict[int, Progress] = {}
        self._runs: list[Future[ScenarioResult]] = []

    @property
    def frame_count(self) -> int:
        """That they have made so far."""
        return sum(last.done for last in list(self._last.values()))

    @property
    def size_bytes(self) -> int:
        """Of files that they have written so far."""
        return sum(last.size_bytes for last in list(self._last.values()))

    def raise_failure(self) -> None:
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
                    self.raise_failure()
        finally:
            self._stop.set()
            self._pool.shutdown()

    def _run(self, number: int) -> ScenarioResult:
        def report(progress: Progress) -> None:
            self._last[number] = progress
            self._changed()

        outcome = run_worker(
            WorkerJob(self._spec, self._options, worker_index=number),
            ResourceLimits(),
            report,
            environment=build_gpu_environment([number], self._gpus),
            cancelled=self._stop,
            inherited_files=[self._lock],
            is_helper=True,
        )
        if outcome.error is None:
            return outcome
        who = f"process {number + 1} of {self._count + 1}"
        return replace(outcome, error=type(outcome.error)(f"{who}: {outcome.error}"))
