"""Runs scenarios in a flat pool of worker processes on this machine.

The parent is the only supervisor. A free slot opens the next scenario; when none is left, it joins
the running scenario with the most unclaimed frames, whose workers take frames from one claim queue
(`FrameWriter.claim_frame`). Each worker is a new process: a crash leaves other scenarios running,
and memory is measured per scenario.
"""

import logging
import math
import os
import pickle
import signal
import subprocess
import sys
import tempfile
import time
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from multiprocessing import Pipe
from multiprocessing.connection import Connection, wait
from typing import IO, TypedDict

import psutil
from advercity_dsl import Spec

from advercity.dataset.index import IndexWriter
from advercity.errors import AdvercityError, RunError, describe_cause, report_temporary_errors
from advercity.pipeline.machine import (
    build_worker_environment,
    count_usable_cores,
    find_visible_gpus,
)
from advercity.pipeline.messages import (
    FINISH,
    FramesClaimed,
    Notice,
    ScenarioOpened,
    WorkerMessage,
    WorkerTask,
)
from advercity.pipeline.progress import Progress, RunListener, ScenarioResult, SilentListener
from advercity.pipeline.run_records import record_run
from advercity.processes import describe_end
from advercity.run_options import (
    ResourceLimits,
    RunOptions,
    RunResources,
    format_byte_size,
    format_duration,
)

POLL_INTERVAL_S = 0.25
TERMINATION_TIMEOUT_S, JOINER_TERMINATION_TIMEOUT_S = 10.0, 4.0
"""Time between SIGTERM and SIGKILL; the opening worker needs it to write the manifest."""
LOG_LINES_SHOWN = 12
"""Last lines of a dead worker's output in its error message."""
MIN_FRAMES_PER_WORKER = 16
"""Fewest frames worth one more worker: its start takes as long as some frames."""


