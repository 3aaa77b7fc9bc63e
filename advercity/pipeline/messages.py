"""What a worker process is asked for, and what it answers."""

from dataclasses import dataclass
from typing import Annotated, Literal

from advercity_dsl import Spec
from pydantic import Field, TypeAdapter

from advercity.pipeline.options import RunOptions
from advercity.pipeline.progress import Progress


@dataclass(frozen=True)
class WorkerJob:
    """A scenario to run, and how.

    Attributes:
        spec: The scenario.
        options: How to run it.
        worker_count: How many make its frames.
        worker_index: Number of the one whose job this is; 0 has the scenario open, the others add
            to it.
    """

    spec: Spec
    options: RunOptions
    worker_count: int = 1
    worker_index: int = 0


@dataclass(frozen=True)
class ProgressMessage:
    """It has got so far."""

    progress: Progress
    kind: Literal["advanced"] = "advanced"


@dataclass(frozen=True)
class FailureMessage:
    """It failed for a reason that it knows."""

    error: Literal["InputError", "RunError", "BackendError"]
    text: str
    kind: Literal["failed"] = "failed"


WorkerMessage = Annotated[ProgressMessage | FailureMessage, Field(discriminator="kind")]
WORKER_MESSAGE: TypeAdapter[ProgressMessage | FailureMessage] = TypeAdapter(WorkerMessage)
