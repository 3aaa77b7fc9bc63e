"""Options of a run: names, help texts, defaults and limits.

The command line and the Python interface are made from the fields of `RunOptions`.
"""

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import KW_ONLY, dataclass, field, fields
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

from advercity.errors import InputError

BYTES_PER_UNIT = {
    **{"B": 1, "kB": 10**3, "MB": 10**6, "GB": 10**9, "TB": 10**12},
    **{"KiB": 2**10, "MiB": 2**20, "GiB": 2**30, "TiB": 2**40},
}
SECONDS_PER_UNIT = {"s": 1, "min": 60, "h": 3600, "d": 86_400}
MIN_SCALE, MAX_SCALE = 0.01, 4.0
MIN_RATE_HZ = 0.001
RATE_TOLERANCE = 1e-3
"""Of a rate, so 3.333 Hz is every third tick of 0.1 s."""
ProfileName = Literal["auto", "preview", "full"]
"""Quality of rendered images; `auto` suits the device."""
CloudEncoding = Literal["binary", "binary_compressed"]
"""PCD's names of its encodings: points as they are, or field by field in LZF blocks."""
CloudColour = Literal["intensity", "class", "kind"]
"""Meaning of the colours of LiDAR points."""


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


@dataclass(frozen=True)
class RunResources:
    """Processes and limits of a run.

    Attributes:
        worker_count: Processes at a time.
        limits: Limits for each scenario.
    """

    worker_count: int = 1
    limits: ResourceLimits = field(default_factory=ResourceLimits)


def check_frames(frames: slice) -> None:
    """Raise an InputError if a slice holds no frame of any scenario."""
    first, last, step = frames.start or 0, frames.stop, frames.step
    if first < 0 or (step is not None and step < 1) or (last is not None and last <= first):
        raise InputError(
            f"`frames` {format_frames(frames)}: holds no frame;"
            " the end must be above the start, both counted from 0, and the step above 0"
        )


def parse_frames(text: str) -> slice:
    """Parse `A:B[:STEP]`, where A and B may be left out."""
    match = re.fullmatch(r"([0-9]{0,9}):([0-9]{0,9})(?::([0-9]{1,9}))?", text)
    if match is None:
        raise InputError(f"`frames` {text}: not a range; write A:B or A:B:STEP, as 0:30")
    first, last, step = (int(part) if part else None for part in match.groups())
    frames = slice(first, last, step)
    check_frames(frames)
    return frames


def format_frames(frames: slice) -> str:
    """Format a slice of frames as `A:B` or `A:B:STEP`, as on the command line."""
    parts = (frames.start, frames.stop, *([] if frames.step is None else [frames.step]))
    return ":".join("" if part is None else str(part) for part in parts)


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
class ViewerTarget:
    """Where the live view goes: a recording, a server of this process, or a running viewer.

    Attributes:
        file: Recording (`.rrd`) to write.
        serve: Serve the view from this process.
        connect: Address of a running Rerun viewer.
        cloud_colour: Meaning of the colours of LiDAR points.
        map_tiles: Show receivers on a map, whose tiles come from the Internet.
    """

    file: Path | None = None
    serve: bool = False
    connect: str | None = None
    cloud_colour: CloudColour = "intensity"
    map_tiles: bool = False

    @property
    def is_enabled(self) -> bool:
        """Whether anything is shown."""
        return self.serve or self.connect is not None or self.file is not None


@dataclass(frozen=True)
class Option:
    """Description of an option for the command line and the documents.

    Attributes:
        text: Help text.
        flag: Name on the command line; empty is the name of the field.
        metavar: Word for its value in the help.
        parse: Converts the text from the command line; not called for the default.
        at_least: Smallest value.
        at_most: Largest value.
    """

    text: str
    flag: str = ""
    metavar: str | None = None
    parse: Callable[[str], Any] | None = None
    at_least: float = -math.inf
    at_most: float = math.inf