class WorkerPool:
    """Runs a batch of scenarios with at most `worker_count` processes at a time.

    Args:
        specs: Scenarios, all with different ids.
        options: How to run them.
        resources: Processes at a time, and limits for each scenario.
        listener: Called from the thread that calls `run`.

    Raises:
        InputError: The output is a file.
    """

    def __init__(
        self,
        specs: Sequence[Spec],
        options: RunOptions,
        resources: RunResources,
        listener: RunListener,
    ) -> None:
        self._specs, self._options, self._listener = specs, options, listener
        self._limits, self._gpus = resources.limits, find_visible_gpus()
        self._worker_count = resources.worker_count
        self._cores_per_worker = count_usable_cores() // resources.worker_count
        self._free_slots = list(reversed(range(resources.worker_count)))
        self._is_new_output = not options.folder.exists()
        self._index = IndexWriter(options.folder, specs)
        self._waiting = deque(specs)
        self._running: list[_PooledScenario] = []
        self._results: dict[str, ScenarioResult] = {}
        self._notices: set[Notice] = set()
        self._measured_s = 0.0

    def run(self) -> list[ScenarioResult]:
        """Run every scenario to its end; return the results in the order of the specs.

        An exception, such as an interrupt, ends every worker before it is raised again.
        """
        try:
            while self._waiting or self._running:
                self._start_workers()
                for run in self._handle_events():
                    self._record_end(run)
        except BaseException:
            self._stop_all()
            raise
        finally:
            self._remove_empty_output()
        return [self._results[spec.id] for spec in self._specs]

    def _start_workers(self) -> None:
        while self._free_slots:
            run = self._select_scenario()
            if run is None:
                return
            slot = self._free_slots.pop()
            environment = build_worker_environment(slot, self._gpus, self._cores_per_worker)
            run.start_worker(slot, environment)

    def _select_scenario(self) -> "_PooledScenario | None":
        """Open the next scenario, or find the running one with the most frames left."""
        if self._waiting:
            run = _PooledScenario(self._waiting.popleft(), self._options, self._limits)
            self._running.append(run)
            return run
        joinable = [run for run in self._running if run.is_joinable]
        return max(joinable, key=lambda run: run.unclaimed_frames, default=None)

    def _handle_events(self) -> list["_PooledScenario"]:
        """Wait shortly for messages, handle them, enforce limits; return ended scenarios."""
        workers = {worker.connection: (run, worker) for run in self._running for worker in run.live}
        for connection in wait(list(workers), POLL_INTERVAL_S):
            run, worker = workers[connection]  # pyright: ignore[reportArgumentType]
            if self._receive(run, worker):
                self._listener.on_progress(run.progress)
        if time.monotonic() - self._measured_s > POLL_INTERVAL_S:
            for run in self._running:
                run.enforce_limits()
            self._measured_s = time.monotonic()
        for run in self._running:
            self._free_slots += run.advance()
        ended = [run for run in self._running if not run.workers]
        self._running = [run for run in self._running if run.workers]
        return ended

    def _receive(self, run: "_PooledScenario", worker: "_Worker") -> bool:
        """Handle one message; return whether it was progress."""
        try:
            message: WorkerMessage = worker.connection.recv()
        except (EOFError, OSError):
            worker.connection.close()
            return False
        if isinstance(message, AdvercityError):
            worker.failure = message
        elif isinstance(message, ScenarioOpened):
            run.missing_frames, run.opened_s = message.missing_frames, time.monotonic()
            self._record_start(run)
        elif isinstance(message, FramesClaimed):
            run.is_opener_waiting = True
        elif isinstance(message, Notice):
            self._repeat_notice(message)
        else:
            worker.record_progress(message)
            return True
        return False

    def _repeat_notice(self, notice: Notice) -> None:
        """Log a worker's notice once: several scenarios may report the same cache entry."""
        if notice not in self._notices:
            self._notices.add(notice)
            logging.getLogger(notice.logger).log(notice.level, notice.text)

    def _remove_empty_output(self) -> None:
        """Delete the folder of the dataset if this run created it and left it empty."""
        if self._is_new_output:
            with suppress(OSError):  # not empty, or not there
                self._options.folder.rmdir()

    def _record_start(self, run: "_PooledScenario") -> None:
        try:
            self._index.record_start(run.spec.id, missing_frames=run.missing_frames)
        except AdvercityError as error:
            run.error = run.error or error

    def _record_end(self, run: "_PooledScenario") -> None:
        self._remove_empty_output()  # the index needs an existing folder
        result = run.build_result()
        record_run(run.spec, self._options, result, self._worker_count)
        try:
            failed = result.error is not None
            self._index.record_result(result.scenario, failed=failed, refused=not run.has_begun)
        except AdvercityError as error:
            result = replace(result, error=result.error or error)
        self._results[result.scenario] = result
        self._listener.on_result(result)

    def _stop_all(self) -> None:
        """End all running workers, as after an interrupt."""
        self._listener = SilentListener()  # the listener may have raised the error
        try:
            for run in self._running:
                run.error = run.error or RunError("interrupted")
            while self._running:
                self._handle_events()
        finally:
            for run in self._running:
                run.send_signal(signal.SIGKILL)


