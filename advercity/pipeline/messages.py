"""Messages between a run and its worker processes, pickled."""

from dataclasses import dataclass

from advercity_dsl import Spec

from advercity.errors import AdvercityError
from advercity.pipeline.progress import Progress
from advercity.run_options import RunOptions


@dataclass(frozen=True)
class WorkerTask:
    """Make frames of a scenario.

    Attributes:
        spec: The scenario.
        options: How to run it.
        worker_index: 0 opens the scenario, and later writes its manifest; the others join it.
    """

    spec: Spec
    options: RunOptions
    worker_index: int = 0


@dataclass(frozen=True)
class ScenarioOpened:
    """From the worker opening a scenario: others may join now.

    Attributes:
        missing_frames: Number of frames to make.
    """

    missing_frames: int


@dataclass(frozen=True)
class FramesClaimed:
    """From the worker opening a scenario: all frames are claimed, and it waits for the others.

    The parent answers `FINISH` when they have ended.
    """


@dataclass(frozen=True)
class Notice:
    """A worker's log record, which the parent adds to its own log.

    Attributes:
        logger: Name of the logger.
        level: Level of the record.
        text: The message.
    """

    logger: str
    level: int
    text: str


FINISH = "finish"

WorkerMessage = Progress | ScenarioOpened | FramesClaimed | Notice | AdvercityError
"""An error is the last message of a failing worker."""
