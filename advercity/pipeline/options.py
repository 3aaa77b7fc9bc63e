"""What a run is asked for, besides its spec.

How much memory and time a scenario may take, as people write them.

What those who run scenarios tell those who watch.

What goes to the process of a scenario, and what comes back from it, as JSON.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

from advercity_dsl import Spec
from pydantic import Field, TypeAdapter

from advercity.dataset.formats import find_format
from advercity.errors import InputError
from advercity.viewer.cloud_colours import CloudColour


@dataclass(frozen=True)
class FrameRange:
    """Kept frames to make: `first` to `last`, which is not included, every `step`-th.

    `last` None means to the end.
    """

    first: int = 0
    last: int | None = None
    step: int = 1

    def to_range(self, count: int) -> range:
        """The frames of a scenario that has `count` of them."""
        last = count if self.last is None else min(self.last, count)
        return range(self.first, last, self.step)


def parse_frame_range(text: str | None) -> FrameRange:
    """`A:B[:STEP]` as a range; either end may be left out. InputError if it is something else."""
    if text is None:
        return FrameRange()
    match = re.fullmatch(r"(\d*):(\d*)(?::(\d+))?", text)
    if match is None:
        raise InputError(f"--frames {text}: not a range; write A:B or A:B:STEP, as 0:30")
    first, last, step = (int(part) if part else None for part in match.groups())
    if step == 0 or (last is not None and last <= (first or 0)):
        raise InputError(f"--frames {text}: holds no frame; B must be above A and STEP above 0")
    return FrameRange(first or 0, last, step or 1)


@dataclass(frozen=True)
class ViewerTarget:
    """Where the live view goes: a recording, a server of ours, or a running viewer."""

    file: Path | None = None
    serve: bool = False
    connect: str | None = None
    cloud_colour: CloudColour = "intensity"
    """What the colours of LiDAR points stand for."""

    @property
    def is_enabled(self) -> bool:
        """Whether anything is to be shown."""
        return self.serve or self.connect is not None or self.file is not None


@dataclass(frozen=True)
class RunOptions:
    """How to run."""

    output: Path
    backend: str = "sapien"
    profile: str = "auto"
    scale: float | None = None
    frames: FrameRange = field(default_factory=FrameRange)
    viewer: ViewerTarget = field(default_factory=ViewerTarget)
    fresh: bool = False
    format: str = "opv2v"

    def __post_init__(self) -> None:
        """Refuse what cannot be; the backend refuses the rest."""
        if self.profile not in ("auto", "preview", "full"):
            raise InputError(f"--profile {self.profile}: no such profile; auto, preview or full")
        find_format(self.format)
        if self.scale is not None and not 0.01 <= self.scale <= 4:
            raise InputError(f"--scale {self.scale:g}: lies outside 0.01 to 4")


BYTES_PER_UNIT = {
    **{"B": 1, "kB": 10**3, "MB": 10**6, "GB": 10**9, "TB": 10**12},
    **{"KiB": 2**10, "MiB": 2**20, "GiB": 2**30, "TiB": 2**40},
}
SECONDS_PER_UNIT = {"s": 1, "min": 60, "h": 3600, "d": 86_400}


@dataclass(frozen=True)
class ResourceLimits:
    """What one scenario may take; None is without limit."""

    memory_bytes: int | None = None
    """Resident, for each process that makes its frames; they may take it together."""
    time_s: float | None = None
    """By the clock on the wall."""


def parse_byte_size(option: str, text: str) -> int:
    """Bytes of a text such as `4 GB`; InputError that names the option if it is none."""
    return int(_parse_quantity(option, text, BYTES_PER_UNIT, "4 GB"))


def parse_duration(option: str, text: str) -> float:
    """Seconds of a text such as `90 min`; InputError that names the option if it is none."""
    return _parse_quantity(option, text, SECONDS_PER_UNIT, "90 min")


def _parse_quantity(option: str, text: str, units: Mapping[str, int], example: str) -> float:
    match = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*([A-Za-z]+)\s*", text)
    if match is None or match[2] not in units or not float(match[1]):
        raise InputError(
            f"{option} {text}: not a positive number with a unit"
            f" ({', '.join(units)}); write {example}"
        )
    return float(match[1]) * units[match[2]]


def format_byte_size(size_bytes: float) -> str:
    """Such as `3.4 GB`."""
    for unit in ("TB", "GB", "MB", "kB"):
        if size_bytes >= BYTES_PER_UNIT[unit]:
            return f"{size_bytes / BYTES_PER_UNIT[unit]:.1f} {unit}"
    return f"{size_bytes:.0f} B"


def format_duration(time_s: float) -> str:
    """Such as `3:25:45`, or `0:07`."""
    minutes, seconds = divmod(round(time_s), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{seconds:02}" if hours else f"{minutes}:{seconds:02}"


@dataclass(frozen=True)
class Progress:
    """How far a scenario is.

    Attributes:
        scenario: Its id.
        phase: What is being done, in a word or two; `done` at the end.
        done: Frames that are finished.
        total: Frames in all; 0 as long as nobody knows.
        size_bytes: Of the scenario's files so far.
    """

    scenario: str
    phase: str
    done: int = 0
    total: int = 0
    size_bytes: int = 0


ProgressCallback = Callable[[Progress], None]
"""Called again and again while a scenario is being made."""


def ignore_progress(progress: Progress) -> None:
    """Keeps progress to itself."""


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
WORKER_JOB = TypeAdapter(WorkerJob)
WORKER_MESSAGE: TypeAdapter[ProgressMessage | FailureMessage] = TypeAdapter(WorkerMessage)
