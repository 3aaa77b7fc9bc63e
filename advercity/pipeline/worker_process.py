"""Makes frames of one scenario: `python -m advercity.pipeline.worker_process DESCRIPTOR PARENT`.

Standard input holds a pickled `WorkerTask`; DESCRIPTOR is one end of a `multiprocessing.Pipe`,
PARENT the parent's process id. When the parent ends, every process of the scenario is killed.
"""

import logging
import os
import pickle
import signal
import sys
from collections.abc import Generator
from contextlib import contextmanager
from multiprocessing.connection import Connection
from threading import Event, Thread
from types import FrameType
from typing import TYPE_CHECKING, NoReturn

from advercity.errors import AdvercityError, explain_system_error
from advercity.pipeline.messages import (
    FramesClaimed,
    Notice,
    ScenarioOpened,
    WorkerMessage,
    WorkerTask,
)
from advercity.pipeline.scenario import join_scenario, run_scenario
from advercity.processes import end_with_parent, ignore_signal

if TYPE_CHECKING:
    Parent = Connection[WorkerMessage, str]


class NoticeHandler(logging.Handler):
    """Sends the log to the parent process."""

    def __init__(self, parent: "Parent") -> None:
        super().__init__()
        self._parent = parent

    def emit(self, record: logging.LogRecord) -> None:
        """Send a record."""
        self._parent.send(Notice(record.name, record.levelno, record.getMessage()))


def main(parent: "Parent") -> int:
    """Do the task; return the exit code."""
    signal.signal(signal.SIGTERM, _exit_on_signal)
    task: WorkerTask = pickle.load(sys.stdin.buffer)  # noqa: S301 - written by the parent
    logging.getLogger("advercity").addHandler(NoticeHandler(parent))
    may_finish = Event()
    Thread(target=_follow_parent, args=(parent, may_finish), daemon=True).start()

    @contextmanager
    def share_frames(missing_frames: int) -> Generator[None]:
        parent.send(ScenarioOpened(missing_frames))
        yield
        parent.send(FramesClaimed())
        may_finish.wait()

    try:
        if task.worker_index:
            join_scenario(task.spec, task.options, task.worker_index, parent.send)
        else:
            run_scenario(task.spec, task.options, parent.send, share_frames=share_frames)
    except AdvercityError as error:
        parent.send(error)
        return 1
    except (OSError, MemoryError) as error:
        parent.send(explain_system_error(error))
        return 1
    return 0


def _follow_parent(parent: "Parent", may_finish: Event) -> None:
    """Wait for `FINISH`; when the parent is gone, kill the process group with hung workers."""
    try:
        while True:
            parent.recv()
            may_finish.set()
    except (EOFError, OSError):
        os.killpg(os.getpgrp(), signal.SIGKILL)


def _exit_on_signal(number: int, frame: FrameType | None) -> NoReturn:
    """Exit and close resources; a second signal must not interrupt this."""
    signal.signal(signal.SIGTERM, ignore_signal)
    sys.exit(128 + number)


if __name__ == "__main__":
    end_with_parent(int(sys.argv[2]))
    sys.exit(main(Connection(int(sys.argv[1]))))
