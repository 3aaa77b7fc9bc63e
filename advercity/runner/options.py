"""What a run is asked for, besides its spec."""

import re
from dataclasses import dataclass, field
from pathlib import Path

from advercity.dataset.formats import format_called
from advercity.errors import InputError
from advercity.viewer.clouds import CloudColour


@dataclass(frozen=True)
class FrameRange:
    """Kept frames to make: `first` to `last`, which is not included, every `step`-th.

    `last` None means to the end.
    """

    first: int = 0
    last: int | None = None
    step: int = 1

    def of(self, count: int) -> range:
        """The frames of a scenario that has `count` of them."""
        last = count if self.last is None else min(self.last, count)
        return range(self.first, last, self.step)


def parse_frames(text: str | None) -> FrameRange:
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
    def is_asked_for(self) -> bool:
        """Whether anything is to be shown."""
        return self.serve or self.connect is not None or self.file is not None


@dataclass(frozen=True)
class Options:
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
        format_called(self.format)
        if self.scale is not None and not 0.01 <= self.scale <= 4:
            raise InputError(f"--scale {self.scale:g}: lies outside 0.01 to 4")
