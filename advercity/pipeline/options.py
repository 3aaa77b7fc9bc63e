"""What a run is asked for besides its specs, and how people write sizes and times."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from advercity.dataset.cloud_files import CloudEncoding, parse_cloud_encoding
from advercity.dataset.formats import find_format
from advercity.errors import InputError

if TYPE_CHECKING:
    from advercity.viewer.cloud_colours import CloudColour

PROFILE_NAMES = ("auto", "preview", "full")
BYTES_PER_UNIT = {
    **{"B": 1, "kB": 10**3, "MB": 10**6, "GB": 10**9, "TB": 10**12},
    **{"KiB": 2**10, "MiB": 2**20, "GiB": 2**30, "TiB": 2**40},
}
SECONDS_PER_UNIT = {"s": 1, "min": 60, "h": 3600, "d": 86_400}
MIN_SCALE, MAX_SCALE = 0.01, 4.0
MAX_JOBS = 1000
"""More processes at a time than any machine has cores for."""


@dataclass(frozen=True)
class ViewerTarget:
    """Where the live view goes: a recording, a server of this process, or a running viewer.

    Attributes:
        file: Recording (`.rrd`) to write.
        serve: Serve the view from this process.
        connect: Address of a running Rerun viewer.
        cloud_colour: What the colours of LiDAR points encode.
        map_tiles: Show receivers on a map, whose tiles come from the Internet.
    """

    file: Path | None = None
    serve: bool = False
    connect: str | None = None
    cloud_colour: "CloudColour" = "intensity"
    map_tiles: bool = False

    @property
    def is_enabled(self) -> bool:
        """Whether anything is shown."""
        return self.serve or self.connect is not None or self.file is not None


@dataclass(frozen=True)
class RunOptions:
    """How scenarios are run.

    Attributes:
        output: Folder of the dataset.
        backend: Name of the rendering backend; `auto` until `resolve_backend` has chosen.
        profile: `auto`, `preview` or `full`.
        scale: Width and height of images as a fraction of the authored ones; None is the
            profile's own.
        frames: Recorded frames to make, counted from 0.
        viewer: Live view.
        fresh: Discard what is there and start over.
        format: Dataset layout, `opv2v` or `adver_city`.
        allow_missing_models: Generate bodies in place of models that are not installed.
        allow_edited: Run specs that were edited after they were compiled.
        allow_missed: Make scenarios whose conflicts do not happen as declared, and record it.
        min_points: LiDAR points that an actor must return to an agent to be annotated by it.
        clouds: Encoding of point clouds, `binary` or `binary_compressed`; the original's layout
            has text in any case.
    """

    output: Path
    backend: str = "sapien"
    profile: str = "auto"
    scale: float | None = None
    frames: slice = field(default_factory=lambda: slice(None))
    viewer: ViewerTarget = field(default_factory=ViewerTarget)
    fresh: bool = False
    format: str = "opv2v"
    allow_missing_models: bool = False
    allow_edited: bool = False
    allow_missed: bool = False
    min_points: int = 0
    clouds: CloudEncoding = "binary_compressed"

    def __post_init__(self) -> None:
        """Raise InputError for values that no backend takes; the backend checks the rest."""
        if self.profile not in PROFILE_NAMES:
            raise InputError(f"`profile` {self.profile}: no such profile; auto, preview or full")
        find_format(self.format)
        parse_cloud_encoding(self.clouds)
        if self.min_points < 0:
            raise InputError(f"`min_points` {self.min_points}: is below 0")
        if self.scale is not None and not MIN_SCALE <= self.scale <= MAX_SCALE:
            raise InputError(f"`scale` {self.scale:g}: is outside {MIN_SCALE:g} to {MAX_SCALE:g}")
        check_frames(self.frames)


def check_frames(frames: slice) -> None:
    """Raise an InputError if a slice holds no frame of any scenario."""
    first, last, step = frames.start or 0, frames.stop, frames.step
    if first < 0 or (step is not None and step < 1) or (last is not None and last <= first):
        raise InputError(
            f"`frames` {format_frames(frames)}: holds no frame;"
            " the end must be above the start, both counted from 0, and the step above 0"
        )


def check_jobs(jobs: int | None) -> None:
    """Raise an InputError if there cannot be so many processes at a time."""
    if jobs is not None and not 1 <= jobs <= MAX_JOBS:
        raise InputError(f"`jobs` {jobs}: is outside 1 to {MAX_JOBS}")


def format_frames(frames: slice) -> str:
    """Format a slice of frames as `A:B` or `A:B:STEP`, as it is written on the command line."""
    parts = (frames.start, frames.stop, *([] if frames.step is None else [frames.step]))
    return ":".join("" if part is None else str(part) for part in parts)


@dataclass(frozen=True)
class ResourceLimits:
    """Limits beyond which a scenario is killed; None is unlimited.

    Attributes:
        memory_bytes: Resident memory per worker process; the workers of a scenario may use the
            sum together.
        time_s: Wall-clock time of a scenario.
    """

    memory_bytes: int | None = None
    time_s: float | None = None


def parse_byte_size(option: str, text: str) -> int:
    """Parse a text such as `4 GB` as bytes; InputError names the option if it is none."""
    return int(_parse_quantity(option, text, BYTES_PER_UNIT, "4 GB"))


def parse_duration(option: str, text: str) -> float:
    """Parse a text such as `90 min` as seconds; InputError names the option if it is none."""
    return _parse_quantity(option, text, SECONDS_PER_UNIT, "90 min")


def _parse_quantity(option: str, text: str, units: Mapping[str, int], example: str) -> float:
    match = re.fullmatch(r"\s*([0-9]+(?:\.[0-9]+)?)\s*([A-Za-z]+)\s*", text)
    if match is None or match[2] not in units or not float(match[1]):
        raise InputError(
            f"{option} {text}: not a positive number with a unit"
            f" ({', '.join(units)}); write {example}"
        )
    return float(match[1]) * units[match[2]]


def format_byte_size(size_bytes: float) -> str:
    """Format bytes for people, such as `3.4 GB`."""
    for exponent, unit in ((12, "TB"), (9, "GB"), (6, "MB"), (3, "kB")):
        if size_bytes >= 10**exponent:
            return f"{size_bytes / 10**exponent:.1f} {unit}"
    return f"{size_bytes:.0f} B"


def format_duration(time_s: float) -> str:
    """Format seconds as `3:25:45` or `0:07`."""
    minutes, seconds = divmod(round(time_s), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{seconds:02}" if hours else f"{minutes}:{seconds:02}"


@dataclass(frozen=True)
class RunResources:
    """What a run may use.

    Attributes:
        worker_count: Processes at a time.
        limits: Limits for each scenario.
    """

    worker_count: int = 1
    limits: ResourceLimits = field(default_factory=ResourceLimits)
