"""A process that makes frames of one scenario: `python -m advercity.runner.worker EVENTS`.

It reads a `Job` from standard input and writes `Event`s, one a line, to the file descriptor EVENTS.
Standard input stays open as long as somebody waits for it: when it ends, so does everything that
this process has started, however the one who waited came to its end.
"""

import os
import signal
import sys
from io import FileIO
from threading import Thread
from types import FrameType
from typing import Literal, NoReturn

from advercity.errors import AdvercityError, BackendError, InputError
from advercity.runner.job import EVENT, JOB, Advanced, Event, Failed, Job
from advercity.runner.progress import Progress
from advercity.runner.scenario import add_frames, run_scenario


def main(events: FileIO) -> int:
    """Do the job; the exit code."""
    signal.signal(signal.SIGTERM, _end_in_order)
    job = JOB.validate_json(sys.stdin.buffer.readline())
    Thread(target=_end_with_the_one_who_waits, args=(job,), daemon=True).start()

    def tell(event: Event) -> None:
        events.write(EVENT.dump_json(event) + b"\n")

    def report(progress: Progress) -> None:
        tell(Advanced(progress))

    try:
        if job.process:
            add_frames(job.spec, job.options, job.process, report)
        else:
            run_scenario(job.spec, job.options, report, processes=job.processes)
    except AdvercityError as error:
        tell(Failed(_kind(error), str(error)))
        return 1
    return 0


def _end_in_order(number: int, frame: FrameType | None) -> NoReturn:
    """Close what is open, which nobody may interrupt once more."""
    signal.signal(signal.SIGTERM, _be_about_it)
    sys.exit(128 + number)


def _be_about_it(number: int, frame: FrameType | None) -> None:
    """A handler and not `SIG_IGN`, which those that are started meanwhile would inherit."""


def _kind(error: AdvercityError) -> Literal["InputError", "RunError", "BackendError"]:
    if isinstance(error, InputError):
        return "InputError"
    return "BackendError" if isinstance(error, BackendError) else "RunError"


def _end_with_the_one_who_waits(job: Job) -> None:
    """Alone, if the group is another's."""
    while os.read(sys.stdin.fileno(), 1):
        pass
    if job.process:
        os.kill(os.getpid(), signal.SIGKILL)
    else:
        os.killpg(os.getpgrp(), signal.SIGKILL)


if __name__ == "__main__":
    with FileIO(int(sys.argv[1]), "w") as stream:
        sys.exit(main(stream))
