"""Make frames of one scenario: `python -m advercity.pipeline.worker_process EVENTS`.

It reads a `Job` from standard input and writes `Event`s, one a line, to the file descriptor EVENTS.
Standard input stays open as long as somebody waits for it: when it ends, so does everything that
this process has started, however the one who waited came to its end.
"""

import os
import pickle
import signal
import sys
from io import FileIO
from threading import Thread
from types import FrameType
from typing import Literal, NoReturn

from advercity.errors import AdvercityError, BackendError, InputError
from advercity.pipeline.messages import (
    WORKER_MESSAGE,
    FailureMessage,
    ProgressMessage,
    WorkerJob,
    WorkerMessage,
)
from advercity.pipeline.progress import Progress
from advercity.pipeline.scenario import add_frames, run_scenario


def main(events: FileIO) -> int:
    """Do the job; the exit code."""
    signal.signal(signal.SIGTERM, _exit_on_signal)
    job = pickle.load(sys.stdin.buffer)  # noqa: S301 - from the parent process
    Thread(target=_exit_when_parent_ends, args=(job,), daemon=True).start()

    def tell(event: WorkerMessage) -> None:
        events.write(WORKER_MESSAGE.dump_json(event) + b"\n")

    def report(progress: Progress) -> None:
        tell(ProgressMessage(progress))

    try:
        if job.worker_index:
            add_frames(job.spec, job.options, job.worker_index, report)
        else:
            run_scenario(job.spec, job.options, report, worker_count=job.worker_count)
    except AdvercityError as error:
        tell(FailureMessage(_error_name(error), str(error)))
        return 1
    return 0


def _exit_on_signal(number: int, frame: FrameType | None) -> NoReturn:
    """Close what is open, which nobody may interrupt once more."""
    signal.signal(signal.SIGTERM, _ignore_signal)
    sys.exit(128 + number)


def _ignore_signal(number: int, frame: FrameType | None) -> None:
    """A handler and not `SIG_IGN`, which those that are started meanwhile would inherit."""


def _error_name(error: AdvercityError) -> Literal["InputError", "RunError", "BackendError"]:
    if isinstance(error, InputError):
        return "InputError"
    return "BackendError" if isinstance(error, BackendError) else "RunError"


def _exit_when_parent_ends(job: WorkerJob) -> None:
    """Alone, if the group is another's."""
    while os.read(sys.stdin.fileno(), 1):
        pass
    if job.worker_index:
        os.kill(os.getpid(), signal.SIGKILL)
    else:
        os.killpg(os.getpgrp(), signal.SIGKILL)


if __name__ == "__main__":
    with FileIO(int(sys.argv[1]), "w") as stream:
        sys.exit(main(stream))
