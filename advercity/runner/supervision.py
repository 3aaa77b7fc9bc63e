"""Runs a job in a process of its own, and ends that when it takes too much."""

import math
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from select import select
from threading import Event as Flag
from typing import IO

import psutil

from advercity.errors import AdvercityError, BackendError, InputError, RunError
from advercity.runner.job import EVENT, JOB, Failed, Job
from advercity.runner.limits import Limits, size_in_words, time_in_words
from advercity.runner.progress import Progress, Report

LOOK_EVERY_S = 0.25
PATIENCE_S, COMPANION_PATIENCE_S = 10.0, 4.0
"""For a process that was told to end, before it is killed; it may have companions to end itself."""
LINES_SHOWN = 12
"""Of what a process said before it died."""
ERRORS = {"InputError": InputError, "RunError": RunError, "BackendError": BackendError}


class Stopped(Exception):
    """Nobody wants the scenario any more."""


@dataclass(frozen=True)
class Outcome:
    """How a scenario came to its end.

    Attributes:
        scenario: Its id.
        error: Why it failed; None if it did not.
        frames: That were asked for and are there.
        size_bytes: Of the scenario's files.
        time_s: By the clock on the wall.
        peak_memory_bytes: The most that was seen resident in its processes at one time.
        cpu_s: Of processors, as far as was seen.
    """

    scenario: str
    error: AdvercityError | None
    frames: int
    size_bytes: int
    time_s: float
    peak_memory_bytes: int
    cpu_s: float = 0.0


def supervise(
    job: Job,
    limits: Limits,
    report: Report,
    *,
    environment: Mapping[str, str] | None = None,
    stop: Flag | None = None,
    keep_open: Sequence[int] = (),
    is_companion: bool = False,
) -> Outcome:
    """Run a job in a process of its own, within limits.

    It may die, or be killed; what is finished stays, and the same job goes on from there.

    Args:
        job: What to run.
        limits: Beyond which it is killed.
        report: Told of its progress.
        environment: Variables set for it on top of ours.
        stop: When it is set, the process is ended.
        keep_open: File descriptors of ours that it has open, too.
        is_companion: It belongs to this process, whose own supervisor counts what it takes and ends
            it along with us; so nobody looks here.

    Raises:
        Stopped: By `stop`.
    """
    child = _Child(job, limits, report, stop or Flag(), is_companion=is_companion)
    error: AdvercityError | None = None
    try:
        child.run({**os.environ, **(environment or {})}, keep_open)
    except AdvercityError as caught:
        error = caught
    return Outcome(
        scenario=job.spec.id,
        error=error,
        frames=child.last.done,
        size_bytes=child.last.size_bytes,
        time_s=time.monotonic() - child.began_s,
        peak_memory_bytes=child.peak_memory_bytes,
        cpu_s=child.cpu_s,
    )


