"""What goes to the process of a scenario, and what comes back from it, as JSON."""

from dataclasses import dataclass
from typing import Annotated, Literal

from advercity_dsl import Spec
from pydantic import Field, TypeAdapter

from advercity.runner.options import Options
from advercity.runner.progress import Progress


@dataclass(frozen=True)
class Job:
    """A scenario to run, and how.

    Attributes:
        spec: The scenario.
        options: How to run it.
        processes: How many make its frames.
        process: Number of the one whose job this is; 0 has the scenario open, the others add to it.
    """

    spec: Spec
    options: Options
    processes: int = 1
    process: int = 0


@dataclass(frozen=True)
class Advanced:
    """It has got so far."""

    progress: Progress
    kind: Literal["advanced"] = "advanced"


@dataclass(frozen=True)
class Failed:
    """It failed for a reason that it knows."""

    error: Literal["InputError", "RunError", "BackendError"]
    text: str
    kind: Literal["failed"] = "failed"


Event = Annotated[Advanced | Failed, Field(discriminator="kind")]
JOB = TypeAdapter(Job)
EVENT: TypeAdapter[Advanced | Failed] = TypeAdapter(Event)