class _Worker:
    """A worker process and its messages so far.

    Args:
        task: Frames to make.
        slot: Place among the workers running at a time.
        group: Process group to join; 0 is a new one.
        environment: Variables on top of this process's own.
    """

    def __init__(
        self, task: WorkerTask, slot: int, group: int, environment: dict[str, str]
    ) -> None:
        self.index, self.slot = task.worker_index, slot
        self.connection: Connection[str, WorkerMessage]
        self.connection, theirs = Pipe()
        self.last = Progress(task.spec.id, "starting")
        self.failure: AdvercityError | None = None
        self.kill_at_s = math.inf
        self.first_message_s: float | None = None
        self.first_frame: tuple[float, int] | None = None
        self.last_frame: tuple[float, int] | None = None
        with report_temporary_errors():
            self._log: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115 - closed by `reap`
            stdin = _store_task(task)
        with theirs, stdin:
            command = [sys.executable, "-m", "advercity.pipeline.worker_process"]
            try:
                self.process = subprocess.Popen(  # noqa: S603 - our own module
                    [*command, str(theirs.fileno()), str(os.getpid())],
                    stdin=stdin,
                    stdout=self._log,
                    stderr=self._log,
                    pass_fds=[theirs.fileno()],
                    process_group=group,
                    env={**os.environ, **environment},
                )
            except OSError as error:
                raise RunError(f"no process can be started: {describe_cause(error)}") from error

    @property
    def has_exited(self) -> bool:
        """Whether the process has ended and every message was received."""
        return self.connection.closed and self._peek_exit() is not None

    def _peek_exit(self) -> "os.waitid_result | None":
        # Unlike poll(), this does not reap: until `reap` no other process gets the id, so signals
        # to it and to its process group cannot hit a stranger.
        return os.waitid(os.P_PID, self.process.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT)

    def record_progress(self, progress: Progress) -> None:
        """Record the worker's progress, and the times of its first and latest frame."""
        now_s = time.monotonic()
        self.first_message_s = self.first_message_s or now_s
        # The first message about frames includes frames of earlier runs.
        if self.last.phase == progress.phase == "frames" and progress.done > self.last.done:
            self.last_frame = (now_s, progress.done)
            self.first_frame = self.first_frame or self.last_frame
        self.last = progress

    def find_error(self) -> AdvercityError | None:
        """Return the error of the exited process; None if it succeeded."""
        ended = self._peek_exit()
        if self.failure is not None or self.last.phase == "done" or ended is None:
            return self.failure
        has_exited = ended.si_code == os.CLD_EXITED
        cause = describe_end(ended.si_status if has_exited else -ended.si_status)
        self._log.seek(0)
        lines = self._log.read().decode(errors="replace").splitlines()[-LOG_LINES_SHOWN:]
        place = f"{self.last.phase} {self.last.done}"
        text = f"worker process ended ({cause}) in {place}; run the same command again to resume"
        return RunError(text, *(f"  {line}" for line in lines))

    def terminate(self) -> None:
        """Send SIGTERM at the first call, and SIGKILL at calls after the timeout."""
        now_s = time.monotonic()
        if self.kill_at_s == math.inf:
            timeout_s = JOINER_TERMINATION_TIMEOUT_S if self.index else TERMINATION_TIMEOUT_S
            self.kill_at_s = now_s + timeout_s
            self._send_signal(signal.SIGTERM)
        elif now_s > self.kill_at_s:
            self._send_signal(signal.SIGKILL)

    def _send_signal(self, number: int) -> None:
        with suppress(ProcessLookupError):
            os.kill(self.process.pid, number)

    def reap(self) -> None:
        """Release the exited process."""
        self.process.wait()
        self._log.close()


def _store_task(task: WorkerTask) -> IO[bytes]:
    """Store a task in a file: a pipe could be full before the worker reads it."""
    stream = tempfile.TemporaryFile()  # noqa: SIM115 - the worker's standard input
    pickle.dump(task, stream)
    stream.seek(0)
    return stream


class _Speed(TypedDict):
    setup_s: float
    frame_s: float | None