def parse_names(text: str) -> tuple[str, ...]:
    """Parse names separated by commas, without blanks around them; an empty text has none."""
    return tuple(name.strip() for name in text.split(",")) if text.strip() else ()


def parse_rate_hz(text: str) -> float:
    """Parse a rate such as `5hz`."""
    match = re.fullmatch(r"\s*([0-9]+(?:\.[0-9]+)?)\s*(?:hz)?\s*", text, re.IGNORECASE)
    if match is None:
        raise InputError(f"`rate` {text}: not a rate; write 5hz")
    return float(match[1])


@dataclass(frozen=True, kw_only=True)
class DatasetOptions:
    """Options of a dataset's content, on any machine."""

    format: Annotated[str, Option("Layout of the dataset: opv2v or adver_city.")] = "opv2v"
    min_points: Annotated[
        int, Option("Annotate only objects with so many LiDAR points of an agent.", at_least=0)
    ] = 0
    clouds: Annotated[
        CloudEncoding, Option("Encoding of PCD files: binary or binary_compressed.")
    ] = "binary_compressed"
    sensors: Annotated[
        tuple[str, ...],
        Option(
            "Only these kinds of sensors: camera,lidar,radar,thermal (default: all of the rig).",
            metavar="KIND,...",
            parse=parse_names,
        ),
    ] = field(default_factory=tuple[str, ...])
    agents: Annotated[
        tuple[str, ...],
        Option(
            "Only data of these agents: ego,rsu1 (default: all).",
            metavar="AGENT,...",
            parse=parse_names,
        ),
    ] = field(default_factory=tuple[str, ...])


