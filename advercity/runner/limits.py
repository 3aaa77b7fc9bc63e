"""How much memory and time a scenario may take, as people write them."""

import re
from collections.abc import Mapping
from dataclasses import dataclass

from advercity.errors import InputError

SIZES = {
    **{"B": 1, "kB": 10**3, "MB": 10**6, "GB": 10**9, "TB": 10**12},
    **{"KiB": 2**10, "MiB": 2**20, "GiB": 2**30, "TiB": 2**40},
}
TIMES = {"s": 1, "min": 60, "h": 3600, "d": 86_400}


@dataclass(frozen=True)
class Limits:
    """What one scenario may take; None is without limit."""

    memory_bytes: int | None = None
    """Resident, for each process that makes its frames; they may take it together."""
    time_s: float | None = None
    """By the clock on the wall."""


def parse_size(option: str, text: str) -> int:
    """Bytes of a text such as `4 GB`; InputError that names the option if it is none."""
    return int(_parse(option, text, SIZES, "4 GB"))


def parse_time(option: str, text: str) -> float:
    """Seconds of a text such as `90 min`; InputError that names the option if it is none."""
    return _parse(option, text, TIMES, "90 min")


def _parse(option: str, text: str, units: Mapping[str, int], example: str) -> float:
    match = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*([A-Za-z]+)\s*", text)
    if match is None or match[2] not in units or not float(match[1]):
        raise InputError(
            f"{option} {text}: not a positive number with a unit"
            f" ({', '.join(units)}); write {example}"
        )
    return float(match[1]) * units[match[2]]


def size_in_words(size_bytes: float) -> str:
    """Such as `3.4 GB`."""
    for unit in ("TB", "GB", "MB", "kB"):
        if size_bytes >= SIZES[unit]:
            return f"{size_bytes / SIZES[unit]:.1f} {unit}"
    return f"{size_bytes:.0f} B"


def time_in_words(time_s: float) -> str:
    """Such as `3:25:45`, or `0:07`."""
    minutes, seconds = divmod(round(time_s), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{seconds:02}" if hours else f"{minutes}:{seconds:02}"