class _Child:
    """The process of one job."""

    def __init__(
        self, job: Job, limits: Limits, report: Report, stop: Flag, *, is_companion: bool
    ) -> None:
        self._job, self._limits, self._report, self._stop = job, limits, report, stop
        self._is_companion = is_companion
        self.began_s = time.monotonic()
        self.last = Progress(job.spec.id, "starting")
        self.peak_memory_bytes = 0
        self.cpu_s = 0.0
        self._failure: AdvercityError | None = None

    def run(self, environment: Mapping[str, str], keep_open: Sequence[int]) -> None:
        """To its end; raises what it failed of."""
        reading, writing = os.pipe()
        with os.fdopen(reading, "rb", buffering=0) as events, tempfile.TemporaryFile() as said:
            command = [sys.executable, "-m", "advercity.runner.worker", str(writing)]
            try:
                process = subprocess.Popen(  # noqa: S603 - our own module
                    command,
                    stdin=subprocess.PIPE,
                    stdout=said,
                    stderr=said,
                    pass_fds=[writing, *keep_open],
                    start_new_session=not self._is_companion,
                    env=environment,
                )
            finally:
                os.close(writing)
            with process, self._gone_at_the_end(process):
                self._feed(process)
                for line in self._lines(process, events):
                    self._heed(line)
            if self._failure is not None:
                raise self._failure
            if self.last.stage != "done":
                raise RunError(self._last_words(process.returncode, said))

    def _feed(self, process: subprocess.Popen[bytes]) -> None:
        """Give it its job; its input stays open, for it ends when that does."""
        assert process.stdin is not None
        try:
            process.stdin.write(JOB.dump_json(self._job) + b"\n")
            process.stdin.flush()
        except BrokenPipeError:
            return  # it is dead already, and its exit code tells

    def _heed(self, line: bytes) -> None:
        event = EVENT.validate_json(line)
        if isinstance(event, Failed):
            self._failure = ERRORS[event.error](event.text)
        else:
            self.last = event.progress
            self._report(event.progress)

    def _lines(self, process: subprocess.Popen[bytes], events: IO[bytes]) -> Iterator[bytes]:
        """What it writes, line by line, until it closes; raises if it takes too much meanwhile."""
        torn = b""
        watched_s = 0.0
        while True:
            if self._stop.is_set():
                raise Stopped
            if not self._is_companion and time.monotonic() - watched_s > LOOK_EVERY_S:
                watched_s = time.monotonic()
                self._watch(process)
            if not select([events], [], [], LOOK_EVERY_S)[0]:
                continue
            some = events.read(65536)
            if not some:
                return
            *lines, torn = (torn + some).split(b"\n")
            yield from lines

    def _watch(self, process: subprocess.Popen[bytes]) -> None:
        used, self.cpu_s = _taken_by(process.pid)
        self.peak_memory_bytes = max(self.peak_memory_bytes, used)
        longest_s, count = self._limits.time_s, self._job.processes
        most = (self._limits.memory_bytes or math.inf) * count
        if used > most:
            self._signal(process, signal.SIGKILL)
            who = "it" if count == 1 else f"its {count} processes together"
            raise RunError(
                f"killed: took {size_in_words(used)} of memory, more than the"
                f" {size_in_words(most)} that {who} may; --max-memory allows more"
            )
        if longest_s is not None and time.monotonic() - self.began_s > longest_s:
            raise RunError(
                f"killed: took longer than {time_in_words(longest_s)}; run again to go on from"
                " there, or allow more with --max-time"
            )

    @contextmanager
    def _gone_at_the_end(self, process: subprocess.Popen[bytes]) -> Generator[None]:
        """End a process and all that it started; at once if all is well, else after asking.

        Until it is reaped nobody else has its number.
        """
        try:
            yield
        except BaseException:
            self._signal(process, signal.SIGTERM)
            raise
        finally:
            patience_s = COMPANION_PATIENCE_S if self._is_companion else PATIENCE_S
            patient_until_s = time.monotonic() + patience_s
            while _is_alive(process) and time.monotonic() < patient_until_s:
                time.sleep(0.02)
            self._signal(process, signal.SIGKILL)

    def _signal(self, process: subprocess.Popen[bytes], number: int) -> None:
        """To the process and all that it started, which a companion shares with us."""
        with suppress(ProcessLookupError, PermissionError):  # only the dead are left
            if self._is_companion:
                os.kill(process.pid, number)
            else:
                os.killpg(process.pid, number)

    def _last_words(self, code: int, said: IO[bytes]) -> str:
        how = f"exit code {code}"
        if code < 0:
            how = f"killed by {signal.Signals(-code).name}"
        text = f"its process died ({how}) in {self.last.stage} {self.last.done}; run again to go on"
        said.seek(0)
        words = said.read().decode(errors="replace").splitlines()[-LINES_SHOWN:]
        return "\n".join([text, *(f"  {line}" for line in words)])


def _taken_by(pid: int) -> tuple[int, float]:
    """Bytes resident in a process and all below it, and seconds of processors; 0 when it has gone.

    What the processes below it took counts as long as they live, and once it has waited for them.
    """
    try:
        process = psutil.Process(pid)
        family = [process, *process.children(recursive=True)]
    except psutil.NoSuchProcess:
        return 0, 0.0
    taken = [_taken(member) for member in family]
    return sum(memory for memory, _ in taken), sum(cpu for _, cpu in taken)


def _taken(process: psutil.Process) -> tuple[int, float]:
    try:
        times = process.cpu_times()
        return process.memory_info().rss, sum(times[:4])
    except psutil.Error:
        return 0, 0.0


def _is_alive(process: subprocess.Popen[bytes]) -> bool:
    return psutil.Process(process.pid).status() != psutil.STATUS_ZOMBIE