@dataclass(frozen=True)
class RunOptions(DatasetOptions):
    """How scenarios are run."""

    output: Annotated[
        str | Path,
        Option("Folder for the dataset; with Ray also a URL: s3://bucket/folder.", parse=str),
    ] = "output"
    _: KW_ONLY
    backend: Annotated[
        str, Option("Rendering backend; auto is sapien, or mitsuba for full without a GPU.")
    ] = "auto"
    profile: Annotated[ProfileName, Option("auto, preview or full.")] = "auto"
    scale: Annotated[
        float | None,
        Option(
            "Fraction of the rig's image width and height, in place of the profile's"
            " (preview: 0.25, full: 1).",
            at_least=MIN_SCALE,
            at_most=MAX_SCALE,
        ),
    ] = None
    frames: Annotated[
        slice,
        Option(
            "Recorded frames to make, B not included.", metavar="A:B[:STEP]", parse=parse_frames
        ),
    ] = field(default_factory=lambda: slice(None))
    rate_hz: Annotated[
        float | None,
        Option(
            "Frames per second, as 5hz (default: one every tick).",
            flag="rate",
            metavar="RATE",
            parse=parse_rate_hz,
            at_least=MIN_RATE_HZ,
        ),
    ] = None
    fresh: Annotated[bool, Option("Start over; discard finished frames.")] = False
    jobs: Annotated[
        int | None,
        Option(
            "Processes at a time (default: as many as suit the machine).",
            at_least=1,
            at_most=1000,  # above the cores of any machine
        ),
    ] = None
    max_memory_bytes: Annotated[
        int | None,
        Option(
            "Memory limit per process, as '4 GB' (default: from the estimate).",
            flag="max-memory",
            metavar="SIZE",
            parse=partial(parse_byte_size, "`max_memory_bytes`"),
        ),
    ] = None
    max_time_s: Annotated[
        float | None,
        Option(
            "Time limit per scenario, as '2 h' (default: from the estimate).",
            flag="max-time",
            metavar="TIME",
            parse=partial(parse_duration, "`max_time_s`"),
        ),
    ] = None
    allow_large: Annotated[bool, Option("Run even if it would fill the machine.")] = False
    allow_missing_models: Annotated[bool, Option("Generate bodies in place of missing models.")] = (
        False
    )
    allow_edited: Annotated[bool, Option("Run specs edited after compiling.")] = False
    allow_missed: Annotated[
        bool,
        Option("Go on where a staged conflict does not happen as declared, and record it."),
    ] = False
    executor: Annotated[str, Option("local, or ray for a cluster.")] = "local"
    cluster_address: Annotated[
        str | None, Option("Cluster: auto, or HOST:PORT (default: one on this machine).")
    ] = None
    rrd: Annotated[Path | None, Option("Write a Rerun recording.")] = None
    stream: Annotated[bool, Option("Serve the live view.")] = False
    connect: Annotated[str | None, Option("Send to a running Rerun viewer.")] = None
    cloud_colour: Annotated[
        CloudColour,
        Option(
            "Meaning of the colours of LiDAR points; kind is the source of the return.",
            metavar="intensity|class|kind",
        ),
    ] = "intensity"
    map_tiles: Annotated[bool, Option("Show receivers on a map, with tiles from the Internet.")] = (
        False
    )

    def __post_init__(self) -> None:
        """Raise an InputError for values of no use to any run; the backend checks the rest."""
        for name, (kind, option) in OPTIONS.items():
            _check_value(name, getattr(self, name), kind, option)
        check_frames(self.frames)
        if self.rate_hz is not None and self.frames.step is not None:
            raise InputError("`rate_hz` and the step of `frames` exclude each other; give one")
        if sum((self.rrd is not None, self.stream, self.connect is not None)) > 1:
            raise InputError("`rrd`, `stream` and `connect` exclude each other; give one")
        if not str(self.output):
            raise InputError("`output` is empty; give a folder, `.` for this one")

    def select_frames(self, length: int, tick_s: float) -> range:
        """Select the frames to make of a scenario's recorded frames.

        Raises:
            InputError: The rate is no whole fraction of the rate of ticks.
        """
        frames = range(length)[self.frames]
        if self.rate_hz is None:
            return frames
        ticks = 1.0 / (self.rate_hz * tick_s)
        step = max(1, round(ticks))
        if abs(ticks - step) > RATE_TOLERANCE * step:
            rates = sorted({1 / (n * tick_s) for n in (step, max(1, math.floor(ticks)), step + 1)})
            raise InputError(
                f"`rate_hz` {self.rate_hz:g}: frames are a whole number of ticks of {tick_s:g} s"
                f" apart; take {' or '.join(f'{rate:.4g}' for rate in rates)}"
            )
        return frames[::step]

    @property
    def folder(self) -> Path:
        """Folder of the dataset on this machine."""
        return Path(self.output)

    @property
    def limits(self) -> ResourceLimits:
        """Requested limits for each scenario."""
        return ResourceLimits(self.max_memory_bytes, self.max_time_s)

    @property
    def viewer(self) -> ViewerTarget:
        """Where the live view goes."""
        return ViewerTarget(self.rrd, self.stream, self.connect, self.cloud_colour, self.map_tiles)


def _check_value(name: str, value: Any, kind: Any, option: Option) -> None:
    """Raise an InputError for a value outside its choices or limits."""
    if get_origin(kind) is Literal and value not in get_args(kind):
        raise InputError(f"`{name}` {value}: is none of {', '.join(get_args(kind))}")
    limits = (option.at_least, option.at_most)
    if limits == (-math.inf, math.inf) or value is None:
        return
    if not option.at_least <= value <= option.at_most:
        raise InputError(f"`{name}` {value}: is outside {limits[0]:g} to {limits[1]:g}")


def _list_options() -> dict[str, tuple[Any, Option]]:
    hints = get_type_hints(RunOptions, include_extras=True)
    return {item.name: get_args(hints[item.name]) for item in fields(RunOptions)}


OPTIONS = _list_options()
"""Types and options by the names of their fields."""
RunOptions.__doc__ = "How scenarios are run.\n\nAttributes:\n" + "".join(
    f"    {name}: {option.text}\n" for name, (_, option) in OPTIONS.items()
)