@dataclass
class _PooledScenario:
    """A running scenario and its workers, which form one process group."""

    spec: Spec
    options: RunOptions
    limits: ResourceLimits
    began_s: float = field(default_factory=time.monotonic)
    workers: list[_Worker] = field(default_factory=list["_Worker"])
    ended: list[_Worker] = field(default_factory=list["_Worker"])
    missing_frames: int = 0
    opened_s: float = 0.0
    is_opener_waiting: bool = False
    error: AdvercityError | None = None
    peak_memory_bytes: int = 0

    @property
    def live(self) -> list[_Worker]:
        """Workers with an open connection."""
        return [worker for worker in self.workers if not worker.connection.closed]

    @property
    def _opener(self) -> _Worker:
        return next(worker for worker in (*self.workers, *self.ended) if not worker.index)

    @property
    def has_begun(self) -> bool:
        """Whether the opening worker has opened the dataset."""
        return self._opener.last.phase in ("renderer", "frames", "done")

    @property
    def unclaimed_frames(self) -> int:
        """Number of unfinished frames."""
        return self.progress.total - self.progress.done

    @property
    def is_joinable(self) -> bool:
        """Whether one more worker is worth its start."""
        if self.error is not None or self.is_opener_waiting or not self.missing_frames:
            return False
        if self.options.viewer.is_enabled:
            return False  # a live view shows frames in their order, from one process
        is_new = self.unclaimed_frames == self.missing_frames
        spare = self.unclaimed_frames - len(self.workers)
        return spare >= (1 if is_new else MIN_FRAMES_PER_WORKER)

    @property
    def progress(self) -> Progress:
        """Progress of all workers together; only the opener's once it wrote the manifest."""
        last = self._opener.last
        if last.phase == "done":
            return last
        joined = [one.last for one in (*self.workers, *self.ended) if one.index]
        return replace(
            last,
            done=last.done + sum(one.done for one in joined),
            size_bytes=last.size_bytes + sum(one.size_bytes for one in joined),
        )

    def start_worker(self, slot: int, environment: dict[str, str]) -> None:
        """Start a worker: the first opens the scenario, the others join it."""
        index = len(self.workers) + len(self.ended)
        group = self.workers[0].process.pid if index else 0
        task = WorkerTask(self.spec, self.options, index)
        self.workers.append(_Worker(task, slot, group, environment))

    def enforce_limits(self) -> None:
        """Measure memory and time; end the scenario beyond its limits."""
        used_bytes = sum(_measure_memory(worker.process.pid) for worker in self.workers)
        self.peak_memory_bytes = max(self.peak_memory_bytes, used_bytes)
        count = len(self.workers)
        most_bytes = (self.limits.memory_bytes or math.inf) * count
        if self.error is not None:
            return
        if used_bytes > most_bytes:
            self.send_signal(signal.SIGKILL)
            subject = "it" if count == 1 else f"its {count} workers together"
            self.error = RunError(
                f"killed: used {format_byte_size(used_bytes)} of memory, more than the"
                f" {format_byte_size(most_bytes)} allowed for {subject}; raise `max_memory_bytes`"
            )
        elif time.monotonic() - self.began_s > (self.limits.time_s or math.inf):
            self.error = RunError(
                f"killed: took longer than {format_duration(self.limits.time_s or 0)}; run the"
                " same command again to resume, or raise `max_time_s`"
            )

    def advance(self) -> list[int]:
        """Reap ended workers, end those of a failed scenario; return the freed slots."""
        # Read once: a worker exiting meanwhile is handled at the next call, with its error.
        ended = [worker for worker in self.workers if worker.has_exited]
        for worker in ended:
            self.error = self.error or self._find_error(worker)
        joined = [worker for worker in self.workers if worker.index]
        if self.is_opener_waiting and not joined and self.error is None:
            self.is_opener_waiting = False
            with suppress(OSError):  # it may have been killed meanwhile
                self._opener.connection.send(FINISH)
        # The opener goes last: it writes the manifest of all finished frames, and its process id
        # is the group's.
        candidates = joined or self.workers
        if self.error is not None:
            for worker in candidates:
                worker.terminate()
        exited = [worker for worker in ended if worker in candidates]
        for worker in exited:
            if not worker.index:
                self.send_signal(signal.SIGKILL)  # leftover child processes
            worker.reap()
            self.workers.remove(worker)
            self.ended.append(worker)
        return [worker.slot for worker in exited]

    def _find_error(self, worker: _Worker) -> AdvercityError | None:
        error = worker.find_error()
        if error is None or not worker.index:
            return error
        count = len(self.workers) + len(self.ended)
        return type(error)(*f"worker {worker.index + 1} of {count}: {error}".splitlines())

    def send_signal(self, number: int) -> None:
        """Send a signal to every process of the scenario."""
        with suppress(ProcessLookupError, PermissionError):  # only zombies are left
            os.killpg(self._opener.process.pid, number)

    def build_result(self) -> ScenarioResult:
        """Return the result of the scenario."""
        progress = self.progress
        return ScenarioResult(
            scenario=self.spec.id,
            error=self.error,
            frames=progress.done,
            size_bytes=progress.size_bytes,
            time_s=time.monotonic() - self.began_s,
            peak_memory_bytes=self.peak_memory_bytes,
            worker_count=len(self.ended),
            **self._measure_speed(),
        )

    def _measure_speed(self) -> "_Speed":
        """Measure frames without each worker's first, which also builds the shaders."""
        spans = [
            (
                worker.last_frame[0] - worker.first_frame[0],
                worker.last_frame[1] - worker.first_frame[1],
            )
            for worker in self.ended
            if worker.first_frame is not None and worker.last_frame is not None
        ]
        frames = sum(count for _, count in spans)
        opener = self._opener
        if not frames or opener.first_frame is None:
            return {"setup_s": 0.0, "frame_s": None}
        frame_s = sum(time_s for time_s, _ in spans) / frames
        start_s = (opener.first_message_s or self.began_s) - self.began_s
        setup_s = start_s + opener.first_frame[0] - self.opened_s - frame_s
        return {"setup_s": max(0.0, setup_s), "frame_s": frame_s}


def _measure_memory(pid: int) -> int:
    """Measure resident bytes of a process and its descendants; shared pages count in each."""
    total_bytes = 0
    with suppress(psutil.NoSuchProcess):
        process = psutil.Process(pid)
        for member in (process, *process.children(recursive=True)):
            with suppress(psutil.Error):
                total_bytes += member.memory_info().rss
    return total_bytes
